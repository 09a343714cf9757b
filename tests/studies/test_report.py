"""studies/09_report: the README says what results.json holds, and that is what the package finds."""

from __future__ import annotations

import json
from pathlib import Path

import pytest

import ldbb_bayes as lb


@pytest.fixture(scope="module")
def results(root: Path) -> dict[str, object]:
    return json.loads((root / "studies" / "09_report" / "results.json").read_text())


def test_what_the_readmes_say(root: Path, results: dict[str, object]) -> None:
    text = " ".join((root / "studies" / "09_report" / "README.md").read_text().split())
    assert f"{results['page_MB']:.1f} MB, {results['figures']} figures, {results['tables']} tables" in text
    assert results["page_MB"] < 3.0  # type: ignore[operator]
    assert results["shares_off_one"] < 1e-9  # type: ignore[operator]
    size = results["least_squares_peak_to_peak_um"]
    assert "46.0, 34.2 and 4.6 µm" in text
    assert [round(size[name], 1) for name in ("C_XXX", "C_YYY")] == [46.0, 34.2]  # type: ignore[index]
    assert [round(size[name], 1) for name in ("C_CCY", "E_XX1", "E_YX2")] == [4.6, 19.5, 7.5]  # type: ignore[index]
    assert f"{100 * results['E_XX1_bar_length']:.0f} %" in (root / "README.md").read_text()  # type: ignore[operator]


def test_the_numbers_are_the_packages(results: dict[str, object], recovered: lb.Campaign) -> None:
    posterior = lb.sample(lb.HybridModel.paper(0), recovered, sampler="quadrature", seed=1)
    size = lb.contributions(posterior).set_index("source")["peak_to_peak"]
    for name, value in results["least_squares_peak_to_peak_um"].items():  # type: ignore[attr-defined]
        assert size[name] == pytest.approx(value, rel=1e-6)
