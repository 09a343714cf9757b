"""The same readings count once, whatever is stated of them."""

from __future__ import annotations

import json
from dataclasses import replace
from pathlib import Path

import numpy as np
import pandas as pd
import pytest
from batches import CONSTANT
from campaigns import TRUTH, plan, refuses

import ldbb_bayes as lb
from ldbb_bayes.campaign.loading import MountCompensation
from ldbb_bayes.fleet.dataset import DATASET, FLEET_COLUMNS, read_fleet
from ldbb_bayes.fleet.selection import CaveatKind, choose

pytest.importorskip("pyarrow")


def measured(seed: int, machine: str) -> lb.Campaign:
    planned = plan((60,) * 3, forces_N=(36.0, 400.0, 742.0))
    simulation = CONSTANT.simulate(
        planned, seed=seed, parameters=TRUTH, hyper_um={"sigma": 0.3, "tau": 2.0}
    )
    return replace(simulation.campaign, machine_id=machine, name=f"{machine} {seed}")


def recompensated(campaign: lb.Campaign) -> lb.Campaign:
    """The same readings under another name, in another order, for another mount."""
    change = campaign.mount.deflection_um_per_bar - 2.0
    tests = []
    for test in reversed(campaign.tests):
        reading_um = np.asarray(test.reading_um) + change * float(test.pressure_bar or 0.0)
        tests.append(replace(test.with_reading_um(reading_um), name=f"again_{test.name}"))
    return replace(campaign, tests=tests, name="other", mount=MountCompensation(2.0))


@pytest.fixture(scope="module")
def batch(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """Two campaigns of one machine, and the same readings with order = "random"."""
    folder = tmp_path_factory.mktemp("twice")
    first, second = measured(1, "M1"), measured(2, "M1")
    campaigns = {
        "first": replace(first, date="2026-01-05"),
        "second": replace(second, date="2026-02-05"),
        "first_again": replace(first, date="2026-03-05", order="random"),
        "second_again": replace(second, date="2026-04-05", order="random"),
    }
    for name, campaign in campaigns.items():
        lb.write_campaign(replace(campaign, name=name), folder / name)
    return lb.fleet.run_batch(
        [folder / name for name in campaigns],
        folder / "out",
        model=CONSTANT,
        ess=500.0,
        compare=False,
    ).out


def test_a_trend_counts_readings_once_whatever_order_is_stated(batch: Path) -> None:
    rows = read_fleet(batch)
    assert rows["sha256"].nunique() == 4
    trend = lb.fleet.find_trend(rows, include_misfits=True)
    caveats = {caveat.kind: caveat.names for caveat in trend.caveats}
    assert caveats[CaveatKind.GIVEN_AGAIN] == ("first_again", "second_again")
    of_two = lb.fleet.find_trend(rows[:2], include_misfits=True)
    assert trend.probability == of_two.probability
    assert [visit.campaign for visit in trend.campaigns] == ["first", "second"]


def test_rows_without_the_digest_are_told_by_that_of_readings_and_conditions(batch: Path) -> None:
    """A table of an earlier version is read; a second row of one campaign is left out."""
    older = read_fleet(batch)[list(FLEET_COLUMNS)]
    doubled = pd.concat([older, older[:1].assign(date="2026-05-05")], ignore_index=True)
    trend = lb.fleet.find_trend(doubled, include_misfits=True)
    assert len(trend.campaigns) == 4
    assert CaveatKind.GIVEN_AGAIN in {caveat.kind for caveat in trend.caveats}
    mixed = pd.concat([older[:1], read_fleet(batch)], ignore_index=True)
    assert len(lb.fleet.find_trend(mixed, include_misfits=True).campaigns) == 2


def test_a_batch_without_the_digest_is_read(batch: Path, tmp_path: Path) -> None:
    import pyarrow.parquet as pq

    table = pq.read_table(batch / DATASET).drop_columns(["circles_sha256"])
    pq.write_table(table, tmp_path / DATASET)
    assert "circles_sha256" not in read_fleet(tmp_path)
    both = read_fleet([tmp_path, batch])
    assert both["circles_sha256"].isna().tolist() == [True] * 4 + [False] * 4


def test_a_prior_is_refused_whatever_is_stated_of_the_readings(batch: Path, tmp_path: Path) -> None:
    other = measured(3, "M2")
    moments = read_fleet(batch)[:1]
    rows = pd.concat(
        [
            moments,
            moments.assign(
                machine_id="M2", sha256=other.sha256, circles_sha256=other.circles_sha256
            ),
        ],
        ignore_index=True,
    )
    population = lb.fleet.fit_population(rows, include_misfits=True)
    (tmp_path / "population.json").write_text(json.dumps(lb.report.with_words(population)))
    prior = lb.fleet.read_population_prior(tmp_path)
    for campaign in (other, recompensated(other), replace(other, order="random", drift=False)):
        refuses("must not be in the population that gives its prior", prior.doubts, campaign)
    assert isinstance(prior.doubts(measured(4, "M3")), tuple)


def test_a_trend_of_readings_given_twice_says_so(batch: Path) -> None:
    rows = read_fleet(batch)
    same = rows[rows["name"].isin(["first", "first_again"])]
    refuses(
        "got 1. Name each campaign once. Left out, because",
        lb.fleet.find_trend,
        same,
        include_misfits=True,
    )


def test_a_test_read_twice_and_one_of_the_other_sign_are_named(tmp_path: Path) -> None:
    """A batch names such campaigns; a trend or a population that uses them says so."""
    planned = plan((60,) * 4, forces_N=(36.0, 300.0, 550.0, 742.0))
    sound = CONSTANT.simulate(
        planned, seed=5, parameters=TRUTH, hyper_um={"sigma": 0.3, "tau": 0.5}
    ).campaign
    last = sound.tests[3]
    again = replace(last, name="again")
    turned = last.with_reading_um(-np.asarray(last.reading_um))
    campaigns = {
        "sound": sound,
        "twice": replace(sound, tests=(*sound.tests, again)),
        "turned": replace(sound, tests=(*sound.tests[:3], turned)),
    }
    folders = [
        lb.write_campaign(replace(campaign, name=name), tmp_path / name)
        for name, campaign in campaigns.items()
    ]
    batch = lb.fleet.run_batch(folders, tmp_path / "out", model=CONSTANT, ess=100.0, compare=False)
    remarks = {Path(odd["campaign"]).name: odd["remark"] for odd in batch.odd_readings}
    assert list(remarks) == ["twice", "turned"]
    assert f"Tests {last.name} and again hold the same readings" in remarks["twice"]
    assert f"The mean reading of {last.name} is" in remarks["turned"]
    _, caveats = choose(read_fleet(batch.out), include_misfits=True)
    names = {caveat.kind: caveat.names for caveat in caveats}
    assert names[CaveatKind.READ_TWICE] == ("twice",)
    assert names[CaveatKind.OTHER_SIGN] == ("turned",)
