"""What `check` notices and assumes before anything is fitted."""

from __future__ import annotations

import re
from dataclasses import replace
from typing import Any

import numpy as np
import pytest
from campaigns import plan, simulated

import ldbb_bayes as lb
from ldbb_bayes.campaign.circle_preview import resolution_of
from ldbb_bayes.campaign.remarks import RemarkKind
from ldbb_bayes.report.wording import remark_words

ANGLE = np.arange(36) * 10.0


def several() -> lb.Campaign:
    tests = [
        lb.CircularTest(100.0, ANGLE, plane="XY", direction="CW", time_s=0.0),
        lb.CircularTest(400.0, ANGLE, plane="XY", direction="CCW", radius_mm=100.0, time_s=60.0),
        lb.CircularTest(
            400.0, ANGLE, plane="YZ", direction="CW", setup=2, centre_z_mm=-30.0, time_s=120.0
        ),
    ]
    return lb.Campaign(tuple(tests), frames_mm={"Y": (0.0, -200.0, 350.0)})


def test_the_preview_states_what_a_fit_will_assume() -> None:
    preview = lb.check_campaign(several())
    text = " ".join(map(remark_words, preview.assumptions))
    for words in (
        "plane XY + YZ, R = 100, 150 mm, each with a length of its own.",
        "Joint frames stand at Y (0, -200, 350) mm.",
        "Set-ups 1, 2: tool offsets of each",
        "Both directions of travel in XY: hysteresis is a term of the model.",
        "follows the times that the tests state, over",
    ):
        assert words in text
    assert [r.values for r in preview.remarks if r.kind is RemarkKind.ONE_WAY] == [
        {"compliance": "C_YZY", "plane": "YZ"}
    ]
    assert preview.as_dict()["tests"][2]["centre_mm"] == [0.0, 0.0, -30.0]


@pytest.mark.parametrize(
    ("times_s", "stated", "source"),
    [
        ((0.0, 300.0, 900.0), {}, "times"),
        ((0.0, 300.0, 900.0), {"order": "random"}, "times"),
        ((0.0, 300.0, None), {}, "listed order"),
        ((None, None, None), {}, "listed order"),
        ((0.0, 300.0, None), {"order": "random"}, "random order"),
        ((0.0, 300.0, 900.0), {"drift": False}, "no drift"),
    ],
)
def test_the_preview_states_the_source_of_the_times(
    times_s: tuple[float | None, ...], stated: dict[str, Any], source: str
) -> None:
    """And the model has a drift by times, or by the order listed, and else none."""
    tests = []
    for force_N, time_s in zip((100.0, 300.0, 500.0), times_s, strict=True):
        tests.append(lb.CircularTest(force_N, np.arange(0.0, 360.0, 5.0), time_s=time_s))
    plan = lb.Plan(tests, **stated)
    (remark,) = [r for r in lb.check_campaign(plan).assumptions if r.kind is RemarkKind.DRIFT]
    assert remark.values["source"] == source
    assert remark_words(remark)

    bound = lb.HybridModel.default(0).bind(plan)
    time_h = bound.setting.time_h
    by_source = {"times": [-1 / 9, -1 / 36, 5 / 36], "listed order": [-0.1, 0.0, 0.1]}
    if source in by_source:
        np.testing.assert_allclose(time_h, by_source[source])
    assert bool(lb.terms.Drift().columns(bound.setting)) == (source in by_source)


def test_the_step_of_the_readout_is_found(rng: np.random.Generator) -> None:
    """Rounded readings give their step, with an offset and on a wide circle too; a fine readout, or
    its digits, none."""
    reading = 40.0 * np.cos(np.deg2rad(2.0 * np.arange(720.0))) + 0.3 * rng.standard_normal(720)
    for step in (0.01, 0.24, 1.0):
        assert resolution_of(step * np.rint(reading / step) + 0.077) == pytest.approx(
            step, rel=1e-6
        )
    assert resolution_of(reading) is None
    assert resolution_of(np.round(reading, 4)) is None


def test_steps_spikes_and_gaps_are_counted(rng: np.random.Generator) -> None:
    angle = np.concatenate(
        [np.arange(0.0, 100.0, 0.5), np.arange(110.0, 200.0, 0.5), np.arange(215.0, 360.0, 0.5)]
    )
    reading = np.round(
        5.0 * np.cos(np.deg2rad(2.0 * angle)) + 0.2 * rng.standard_normal(angle.size), 1
    )
    reading[[40, 300]] += (30.0, -25.0)
    (test_preview,) = lb.check_campaign(
        lb.Campaign((lb.CircularTest(100.0, angle, reading),))
    ).tests
    assert test_preview.spikes == 2
    assert test_preview.resolution_um == pytest.approx(0.1)
    assert test_preview.largest_gap_deg == pytest.approx(15.5)
    text = " ".join(map(remark_words, test_preview.remarks))
    assert "reading 41 at 20° stands" in text
    assert "2 readings do so" in text
    assert "steps of 0.1 µm, but the campaign states a resolution of 0.24 µm" in text


def odd(**changes: object) -> lb.Campaign:
    angle = np.arange(0.0, 360.0, 1.0)
    fields = {
        "force_N": 300.0,
        "angle_deg": angle,
        "reading_um": 0.1 * np.sin(37 * np.deg2rad(angle)),
        "name": "a",
    } | changes
    return lb.Campaign((lb.CircularTest(**fields),))  # type: ignore[arg-type]


@pytest.mark.parametrize(
    ("changes", "remark"),
    [
        (
            {"direction": "CW"},
            "stated CW, but the angles run CCW: correct one of them, unless the readings were"
            " sorted by angle",
        ),
        ({"angle_deg": np.linspace(0, 220, 360)}, "arc of 220° only"),
        ({"angle_deg": np.linspace(0, 300, 360)}, "arc of 300° only"),
        ({"angle_deg": np.linspace(0, 356, 360)}, "gap of 4.0°"),
        ({"angle_deg": np.linspace(0, 320, 360)}, "arc of 320° only"),
        ({"reading_um": np.linspace(0, 30, 360)}, "start and end differ by +30.0 µm"),
        ({"reading_um": np.zeros(360)}, "peak to peak is 0 µm: check the unit"),
        ({"pressure_bar": 6.0}, "force 300 N, but the force law gives 742 N at 6 bar"),
    ],
)
def test_preview_notices(changes: dict, remark: str) -> None:
    preview = lb.check_campaign(odd(**changes))
    assert any(remark in remark_words(noticed) for noticed in preview.tests[0].remarks)
    assert any("One force level" in remark_words(noticed) for noticed in preview.remarks)


@pytest.mark.parametrize("offsets_deg", [(0.0, 0.0, 0.0), (0.0, 0.001, 0.002), (0.0, 0.1)])
def test_several_readings_at_each_angle_leave_no_gaps(offsets_deg: tuple[float, ...]) -> None:
    angle = np.add.outer(np.arange(0.0, 360.0), offsets_deg).ravel()
    preview = lb.check_campaign(odd(angle_deg=angle, reading_um=0.1 * np.sin(37.0 * angle)))
    assert not {RemarkKind.GAP, RemarkKind.ARC} & {r.kind for r in preview.tests[0].remarks}


def test_preview_notices_certificates_of_one_radius_or_one_plane() -> None:
    """The bar has a length at each radius, a ball another great circle in each plane."""
    angle = np.arange(0.0, 360.0, 4.0)
    radii = [lb.CircularTest(300.0, angle, radius_mm=radius) for radius in (150.0, 100.0)]
    planes = [lb.CircularTest(300.0, angle, plane=plane) for plane in ("XY", "YZ")]
    trace = lb.Ball(harmonics_um=[(2, 2.0, 0.0)], U_um=0.04)
    one_bar = lb.Campaign(radii, instrument=lb.Instrument(bar_U_um=1.0))
    frames = {"X": (0.0, 0.0, 0.0), "Y": (0.0, 0.0, 0.0)}
    of_planes = {"topology": "wXFYZt", "frames_mm": frames}
    one_trace = lb.Campaign(planes, instrument=lb.Instrument(tool=trace), **of_planes)
    kinds = (RemarkKind.ONE_BAR, RemarkKind.ONE_TRACE)
    sentences = []
    for campaign in (one_bar, one_trace):
        remarks = lb.check_campaign(campaign).remarks
        sentences += [remark_words(remark) for remark in remarks if remark.kind in kinds]
    assert len(sentences) == 2
    assert sentences[0].startswith("The bar's certificate is used at R = 100 and 150 mm")
    assert sentences[1].startswith(
        "The harmonics stated for the tool ball are used in planes XY and YZ"
    )
    plain = lb.Campaign(radii)
    assert not {remark.kind for remark in lb.check_campaign(plain).remarks} & set(kinds)


def test_preview_notices_spikes_copies_and_units() -> None:
    campaign = simulated(plan((720,) * 4))
    reading = campaign.tests[1].reading_um.copy()
    reading[100] += 50.0
    a, b, c, d = campaign.tests
    preview = lb.check_campaign(
        lb.Campaign((a, b.with_reading_um(reading), c, d.with_reading_um(c.reading_um)))
    )
    (remark,) = preview.tests[1].remarks
    assert re.fullmatch(
        r"reading 101 at 50° stands \+(4[89]|5[012])\.\d µm off its neighbours",
        remark_words(remark),
    )
    assert "Tests f520 and f742 hold the same readings: a file read twice?" in map(
        remark_words, preview.remarks
    )
    for forces, largest in (
        ((0.036, 0.3, 0.52, 0.742), "0.742"),
        ((36.0, 300.0, 520.0, 5e4), "5e+04"),
    ):
        remarks = map(remark_words, lb.check_campaign(plan(forces_N=forces)).remarks)
        assert any(
            f"the largest force is {largest} N: check the unit" in words for words in remarks
        )


@pytest.mark.parametrize("step", [1.0, 5.0, 10.0])
def test_a_step_of_the_path_is_no_drift_and_a_spike_is_one_reading(
    step: float, rng: np.random.Generator
) -> None:
    """Last and first reading are a step apart: where the path is steep they differ without any
    drift."""
    angle = np.arange(20.0, 380.0, step)
    for drift, expected in ((0.0, []), (60.0, [RemarkKind.OPEN]), (0.0, [RemarkKind.SPIKES])):
        reading = (
            40.0 * np.cos(np.deg2rad(2.0 * angle + 30.0))
            + 0.3 * rng.standard_normal(angle.size)
            + drift * angle / 360.0
        )
        if RemarkKind.SPIKES in expected:
            reading[7] += 900.0
        (test_preview,) = lb.check_campaign(
            lb.Campaign((lb.CircularTest(300.0, angle, reading),))
        ).tests
        assert [remark.kind for remark in test_preview.remarks] == expected
        assert 0.1 < (test_preview.noise_um or 0.0) < 0.6 or drift
    assert (test_preview.spikes, test_preview.remarks[0].values["reading"]) == (1, 8)
    assert test_preview.remarks[0].values["off_um"] == pytest.approx(900.0, abs=3.0)


@pytest.mark.parametrize(
    ("radius_mm", "asked"), [(0.15, [0.15]), (100_000.0, [100_000.0]), (50.0, []), (1350.0, [])]
)
def test_a_radius_that_no_bar_has_is_asked_about(radius_mm: float, asked: list[float]) -> None:
    preview = lb.check_campaign(
        lb.Campaign((lb.CircularTest(300.0, np.arange(0.0, 360.0, 5.0)),), radius_mm=radius_mm)
    )
    assert [
        remark.values["value"] for remark in preview.remarks if remark.kind is RemarkKind.UNIT
    ] == asked


def test_preview_is_silent_on_a_good_campaign() -> None:
    """Read as they come, and to the resolution that is stated."""
    campaign = simulated(plan((720,) * 4))
    rounded = [
        test.with_reading_um(0.24 * np.rint(test.reading_um / 0.24)) for test in campaign.tests
    ]
    for good in (campaign, lb.Campaign(tuple(rounded))):
        assert all(test.remarks == () for test in lb.check_campaign(good).tests)


# Standard uncertainties of the model, and of certificates [mm, N, rad].
TAKEN = {
    "work_form_2": (2.5e-3 / 24**0.5, 0.5e-3 / 24**0.5),
    "work_form_3": (2.5e-3 / 24**0.5, 0.5e-3 / 24**0.5),
    "tool_form_2": (2.5e-3 / 24**0.5, 0.025e-3),
    "tool_form_3": (2.5e-3 / 24**0.5, 2.5e-3 / 24**0.5),
    "bar_length": (9.4e-3, 1e-3),
    "mount": (0.233e-3, 0.0233e-3),
    "mount_curvature": (0.5e-3, 0.5e-3),
    "force_gain": (0.01, 0.005),
    "force_curvature": (0.01, 0.006 / 3**0.5),
    "force_random": (4.0, 1.5),
    "angle_reference": (np.deg2rad(0.1), np.deg2rad(0.025)),
    "angle_lag": (np.deg2rad(0.1), np.deg2rad(0.025)),
}


def bounded_orders(sphericity_mm: float) -> dict[str, float]:
    """Of a ball whose deviation from sphericity is stated: its orders beyond those in `TAKEN`."""
    return {f"work_form_{n}": sphericity_mm / 24**0.5 * 3 / n for n in range(4, 13)}


@pytest.mark.parametrize("is_stated", [False, True])
def test_what_is_taken_for_granted_is_what_a_fit_has(is_stated: bool) -> None:
    instrument = lb.Instrument()
    expected_sds = {name: sds[is_stated] for name, sds in TAKEN.items()}
    not_stated = set(TAKEN)
    values = [2.33e-3]
    if is_stated:
        balls = (lb.Ball(grade="G20"), lb.Ball(harmonics_um=((2, 0.21, 35.0),), U_um=0.05))
        instrument = lb.Instrument(*balls, -0.4, 2.0, 2.0, 1.0, 0.6, 1.5, 0.05)
        expected_sds |= bounded_orders(0.5e-3)
        not_stated = {"mount_curvature", "tool_form_3"}
        values = [0.21e-3, -0.4e-3, 2.33e-3]
    campaign = replace(plan(work_deg=45.0, tool_deg=30.0), instrument=instrument)

    assumed = lb.terms.uncertainties(campaign).assumed
    assert {uncertainty.name: uncertainty.sd for uncertainty in assumed} == pytest.approx(
        expected_sds, rel=1e-12
    )
    assert {uncertainty.name for uncertainty in assumed if not uncertainty.stated} == not_stated
    assert [uncertainty.value for uncertainty in assumed if uncertainty.value] == pytest.approx(
        values
    )

    model = lb.HybridModel.default()
    setting = model.bind(campaign).setting
    sds = {}
    for term in model.nuisances:
        for columns in term.columns(setting):
            if isinstance(columns, lb.terms.Columns):
                sd = columns.sd if columns.stated is None else columns.stated
                sds |= dict(zip(columns.names, sd, strict=True))
    in_fit = {name: sds[name.replace("form_", "form_cos")] for name in expected_sds}
    assert in_fit == pytest.approx(expected_sds, rel=1e-12)


def test_several_centres_say_where_direct_compliances_and_their_changes_are() -> None:
    """Each axis has the mean of the different centres of the circles in which it moves."""
    places = ((0.0, 0.0), (0.0, 0.0), (300.0, 90.0))
    angle_deg = np.arange(0.0, 360.0, 5.0)
    tests = [
        lb.CircularTest(100.0 * (k + 1), angle_deg, centre_x_mm=x_mm, centre_y_mm=y_mm)
        for k, (x_mm, y_mm) in enumerate(places)
    ]
    other_plane = lb.CircularTest(100.0, angle_deg, plane="YZ", centre_z_mm=80.0, setup=2)
    campaign = lb.Plan((*tests, other_plane))
    assert campaign.mean_centre_mm == pytest.approx((150.0, 30.0, 80.0))
    words = [remark_words(remark) for remark in lb.check_campaign(campaign).assumptions]
    (sentence,) = [sentence for sentence in words if "several centres" in sentence]
    assert "along the travel counts from their mean, (150, 30, 80) mm" in sentence
    assert "distance from the machine's zero" in sentence
    one_centre = lb.Plan(tuple(tests[:2]))
    kinds = {remark.kind for remark in lb.check_campaign(one_centre).assumptions}
    assert RemarkKind.CENTRES not in kinds
