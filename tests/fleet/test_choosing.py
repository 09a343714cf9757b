"""Which campaigns are relied on: a slip is left out and said, so is what was asked for; a slip that is kept spoils the rest."""

from __future__ import annotations

from functools import partial
from importlib import import_module
from typing import Any

import numpy as np
import pandas as pd
import pytest
from trends import doubts, drawn_rows, one_campaign

import ldbb_bayes as lb
from ldbb_bayes.errors import InputError
from ldbb_bayes.fleet.change import detection
from ldbb_bayes.fleet.statistics import Caveat, CaveatKind, choose, labels
from ldbb_bayes.report.wording import caveat_words

SLIP = ["order", "noise"]


@pytest.fixture(scope="module")
def rows() -> pd.DataFrame:
    return drawn_rows(8, np.random.default_rng(6)).assign(machine_id=[f"M{m}" for m in range(7)] + ["M6"])


def slipped(rows: pd.DataFrame, place: int) -> pd.DataFrame:
    """One campaign says a compliance thirty times too large, as sure of it as of a right one."""
    changed = rows.copy()
    mean = list(changed["gaussian_mean"].iloc[place])
    mean[one_campaign().names.index("C_XXX")] *= 30.0
    changed.at[place, "gaussian_mean"] = mean
    changed.at[place, "kinds"] = SLIP
    return changed


def test_a_slip_does_not_reach_the_others(rows: pd.DataFrame) -> None:
    bad = slipped(rows, 2)
    found, clean = lb.population(bad), lb.population(rows.drop(index=2))
    assert {name: own.mean for name, own in found.parameters.items()} == {n: own.mean for n, own in clean.parameters.items()}
    assert "M2" not in found.machine
    assert doubts(found)[0] == (
        "Left out, for the model does not expect their readings (see their verdicts; --include-misfits keeps them): c03."
    )
    kept = lb.population(bad, include_misfits=True)
    assert kept.campaigns == 8
    assert doubts(kept)[0] == "The model does not expect the readings of c03: kept, as was asked for."
    assert kept.parameters["C_XXX"].spread.mean > 5.0 * clean.parameters["C_XXX"].spread.mean


def test_a_slip_does_not_hide_a_change(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(import_module("ldbb_bayes.fleet.trend"), "detection", partial(detection, replicates=50, further=3))
    rows = drawn_rows(10, np.random.default_rng(4), step_at=6)
    bad = slipped(rows, 3)
    found = lb.trend(bad)
    assert found.changed
    assert found.most_probable.parameter == "C_XXX"
    assert found.campaigns == tuple(name for name in rows["name"] if name != "c04")
    assert "does not expect their readings" in doubts(found)[0]
    assert lb.trend(bad, include_misfits=True).parameters["C_XXX"].size != found.parameters["C_XXX"].size


def test_which_campaigns_are_relied_on(rows: pd.DataFrame) -> None:
    """Noise alone is kept; what speaks against the model is left out, and what is asked for."""
    relied, caveats = choose(rows.assign(kinds=[["noise"], *[[]] * 7]))
    assert len(relied) == 8
    assert caveats == [Caveat(CaveatKind.NOT_WHITE, ("c01",))]
    relied, caveats = choose(rows.assign(kinds=[["truncation"], ["hyper", "forces"], None, *[[]] * 5]))
    assert list(relied["name"]) == [f"c{k:02d}" for k in range(2, 9)]
    relied, caveats = choose(rows, ["year/c01", "c02", "M2", "M6"])
    assert list(relied["name"]) == ["c04", "c05", "c06"]
    assert caveats == [Caveat(CaveatKind.EXCLUDED, ("c01", "c02", "c03", "c07", "c08"))]
    relied, caveats = choose(rows.assign(date=[None, *rows["date"][1:]]), since="2025-03-16")
    assert list(relied["name"]) == [f"c{k:02d}" for k in range(3, 9)]
    assert [caveat_words(caveat) for caveat in caveats] == ["Left out, for no date, or one before 2025-03-16: c01, c02."]
    assert list(choose(rows, since="2025-08-13T00:00:00+02:00")[0]["name"]) == ["c08"]


def test_no_decision_is_made_of_a_sentence(rows: pd.DataFrame, monkeypatch: pytest.MonkeyPatch) -> None:
    """Every caveat has words; with other words the numbers are the same."""
    wording = import_module("ldbb_bayes.report.wording")
    assert {str(kind) for kind in CaveatKind} == set(wording._CAVEATS)
    odd = rows.assign(kinds=[SLIP, ["noise"], *[[]] * 6], converged=[True, True, False, *[True] * 5])
    before = lb.population(odd).as_dict()
    monkeypatch.setattr(wording, "_CAVEATS", dict.fromkeys(wording._CAVEATS, "?"))
    assert lb.population(odd).as_dict() == before


@pytest.mark.parametrize(
    ("options", "said"),
    [
        ({"exclude": ["m2"]}, "must be a campaign or machine of the batch, got 'm2'. Did you mean 'M2'"),
        ({"since": "March"}, "since must be a date or time in ISO 8601, got 'March'"),
        ({"since": "2030-01-01"}, "campaigns must be left to rely on, got all 8 of them left out"),
    ],
)
def test_what_is_refused(rows: pd.DataFrame, options: dict[str, Any], said: str) -> None:
    with pytest.raises(InputError, match=said):
        choose(rows, **options)


def test_nothing_to_rely_on(rows: pd.DataFrame) -> None:
    with pytest.raises(InputError, match=r"readings that the model expects, got none of 8.*--include-misfits"):
        choose(rows.assign(kinds=[SLIP] * 8))
    with pytest.raises(InputError, match=r"got none of 8. See its reasons"):
        choose(rows.assign(status="failed"))
    with pytest.raises(InputError, match=r"two machines, got only M6. Add campaigns of others. Left out, as was asked for: c01"):
        lb.population(rows, exclude=[f"M{k}" for k in range(6)])
    with pytest.raises(InputError, match=r"campaigns of one machine to rely on, got 1. Measure again. Left out, as was asked"):
        lb.trend(rows, machine="M6", exclude=["c08"])


def test_names(rows: pd.DataFrame) -> None:
    twice = rows.assign(name=["same", "same", None, *rows["name"][3:]])
    assert labels(twice)[:4] == ["year/c01", "year/c02", "year/c03", "c04"]
    assert labels(rows.drop(columns="name")) == list(rows["campaign"])
    assert caveat_words(Caveat(CaveatKind.FAILED, tuple("abcdefg"))).endswith("fitted: a, b, c, d, e and 2 more.")
