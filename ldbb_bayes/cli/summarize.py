"""``ldbb-bayes summarize``: the numbers of an earlier fit."""

from __future__ import annotations

from pathlib import Path
from typing import Annotated

import typer

from ldbb_bayes.cli.options import CiOption, JsonOption, guarded

__all__ = ["summarize"]


@guarded
def summarize(
    result: Annotated[Path, typer.Argument(help="The --out folder of a fit, or its posterior.nc.", metavar="RESULT")],
    as_json: JsonOption = False,
    ci: CiOption = 0.95,
) -> None:
    """Table or JSON of a stored posterior, with intervals of any probability."""
    from ldbb_bayes.cli.show import print_fit, print_json
    from ldbb_bayes.inference.posterior import load
    from ldbb_bayes.report.result import full_result

    numbers = full_result(load(result), ci)
    if as_json:
        print_json(numbers)
    else:
        print_fit(numbers)
