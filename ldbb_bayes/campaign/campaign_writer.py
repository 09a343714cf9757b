"""Functions that write a campaign to a folder.

The folder holds the file campaign.toml and, for each test with readings, a CSV file of the
readings.
"""

from __future__ import annotations

from dataclasses import asdict, replace
from pathlib import Path
from typing import Any

import tomli_w

from ldbb_bayes.campaign.campaign import LABELS, Campaign
from ldbb_bayes.campaign.certified_instrument import Instrument
from ldbb_bayes.campaign.circular_test import PER_TEST, CircularTest
from ldbb_bayes.errors import require

__all__ = ["PILOT_NAME", "TOML_NAME", "write_campaign_into"]

TOML_NAME = "campaign.toml"
# Name of a subfolder in the folder of a plan. The subfolder holds the pilot, that is, the campaign
# or plan from which the plan was designed.
PILOT_NAME = "pilot"
# Version of the format of campaign.toml. It is written under the key ``schema``.
_SCHEMA = 1


def write_campaign_into(campaign: Campaign, folder: Path) -> None:
    """Write campaign.toml and one CSV file of readings for each test into an existing folder.

    No CSV file is written for the tests of a plan and for foreseen tests (tests that may be run
    later), because they have no readings. If the angles of a foreseen test are unevenly spaced, the
    same number of evenly spaced angles is written instead. The pilot of a plan is written into the
    subfolder ``pilot``. The pilot is the campaign or plan from which the plan was designed.
    """
    if campaign.pilot is not None:
        pilot_folder = folder / PILOT_NAME
        pilot_folder.mkdir()
        write_campaign_into(replace(campaign.pilot, pilot=None, adds_to_pilot=False), pilot_folder)
    text = tomli_w.dumps(_without_none(_campaign_tables(campaign)))
    for test in campaign.tests:
        text += f"\n[[test]]\n{tomli_w.dumps(_test_table(campaign, test))}"
    for test in campaign.foreseen:
        text += f"\n[[foreseen]]\n{tomli_w.dumps(_test_table(campaign, test.planned()))}"
    (folder / TOML_NAME).write_text(text, encoding="utf-8")
    for test in campaign.tests:
        if test.reading_um is not None:
            _write_readings(test, folder / f"{test.name}.csv")


def _write_readings(test: CircularTest, path: Path) -> None:
    """Write the angles [deg] and readings [µm] of a test into the CSV file ``path``."""
    lines = ["angle_deg,reading_um\n"]
    for angle, reading in zip(test.angle_deg.tolist(), test.reading_um.tolist(), strict=True):
        lines.append(f"{angle},{reading}\n")
    path.write_text("".join(lines), encoding="utf-8")


def _campaign_tables(campaign: Campaign) -> dict[str, Any]:
    """Return what campaign.toml states about a campaign, except its tests, as nested dictionaries.

    Values that are not given in the campaign are None.
    """
    tables: dict[str, Any] = {"schema": _SCHEMA}
    for name in ("topology", "plane", "radius_mm", "name", *LABELS):
        tables[name] = getattr(campaign, name)
    tables["feed_mm_per_min"] = campaign.feed_mm_per_min
    tables["resolution_um"] = campaign.resolution_um
    tables["order"] = campaign.order
    if not campaign.drift:
        tables["drift"] = False
    if campaign.pilot is not None:
        tables["pilot"] = PILOT_NAME
    if campaign.adds_to_pilot:
        tables["adds_to_pilot"] = True
    tables["mount"] = asdict(campaign.mount)
    tables["force"] = asdict(campaign.force_law)
    _add_certificates(tables, campaign.instrument)
    tables["tolerance"] = dict(campaign.tolerances) or None
    frames = {axis: list(frame) for axis, frame in campaign.frames_mm.items()}
    tables["frames_mm"] = frames or None
    return tables


def _add_certificates(tables: dict[str, Any], instrument: Instrument) -> None:
    """Add the certified values of the instrument to the tables of campaign.toml, in place.

    The field bar_U_um of the instrument, for example, becomes the key U_um of the table [bar].
    Values that are None or zero are left out.
    """
    stated = asdict(instrument)
    balls = {}
    for ball in ("work", "tool"):
        certified = {key: value for key, value in stated.pop(ball).items() if value}
        if certified:
            balls[ball] = certified
    tables["balls"] = balls or None
    for name, value in stated.items():
        if value:
            table, _, key = name.partition("_")
            tables.setdefault(table, {})[key] = value


def _test_table(campaign: Campaign, test: CircularTest) -> dict[str, Any]:
    """Return what campaign.toml states about one test, as a dict with the keys of that file.

    The caller writes the dict below [[test]] or [[foreseen]]. A foreseen test may be run later. A
    test below [[test]] has readings, or is planned if the campaign is a plan. For a test with
    readings, the dict names the file of the readings. For a test without readings, it holds the
    number, the first angle and the arc of the planned angles instead; an `InputError` is raised if
    these angles are not evenly spaced. A field is left out if its value is filled in again when the
    file is read. For example, the radius is left out if it is the radius of the campaign.
    """
    usual = {
        "radius_mm": campaign.radius_mm,
        "plane": campaign.plane,
        "setup": 1,
        "temperature_C": None,
        "time_s": None,
    }
    lacks_readings = test.reading_um is None  # a foreseen test, or a test of a plan
    table: dict[str, Any] = {"file": None if lacks_readings else f"{test.name}.csv"}
    for key in ("force_N", "pressure_bar", "direction"):
        table[key] = getattr(test, key)
    table["name"] = test.name or None  # foreseen tests have no name, but tests of a plan have
    for key in PER_TEST:
        value = getattr(test, key)
        if value != usual.get(key, 0.0):
            table[key] = value
    if lacks_readings:
        table |= _planned_angles_table(test)
    return _without_none(table)


def _planned_angles_table(test: CircularTest) -> dict[str, Any]:
    """Return the number, the first angle and the arc of a planned test's evenly spaced angles.

    The result is a dictionary with the keys of campaign.toml. Raise an `InputError` if the
    angles are not evenly spaced within one turn.
    """
    require(
        test.step_deg,
        "a plan's angles must be evenly spaced within one turn to be written, got others in test"
        f" {test.name!r}. Plan even angles.",
    )
    return {
        "readings": len(test.angle_deg),
        "start_deg": float(test.angle_deg[0]),
        "arc_deg": test.planned_arc_deg,
    }


def _without_none(table: dict[str, Any]) -> dict[str, Any]:
    """Return a table of campaign.toml, as a dictionary, without the keys whose value is None."""
    return {key: value for key, value in table.items() if value is not None}
