"""Description of the files of a session (one browser tab) before the fit.

The description consists of the tests, the polar plots of their readings (traces), the assumptions
made when the files were imported, and the uncertainties of the instrument.
"""

from __future__ import annotations

import math
import re
from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import Any

import numpy as np

import ldbb_bayes as lb
from ldbb_bayes.app.fields import FIELDS, FILES, read_files
from ldbb_bayes.errors import InputError, plain_reason
from ldbb_bayes.reading.assumptions import Assumption
from ldbb_bayes.report import wording
from ldbb_bayes.report.message_translation import is_own_text
from ldbb_bayes.units import two_digits

__all__ = ["refusal", "understand"]

# Approximate largest number of points that are drawn for the readings of a test in a polar plot.
# More points would not be visible.
_MOST_POINTS = 360
# Radius at which the lowest reading is drawn in a polar plot [units of the SVG drawing].
_INNER_RADIUS = 22.0
# Radial distance between the lowest and the highest reading in a polar plot [units of the SVG
# drawing].
_WIDTH = 78.0
# Approximate number of labelled rings of a polar plot between the lowest and the highest reading.
_RINGS = 4
# Smallest range of readings that a polar plot shows, so that equal readings can be drawn [µm].
_SMALLEST_RANGE_UM = 1e-3


def refusal(error: Exception, folder: Path) -> str:
    """Return the message that tells the user why a request could not be answered.

    Parameters
    ----------
    error
        The exception that was raised while the request was answered.
    folder
        Folder of the session (one browser tab).

    Returns
    -------
    str
        The message, in which files are named without the path of their folder.

    Raises
    ------
    Exception
        The exception ``error`` itself, unless the input, a file or a computation caused it.
    """
    reason = plain_reason(error)
    if reason is None:
        raise error
    return _without_folder(reason, folder)


def _without_folder(text: str, folder: Path) -> str:
    """Return a text in which the path of the folder with the added files is left out.

    ``folder`` is the folder of the session (one browser tab).
    """
    path = str(folder / FILES)
    text = re.sub(re.escape(path) + r"[/\\]", "", text)
    return text.replace(path, "the folder")


def understand(folder: Path, entries: Mapping[str, str]) -> dict[str, Any]:
    """Return a description of the campaign that was read from the files of a session.

    Parameters
    ----------
    folder
        Folder of the session (one browser tab).
    entries
        Texts typed on the page; the keys are the names of the entry fields.

    Returns
    -------
    dict
        Names of the campaign and its tests, topology, planes, tests, whether the angles of some
        test show a direction of travel that is not stated, number of readings, assumptions of the
        import, remarks about odd readings (``remarks``), what a fit would assume (``fit``), traces
        (polar plots of the readings), and uncertainties of the instrument. If the files cannot be
        read, the dict holds only the reason (``refused``) and the names of the entry fields that
        cause the error (``wrong``).
    """
    try:
        campaign, imported = read_files(folder, entries)
    except InputError as error:
        return {
            "refused": refusal(error, folder),
            "wrong": _wrong_entries(folder, entries, error),
        }
    preview = lb.check_campaign(campaign)
    tested_planes = {test.circle.plane for test in campaign.tests}
    traces = [
        _trace(campaign, plane) for plane in campaign.machine().planes if plane in tested_planes
    ]
    assumptions: Sequence[Assumption] = ()
    if imported is not None:
        assumptions = imported.assumptions
    return {
        "name": campaign.name,
        "names": [campaign.name, *(test.name for test in campaign.tests)],
        "topology": campaign.topology,
        "planes": campaign.machine().plane,
        "tests": _test_rows(preview, traces),
        "has_unstated_travel": any(test.travel and not test.direction for test in preview.tests),
        "readings": campaign.readings,
        "assumptions": _merged_rows(
            [_assumption_row(assumption, folder) for assumption in assumptions]
        ),
        "remarks": [wording.remark_words(remark) for remark in preview.remarks],
        "fit": [wording.remark_words(remark) for remark in preview.assumptions],
        "traces": traces,
        "instrument": _uncertainties_by_part(campaign),
    }


def _wrong_entries(folder: Path, entries: Mapping[str, str], error: InputError) -> list[str]:
    """Return the names of the entry fields whose texts cause an error when files are read.

    An entry causes the error if the files can be read after the entry is removed. If there is no
    such entry, return the names of the fields whose removal changes the error message.

    Parameters
    ----------
    folder
        Folder of the session (one browser tab).
    entries
        Texts typed on the page; the keys are the names of the entry fields.
    error
        The error that was raised when the files were read with all entries.
    """
    causes = []
    possible_causes = []
    for name in entries:
        if name not in FIELDS or name == "language":
            continue
        other_entries = {key: text for key, text in entries.items() if key != name}
        try:
            read_files(folder, other_entries)
            causes.append(name)
        except InputError as remaining_error:
            if str(remaining_error) != str(error):
                possible_causes.append(name)
    return sorted(causes or possible_causes)


def _test_rows(preview: Any, traces: Sequence[Mapping[str, Any]]) -> list[dict[str, Any]]:
    """Return the rows of the page's table of tests, as dicts.

    The keys of a row are the names of the columns, and the values are the contents of the cells.
    Two further keys are ``hue``, the hue in which the polar plot shows the test, and ``remarks``,
    the list of remarks on the test.
    """
    hues = {}
    for trace in traces:
        for path in trace["paths"]:
            hues[path["name"]] = path["hue"]
    rows = []
    for test in preview.tests:
        noise = "–" if test.noise_um is None else f"{test.noise_um:.2g}"
        rows.append(
            {
                "name": test.name,
                "force": f"{test.force_N:.4g}",
                "pressure": f"{test.pressure_bar:.3g}",
                "readings": test.readings,
                "arc": f"{test.arc_deg:.0f}",
                "direction": wording.travel_words(test),
                "plane": test.plane,
                "radius": f"{test.radius_mm:g}",
                "balls": f"{test.work_ball_deg:g} / {test.tool_ball_deg:g}",
                "noise": noise,
                "peak": f"{test.peak_to_peak_um or 0.0:.3g}",
                "remarks": [wording.remark_words(remark) for remark in test.remarks],
                "hue": hues[test.name],
            }
        )
    return rows


def _merged_rows(rows: Sequence[dict[str, Any]]) -> list[dict[str, Any]]:
    """Return the rows of the table of assumptions, with rows on the same quantity joined into one.

    A quantity such as the force may be assumed for several files. Successive rows on the same
    quantity are then joined into one row, which lists their values and places. The joined row gives
    the reason of the first row. Its entry ``has_other_reasons`` says whether that is only one of
    several reasons.
    """
    merged: list[dict[str, Any]] = []
    for row in rows:
        if merged and row["place"] and _is_on_same_quantity(row, merged[-1]):
            merged[-1]["value"] += f", {row['value']}"
            merged[-1]["place"] += f", {row['place']}"
            if row["because"] != merged[-1]["because"]:
                merged[-1]["has_other_reasons"] = True
        else:
            merged.append({**row, "has_other_reasons": False})
    return merged


def _is_on_same_quantity(row: Mapping[str, Any], other_row: Mapping[str, Any]) -> bool:
    """Return whether two rows of the table of assumptions are about the same quantity.

    Both rows must have the same subject and the same entry fields.
    """
    has_same_fields = row["fields"] == other_row["fields"]
    return bool(row["what"] == other_row["what"] and has_same_fields)


def _assumption_row(assumption: Assumption, folder: Path) -> dict[str, Any]:
    """Return the row of the page's table that states an assumption made at import.

    The row is a dict. Most of its values are texts. The value of ``fields`` is the list of the
    entry fields in which the user can change the assumption.
    """
    flags = assumption.option.split(", ")
    return {
        "place": _without_folder(str(assumption.place), folder),
        "what": _without_folder(str(assumption.what), folder),
        "value": _without_folder(str(assumption.value), folder),
        "because": _without_folder(str(assumption.because), folder),
        "fields": [field.name for field in FIELDS.values() if field.flag in flags],
        "option": assumption.option,
        "is_own_text": is_own_text(assumption.what),
    }


# ---- the instrument


def _uncertainties_by_part(campaign: lb.Campaign) -> dict[str, list[dict[str, Any]]]:
    """Return the prior uncertainties of the instrument, which the browser page shows part by part.

    The keys of the result are the parts, such as bar or balls. For each part there is a list with
    one dict for each uncertainty. The dict has these keys:

    - ``words``: name of the uncertainty; for a ball, "work" or "tool"
    - ``field``: field of the browser page in which the user can state the uncertainty; an empty
      string if there is no such field
    - ``size``: text with the uncertainty, or with a ball's grade, sphericity or stated harmonic
    - ``is_sphericity``: whether ``size`` is the sphericity of a ball
    - ``stated``: whether the campaign's data of the instrument state the uncertainty; for a ball,
      whether they state its sphericity, its grade or the harmonic concerned. Otherwise the
      uncertainty is a default value.
    """
    entries_by_part: dict[str, list[dict[str, Any]]] = {}
    for assumed in lb.terms.uncertainties(campaign).assumed:
        # The first word of the name of an attribute of `Instrument` names the part of the
        # instrument: ``bar_U_um`` belongs to the bar.
        certificate_field = assumed.certificate
        part_name = certificate_field.partition("_")[0] or assumed.name.partition("_")[0]
        if part_name in ("work", "tool"):
            entry = _ball_entry(campaign, assumed, part_name)
            entries = entries_by_part.setdefault("balls", [])
        else:
            entry = _instrument_entry(campaign, assumed, part_name)
            entries = entries_by_part.setdefault(part_name, [])
        if entry not in entries:
            entries.append(entry)
    return entries_by_part


def _ball_entry(campaign: lb.Campaign, assumed: Any, ball_name: str) -> dict[str, Any]:
    """Return what the browser page shows about one ball's form error: its grade or sphericity.

    ``ball_name`` is work or tool. ``assumed`` is the prior uncertainty of the ball's form error.
    For the keys of the result see `_uncertainties_by_part`.
    """
    ball: lb.Ball = getattr(campaign.instrument, ball_name)
    order = int(assumed.name.rpartition("_")[2])
    amplitude_um = {harmonic[0]: harmonic[1] for harmonic in ball.harmonics_um}
    is_sphericity = False
    if order in amplitude_um:
        size = f"n = {order}: {amplitude_um[order]:g} ± {ball.U_um:g} µm"
    elif ball.grade:
        size = ball.grade
    else:
        # ``assumed.sd`` is the prior sd of one Fourier order n of the ball's form error. Convert it
        # to the deviation from sphericity S: the variance of the order is S²/24 min(1, 3/n)².
        sphericity_um = math.sqrt(24.0) * assumed.sd * 1e3 * max(1.0, order / 3.0)
        size = f"{sphericity_um:.3g} µm"
        is_sphericity = True
    return {
        "words": ball_name,
        "field": f"{ball_name}_ball",
        "size": size,
        "is_sphericity": is_sphericity,
        "stated": assumed.stated,
    }


_LABELS = {"1": "%", "rad": "°", "N": "N"}
_FACTORS = {"1": 100.0, "rad": 180.0 / math.pi, "N": 1.0}


def _instrument_entry(campaign: lb.Campaign, assumed: Any, part: str) -> dict[str, Any]:
    """Return what the browser page shows about one uncertainty of the instrument.

    The page shows a text and ± U, where U is twice the prior standard deviation. ``part`` is the
    part of the instrument. For the keys of the result see `_uncertainties_by_part`.
    """
    factor = _FACTORS.get(assumed.unit, 1e3)
    label = _LABELS.get(assumed.unit, "µm")
    if assumed.unit.endswith("/bar"):
        label = "µm/bar"
    size = f"± {two_digits(2.0 * assumed.sd, factor)} {label}"
    deflection = campaign.mount.deflection_um_per_bar
    if assumed.certificate == "mount_U_percent" and deflection:
        # The certificate states U in percent of the deflection.
        share = 2.0 * assumed.sd * factor / deflection
        size += f" = {two_digits(share, 100.0)} %"
    error_um = campaign.instrument.bar_length_error_um
    if part == "bar" and error_um:
        size = f"{error_um:g} ".replace("-", "−") + size
    return {
        "words": wording.assumed_words(assumed)[0],
        "field": assumed.certificate,
        "size": size,
        "is_sphericity": False,
        "stated": assumed.stated,
    }


# ---- traces of the tests


def _trace(campaign: lb.Campaign, plane: str) -> dict[str, Any]:
    """Return a polar plot of the readings of all tests in a plane, for an SVG drawing.

    The plot has one closed or open line for each test, and rings labelled in µm. The highest
    reading is drawn at a radius of 100 units of the drawing.
    """
    forces = campaign.forces_N
    force_shares = (forces - forces.min()) / max(float(np.ptp(forces)), 1e-9)
    indices = [k for k, test in enumerate(campaign.tests) if test.plane == plane]
    readings_um = [np.asarray(campaign.tests[k].reading_um) for k in indices]
    low = min(readings.min() for readings in readings_um)
    high = max(readings.max() for readings in readings_um)
    spread = max(high - low, _SMALLEST_RANGE_UM)
    scale = _WIDTH / spread

    paths = []
    for k, readings in zip(indices, readings_um, strict=True):
        test = campaign.tests[k]
        stride = max(1, len(readings) // _MOST_POINTS)
        angle = test.angles_rad()[::stride]
        radius = _INNER_RADIUS + scale * (readings[::stride] - low)
        if test.arc_deg == 360.0:
            angle = np.append(angle, angle[0])
            radius = np.append(radius, radius[0])
        x = radius * np.cos(angle)
        y = -radius * np.sin(angle)
        points = [f"{x[n]:.1f},{y[n]:.1f}" for n in range(len(x))]
        # The colour of the trace of a circular test goes from blue at the lowest force to red at
        # the highest force.
        hue = round(215 - 205 * float(force_shares[k]))
        paths.append({"points": " ".join(points), "hue": hue, "name": test.name})

    rings = []
    for ring in _ring_readings(low, high, spread):
        ring_radius = _INNER_RADIUS + scale * (ring - low)
        rings.append({"r": f"{ring_radius:.1f}", "um": f"{ring:g}".replace("-", "−")})
    return {"plane": plane, "paths": paths, "rings": rings}


def _ring_readings(low: float, high: float, spread: float) -> list[float]:
    """Return about four readings [µm] at which a polar plot has rings.

    The readings lie between the lowest and the highest reading of the plot, ``low`` and ``high``.
    They are multiples of a step, which is 1, 2 or 5 times a power of ten. ``spread`` is the range
    of the readings in the plot, but at least 0.001 µm.
    """
    power = 10.0 ** np.floor(np.log10(spread / _RINGS))
    wanted = (high - low) / _RINGS
    steps = [multiple * power for multiple in (1.0, 2.0, 5.0, 10.0)]
    distances = [abs(step - wanted) for step in steps]
    step = steps[int(np.argmin(distances))]
    multiples = np.arange(np.ceil(low / step), np.floor(high / step) + 1)
    return [float(multiple * step) + 0.0 for multiple in multiples]
