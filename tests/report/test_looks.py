"""Every figure looks as it did: a perceptual hash of each, kept in golden/looks.json.

The hash is the sign of the difference between neighbouring cells of a 24 × 24 grid of mean brightness, 1104 bits. Another release
of matplotlib moves a few of them; another curve, a lost legend or a changed axis moves many. LDBB_WRITE_GOLDEN=1 writes anew.
"""

from __future__ import annotations

import json
import os
from collections.abc import Callable, Mapping
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from campaigns import HYPER_UM, TRUTH, plan
from matplotlib.backends.backend_agg import FigureCanvasAgg
from matplotlib.figure import Figure
from reports import fitted

import ldbb_bayes as lb
from ldbb_bayes.analysis.calibration import LOG_LIKELIHOOD, Validation
from ldbb_bayes.analysis.comparison import Comparison
from ldbb_bayes.machine.chain import Circle, Machine
from ldbb_bayes.report import figures

GOLDEN = Path(__file__).parent / "golden" / "looks.json"
CELLS, TOLERANCE = 24, 0.06


def looks(figure: Figure) -> str:
    """Bits as hexadecimal digits."""
    canvas = FigureCanvasAgg(figure)
    canvas.draw()
    grey = np.asarray(canvas.buffer_rgba())[..., :3].mean(axis=2)
    rows, columns = (np.array_split(np.arange(n), CELLS) for n in grey.shape)
    cells = np.array([[grey[np.ix_(r, c)].mean() for c in columns] for r in rows])
    bits = np.concatenate([(np.diff(cells, axis=axis) > 0.5).ravel() for axis in (0, 1)])
    return np.packbits(bits).tobytes().hex()


def apart(one: str, other: str) -> float:
    """Share of the bits that differ."""
    a, b = (np.unpackbits(np.frombuffer(bytes.fromhex(text), dtype=np.uint8)) for text in (one, other))
    return float((a != b).mean()) if len(a) == len(b) else 1.0


@pytest.fixture(scope="module")
def drawn(recovered: lb.Campaign, compared: Comparison) -> Mapping[str, Callable[[], Figure]]:
    linear = lb.HybridModel.default(1)
    posterior = fitted(linear, recovered)
    other = fitted(linear, linear.simulate(plan(), seed=3, parameters={**TRUTH, "C_XXX_1": 1e-8}, hyper_um=HYPER_UM).campaign)
    seen = lb.identify(linear, recovered)
    design = lb.design(linear, pilot=recovered, tests=4, forces_N=tuple(np.linspace(36.0, 742.0, 9)), curve=True)
    machine, circle = Machine("wCAFYXZSt"), Circle(150.0)
    drawn_ranks = np.random.default_rng(0).integers(0, 20, (10, 8)) * np.linspace(0.0, 1.0, 8)
    names = (*seen.parameters, LOG_LIKELIHOOD)[-8:]
    ranks = Validation(names, drawn_ranks.astype(int), 19, "joint", 0.95, ())
    every: dict[str, tuple[Callable[..., Figure], Any]] = {
        **{name: (draw, (posterior,)) for name, draw in figures.FIGURES.items() if name != "chains"},
        "chains": (figures.chains, (lb.sample(lb.HybridModel.default(0), plan_read(), seed=1),)),
        "budget_bars": (figures.budget_bars, (lb.budgets(posterior),)),
        "difference_forest": (figures.difference_forest, ({"other": lb.differences(posterior, other)},)),
        **{
            name: (getattr(figures, name), (compared,))
            for name in ("evidence", "compliance_with_local_fits", "geometry_with_local_fits", "predictive_p_values")
        },
        **{
            name: (getattr(figures, name), (seen,))
            for name in ("alias_map", "correlation_map", "nuisance_costs", "prior_and_posterior")
        },
        **{name: (getattr(figures, name), (design,)) for name in ("efficiency", "expected_widths", "information", "trade_off")},
        "compliance_atlas": (figures.compliance_atlas, (machine, circle)),
        "geometric_atlas": (figures.geometric_atlas, (machine, circle)),
        "rank_ecdf": (figures.rank_ecdf, (ranks,)),
    }
    return {name: lambda draw=draw, given=given: draw(*given) for name, (draw, given) in every.items()}


def plan_read() -> lb.Campaign:
    return lb.HybridModel.default(0).simulate(plan(), seed=3, parameters=TRUTH, hyper_um=HYPER_UM).campaign


def test_every_figure_is_looked_at(drawn: Mapping[str, Callable[[], Figure]]) -> None:
    style = {"PALETTE", "force_colours", "new_figure", "styled"}
    assert set(drawn) == set(figures.__all__) - {"FIGURES", "save_figure", "save_figures"} - style


def test_figures_look_as_they_did(drawn: Mapping[str, Callable[[], Figure]]) -> None:
    found = {name: looks(draw()) for name, draw in drawn.items()}
    if os.environ.get("LDBB_WRITE_GOLDEN"):
        GOLDEN.write_text(json.dumps(found, indent=1) + "\n", encoding="utf-8")
    golden = json.loads(GOLDEN.read_text(encoding="utf-8"))
    assert set(found) == set(golden)
    moved = {name: round(apart(found[name], golden[name]), 3) for name in found}
    assert {name: share for name, share in moved.items() if share > TOLERANCE} == {}


def test_another_figure_would_be_seen(drawn: Mapping[str, Callable[[], Figure]]) -> None:
    """Any two kinds are apart, and so is a figure without one of its panels."""
    golden = json.loads(GOLDEN.read_text(encoding="utf-8"))
    names = sorted(golden)
    closest = min(apart(golden[a], golden[b]) for i, a in enumerate(names) for b in names[:i])
    assert closest > 2.0 * TOLERANCE
    figure = drawn["circularity"]()
    figure.axes[0].set_visible(False)
    assert apart(looks(figure), golden["circularity"]) > TOLERANCE
