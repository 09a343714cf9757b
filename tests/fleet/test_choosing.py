"""Which campaigns are relied on: a slip is left out and said, so is what was asked for; a slip that is kept spoils the rest."""

from __future__ import annotations

from functools import partial
from importlib import import_module

import numpy as np
import pandas as pd
import pytest
from trends import drawn_rows, one_campaign

import ldbb_bayes as lb
from ldbb_bayes.errors import InputError
from ldbb_bayes.fleet.choosing import Wanted, labels, listed
from ldbb_bayes.fleet.detection import detection

SLIP = ["order 0 of f271", "white noise of f271"]


@pytest.fixture(scope="module")
def rows() -> pd.DataFrame:
    return drawn_rows(8, np.random.default_rng(6)).assign(machine_id=[f"M{m}" for m in range(7)] + ["M6"])


def slipped(rows: pd.DataFrame, place: int) -> pd.DataFrame:
    """One campaign says a compliance thirty times too large, as sure of it as of a right one."""
    changed = rows.copy()
    mean = list(changed["gaussian_mean"].iloc[place])
    mean[one_campaign().names.index("C_XXX")] *= 30.0
    changed.at[place, "gaussian_mean"] = mean
    changed.at[place, "misfits"] = SLIP
    return changed


def test_a_slip_does_not_reach_the_others(rows: pd.DataFrame) -> None:
    bad = slipped(rows, 2)
    found, clean = lb.population(bad), lb.population(rows.drop(index=2))
    assert {name: own.mean for name, own in found.parameters.items()} == {n: own.mean for n, own in clean.parameters.items()}
    assert "M2" not in found.machine
    assert found.doubts[0] == (
        "Left out, for the model does not expect their readings (see their verdicts; --include-misfits keeps them): c03."
    )
    kept = lb.population(bad, include_misfits=True)
    assert kept.campaigns == 8
    assert kept.doubts[0] == "The model does not expect the readings of c03: kept, as was asked for."
    assert kept.parameters["C_XXX"].spread.mean > 5.0 * clean.parameters["C_XXX"].spread.mean


def test_a_slip_does_not_hide_a_change(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(import_module("ldbb_bayes.fleet.trend"), "detection", partial(detection, replicates=50, further=3))
    rows = drawn_rows(10, np.random.default_rng(4), step_at=6)
    bad = slipped(rows, 3)
    found = lb.trend(bad)
    assert found.changed
    assert found.most_probable.parameter == "C_XXX"
    assert found.campaigns == tuple(name for name in rows["name"] if name != "c04")
    assert "does not expect their readings" in found.doubts[0]
    assert lb.trend(bad, include_misfits=True).parameters["C_XXX"].size != found.parameters["C_XXX"].size


def test_noise_alone_is_kept_and_said(rows: pd.DataFrame) -> None:
    choice = Wanted().choose(rows.assign(misfits=[["white noise of f036"], *[[]] * 7]))
    assert len(choice.rows) == 8
    assert choice.doubts() == ("Noise that is not white, so that uncertainties may be too small: c01.",)


def test_what_speaks_against_the_model_is_left_out(rows: pd.DataFrame) -> None:
    """Below one in a thousand."""
    choice = Wanted().choose(rows.assign(log_prob_truncation=[np.log(0.9e-3), np.log(1.1e-3), None, *[0.0] * 5]))
    assert list(choice.rows["name"]) == [f"c{k:02d}" for k in range(2, 9)]


def test_what_is_asked_for(rows: pd.DataFrame) -> None:
    exclude = ["year/c01", "c02", "M2", "M6"]
    choice = Wanted(exclude).choose(rows)
    assert list(choice.rows["name"]) == ["c04", "c05", "c06"]
    assert choice.notes == ("Left out, as was asked for: c01, c02, c03, c07, c08.",)
    since = Wanted(since="2025-03-16").choose(rows.assign(date=[None, *rows["date"][1:]]))
    assert list(since.rows["name"]) == [f"c{k:02d}" for k in range(3, 9)]
    assert since.notes == ("Left out, for no date, or one before 2025-03-16: c01, c02.",)
    assert list(Wanted(since="2025-08-13T00:00:00+02:00").choose(rows).rows["name"]) == ["c08"]
    assert lb.population(rows, exclude="M6").campaigns == 6


@pytest.mark.parametrize(
    ("wanted", "said"),
    [
        (Wanted(["m2"]), "must be a campaign or machine of the batch, got 'm2'. Did you mean 'M2'"),
        (Wanted(since="March"), "since must be a date or time in ISO 8601, got 'March'"),
        (Wanted(since="2030-01-01"), "campaigns must be left to rely on, got all 8 of them left out"),
    ],
)
def test_what_is_refused(rows: pd.DataFrame, wanted: Wanted, said: str) -> None:
    with pytest.raises(InputError, match=said):
        wanted.choose(rows)


def test_nothing_to_rely_on(rows: pd.DataFrame) -> None:
    with pytest.raises(InputError, match=r"readings that the model expects, got none of 8.*--include-misfits"):
        Wanted().choose(rows.assign(misfits=[SLIP] * 8))
    with pytest.raises(InputError, match=r"got none of 8. See its reasons"):
        Wanted().choose(rows.assign(status="failed"))
    with pytest.raises(InputError, match=r"two machines, got only M6. Add campaigns of others. Left out, as was asked for: c01"):
        lb.population(rows, exclude=[f"M{k}" for k in range(6)])
    with pytest.raises(InputError, match=r"campaigns of one machine to rely on, got 1. Measure again. Left out, as was asked"):
        lb.trend(rows, machine="M6", exclude=["c08"])


def test_names(rows: pd.DataFrame) -> None:
    twice = rows.assign(name=["same", "same", None, *rows["name"][3:]])
    assert labels(twice)[:4] == ["year/c01", "year/c02", "year/c03", "c04"]
    assert labels(rows.drop(columns="name")) == list(rows["campaign"])
    assert listed("abcdefg") == "a, b, c, d, e and 2 more"
