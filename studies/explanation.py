"""Pages of docs/explanation that state numbers: their templates, filled with what studies found and
the default model assumes.

python studies/explanation.py   # writes them
"""

from __future__ import annotations

import json
from pathlib import Path
from typing import Any

import study

import ldbb_bayes as lb
from ldbb_bayes.analysis import origins, verdicts
from ldbb_bayes.model.terms import Term

__all__ = ["written"]

HERE = Path(__file__).resolve().parent
PAGES = HERE.parent / "docs" / "explanation"


def spans_of_coverage(families: dict[str, Any]) -> dict[str, float]:
    """Lowest and highest coverage of a group of parameters in any family, by edition."""
    spans = {}
    for edition in ("first", "second", "third"):
        shares: list[float] = []
        for family in families.values():
            if family[edition] is not None:
                shares += family[edition]["coverage"].values()
        spans[f"{edition}_low"] = min(shares)
        spans[f"{edition}_high"] = max(shares)
    return spans


def written() -> dict[Path, str]:
    """Every page as its template says."""
    results = {
        path.parent.name: json.loads(path.read_text(encoding="utf-8"))
        for path in sorted(HERE.glob("*/results.json"))
    }
    families = results["12_real_machines"]["families"]
    not_confounded = [family["third"]["rest_coverage"] for family in families.values()]
    facts = {
        **results,
        **spans_of_coverage(families),
        **{kind.__name__: kind() for kind in Term.kinds.values()},
        "prior": lb.Prior.default(),
        "rule": lb.inference.StoppingRule(),
        "limit": {
            "half": origins.MAJORITY,
            "contracted": verdicts.CONTRACTION_LIMIT,
        },
        "rest_low": min(not_confounded),
        "rest_high": max(not_confounded),
        "mild": families["mild"],
    }
    templates = sorted(PAGES.glob("*.md.j2"))
    return {
        template.with_suffix(""): study.page(PAGES, template.stem, facts) for template in templates
    }


if __name__ == "__main__":
    for page, text in written().items():
        page.write_text(text, encoding="utf-8")
