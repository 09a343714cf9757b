"""Examples of the guides recomputed: JCGM 100, 101, 102, 106 and NIST TN 1900, figure by figure.

python studies/93_guides/run.py            # fails when a stated number is not reproduced
python studies/93_guides/run.py --write    # states anew
"""

from __future__ import annotations

import sys
from collections import Counter
from pathlib import Path
from typing import Any

HERE = Path(__file__).resolve().parent
sys.path[:0] = [str(HERE.parent), str(HERE)]
import conformity
import gum
import supplements
import technical_note
from figures import Figure
from study import Effort, Study, run


def as_row(figure: Figure) -> dict[str, Any]:
    """Return a figure as a row of the page's table."""
    return {
        "guide": figure.guide,
        "example": figure.example,
        "quantity": figure.quantity,
        "unit": figure.unit,
        "printed": figure.printed,
        "computed": figure.computed,
        "outcome": figure.outcome,
        "reason": figure.reason if figure.outcome == "DIFF" else "",
    }


def measure(effort: Effort) -> dict[str, Any]:
    """Return all figures with their outcomes, and how many of each guide pass."""
    figures = [
        *gum.figures(),
        *supplements.figures(),
        *conformity.figures(),
        *technical_note.figures(),
    ]
    outcomes = Counter((figure.guide, figure.outcome) for figure in figures)
    guides = dict.fromkeys(figure.guide for figure in figures)
    return {
        "figures": [as_row(figure) for figure in figures],
        "passed": {guide: outcomes[guide, "PASS"] for guide in guides},
        "differ": {guide: outcomes[guide, "DIFF"] for guide in guides},
        "unexplained": sum(figure.outcome == "DIFF" and not figure.reason for figure in figures),
    }


if __name__ == "__main__":
    # Draws at random give the same numbers on every machine up to rounding errors.
    run(Study(HERE, measure, tolerance=1e-6, absolute={"figures/*/computed": 1e-6}))
