"""Circular tests and campaigns made from arrays; masks; certificates."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import replace
from typing import Any

import numpy as np
import pytest
from campaigns import refuses

import ldbb_bayes as lb
from ldbb_bayes.campaign.loading import MountCompensation
from ldbb_bayes.errors import InputError

ANGLE = np.arange(0.0, 360.0, 10.0)
READING = np.cos(np.deg2rad(ANGLE))


def make(**changes: object) -> lb.CircularTest:
    fields = {"force_N": 36.0, "angle_deg": ANGLE, "reading_um": READING} | changes
    return lb.CircularTest(**fields)  # type: ignore[arg-type]


def test_radians_and_millimetres_are_converted_at_the_edge() -> None:
    test = lb.CircularTest(force_N=36.0, angle_rad=np.deg2rad(ANGLE), reading_mm=READING * 1e-3)
    np.testing.assert_allclose(test.angle_deg, ANGLE)
    np.testing.assert_allclose(test.readings_mm(), READING * 1e-3)

    with pytest.raises(ValueError, match="read-only"):
        make().angle_deg[0] = 1.0


@pytest.mark.parametrize(
    ("changes", "message"),
    [
        ({"angle_deg": None}, "must have angles, got none"),
        ({"angle_rad": ANGLE}, "angle_deg or angle_rad, got both"),
        ({"reading_um": READING[:-1]}, "36 angles and 35 readings"),
        ({"angle_deg": ANGLE[:8], "reading_um": READING[:8]}, "at least 9 readings, got 8"),
        ({"angle_deg": ANGLE[:8], "reading_um": None}, "at least 9 angles, got 8. Give the angles"),
        (
            {"reading_um": np.where(ANGLE == 30.0, np.nan, READING)},
            "finite reading_um, got nan at reading 4",
        ),
        ({"angle_deg": ANGLE / 4}, "arc of at least 180°"),
        ({"angle_deg": np.rad2deg(ANGLE)}, "span at most 40 turns, got 55.7. Check the unit"),
        ({"force_N": 0.0}, "force_N must be greater than 0, got 0.0. Correct it"),
        ({"force_N": None}, "force or a pressure, got neither"),
        ({"direction": "cw"}, "direction must be 'CW' or 'CCW', got 'cw'"),
        ({"name": "../escaped"}, "name must be valid, got '../escaped': it names a file"),
        ({"reading_um": READING * 1e6}, "readings below 100 mm, got 1000 mm. Check the unit"),
        ({"angle_deg": ANGLE[:, None]}, r"shape \(n,\)"),
    ],
)
def test_a_test_that_cannot_be_is_refused(changes: dict[str, object], message: str) -> None:
    refuses(message, make, **changes)


def test_an_unknown_argument_is_answered_with_the_nearest_name() -> None:
    refuses("got 'direktion'. Did you mean 'direction'", make, direktion="CW")
    refuses("got 'nmae'. Did you mean 'name'", lb.Campaign, [make()], nmae="six circles")


@pytest.mark.parametrize(
    "function",
    [
        lb.check_campaign,
        lb.HybridModel.default(0).bind,
        lambda campaign: lb.sample(lb.HybridModel.default(0), campaign),
        lambda campaign: lb.log_evidence(lb.HybridModel.default(0), campaign),
        lambda campaign: lb.log_density(lb.HybridModel.default(0), campaign),
        lambda campaign: lb.write_campaign(campaign, "folder"),
    ],
)
def test_what_is_no_campaign_is_refused(function: Callable[[Any], Any]) -> None:
    refuses("campaign must be a Campaign, got str. Read one with", function, "recovered_experiment")


def test_what_tests_leave_open_comes_from_the_campaign() -> None:
    campaign = lb.Campaign(
        (make(), make(force_N=742.0, radius_mm=100.0)), radius_mm=150.0, centre_mm=(1.0, 2.0)
    )
    first, second = campaign.tests
    assert (first.radius_mm, second.radius_mm, first.circle.centre_mm) == (
        150.0,
        100.0,
        (1.0, 2.0, 0.0),
    )
    assert first.pressure_bar == pytest.approx((36.0 + 14.2) / 126.04)
    assert lb.Campaign((make(force_N=None, pressure_bar=6.0),)).forces_N[0] == pytest.approx(742.04)
    assert [t.name for t in lb.Campaign((make(), make(), make())).tests] == [
        "f036",
        "f036_2",
        "f036_3",
    ]


def test_forces_that_no_regulator_sets_apart_are_one_level() -> None:
    def levels(*forces: float) -> int:
        return lb.Campaign(tuple(make(force_N=force) for force in forces)).force_levels

    assert (levels(400.0, 400.001), levels(400.0, 400.3, 400.6), levels(36.0, 37.0, 742.0)) == (
        1,
        2,
        3,
    )
    assert (
        lb.check_campaign(lb.Campaign((make(force_N=400.0), make(force_N=400.001)))).remarks[0].kind
        == "one force level"
    )
    with pytest.raises(InputError, match="at least two force levels, got one"):
        lb.HybridModel.first(1).bind(lb.Campaign((make(force_N=400.0), make(force_N=400.001))))


@pytest.mark.parametrize(
    ("tests", "options", "message"),
    [
        ((), {}, "at least one test"),
        ((make(force_N=None, pressure_bar=0.01),), {}, "force > 0"),
        ((make(name="a"), make(name="a")), {}, "'a' twice"),
        ((make(), make(reading_um=None, name="p")), {}, "got test 'p' without"),
        (
            (make(name="a", radius_mm=150.0), make(name="b", radius_mm=150.0005)),
            {},
            "radius_mm must be the same in test 'a' and test 'b', or differ in its first six",
        ),
        ((make(),), {"plane": "XZ"}, "plane must be one of"),
        (
            (make(), make(plane="YZ")),
            {"topology": "wFYXt"},
            "topology must hold the axes of plane YZ, got 'wFYXt' without Z",
        ),
        ((make(),), {"order": "randm"}, "order must be 'random', got 'randm'. Correct it"),
        ((make(),), {"drift": "some"}, "drift must be true or false, got 'some'"),
        ((make(),), {"resolution_um": 240.0}, "resolution_um must be less than or equal to 20"),
        ((make(),), {"feed_mm_per_min": -2000.0}, "feed_mm_per_min must be greater than 0"),
        ((make(),), {"drift": "no"}, "drift must be true or false, got 'no'"),
        ((make(),), {"frames_mm": {"W": (0.0, 0.0, 0.0)}}, "frames_mm must name linear axes"),
    ],
)
def test_a_campaign_that_cannot_be_is_refused(tests: tuple, options: dict, message: str) -> None:
    refuses(message, lb.Campaign, tests, **options)


def test_the_digest_is_of_what_the_model_uses() -> None:
    """Of every number that the model uses, as a float, and of nothing else."""
    first = make(time_s=20, work_ball_deg=45)
    second = make(force_N=742.0)
    campaign = lb.Campaign((first, second))
    nudged = READING.copy()
    nudged[3] += 1e-9
    floats = make(time_s=20.0, work_ball_deg=45.0)
    assert (
        lb.Campaign((floats, second), name="other", feed_mm_per_min=1.0).sha256 == campaign.sha256
    )
    different = [
        *(
            lb.Campaign((replace(first, **changes), second))
            for changes in ({"reading_um": nudged}, {"setup": 2}, {"work_ball_deg": 90.0})
        ),
        lb.Campaign((first, make(force_N=743.0))),
        lb.Campaign((first, second), resolution_um=0.1),
        lb.Campaign((first, second), frames_mm={"Y": (0.0, 0.0, 5.0)}),
        lb.Campaign((first, second), order="random"),
        lb.Campaign((first, second), drift=False),
        lb.Campaign((first, second), foreseen=(replace(first, direction="CCW"),)),
        campaign.plan(),
    ]
    assert len({campaign.sha256, *(other.sha256 for other in different)}) == 11


def test_the_digest_of_circles_is_of_their_readings_alone(rng: np.random.Generator) -> None:
    """Of none of what is stated of them, nor of a constant added to a circle."""
    readings = 30.0 * rng.standard_normal((2, len(ANGLE)))
    first, second = (make(reading_um=reading) for reading in readings)
    campaign = lb.Campaign((first, second))
    turned = make(
        angle_rad=np.deg2rad(np.roll(ANGLE, 7)),
        angle_deg=None,
        reading_um=None,
        reading_mm=1e-3 * (np.roll(readings[1], 7) + 12.345678912),
        force_N=742.0,
        name="renamed",
        setup=2,
    )
    of_same_readings = [
        lb.Campaign((turned, first), order="random", drift=False, resolution_um=0.1),
        lb.Campaign((first, second), mount=MountCompensation(2.0), radius_mm=150.0),
    ]
    assert {again.circles_sha256 for again in of_same_readings} == {campaign.circles_sha256}
    assert all(again.sha256 != campaign.sha256 for again in of_same_readings)
    nudged = readings[1].copy()
    nudged[3] += 1e-4
    different = [
        lb.Campaign((first, second.with_reading_um(nudged))),
        lb.Campaign((first,)),
        lb.Campaign((first, first, second)),
        lb.Campaign((first, replace(second, angle_deg=ANGLE + 5.0))),
        lb.Campaign((first, second.with_reading_um(readings[1][::-1]))),
    ]
    assert len({campaign.circles_sha256, *(other.circles_sha256 for other in different)}) == 6
    assert campaign.plan().circles_sha256 is None


def test_an_error_in_the_last_digit_does_not_change_the_digest_of_circles() -> None:
    """Readings with one decimal, with constants added that are rounded in binary."""
    reading_um = np.round(20.0 * READING, 1)
    first = lb.Campaign((make(reading_um=reading_um),))
    for added_um in np.linspace(0.1, 900.0, 200):
        again = lb.Campaign((make(reading_um=(reading_um + added_um) - 0.3),))
        assert again.circles_sha256 == first.circles_sha256


def test_tests_are_selected_by_name() -> None:
    campaign = lb.Campaign((make(), make(force_N=300.0), make(force_N=742.0)))
    assert [t.name for t in campaign.without("f300").tests] == ["f036", "f742"]
    assert [t.name for t in campaign.select(["f742", "f036"]).tests] == ["f036", "f742"]
    for chosen in (lambda: campaign.without("f301"), lambda: campaign.select(["f301"])):
        refuses("Did you mean 'f300'", chosen)
    assert campaign.plan().is_plan
    refuses("planned test", campaign.plan().tests[0].readings_mm)


def test_order_and_drift_stay_with_the_campaign() -> None:
    tests = (make(), make(force_N=300.0), make(force_N=742.0))
    campaign = lb.Campaign(tests, order="random", drift=False)
    for changed in (campaign.plan(), campaign.select(["f036", "f742"]), campaign.without("f036")):
        assert (changed.order, changed.drift) == ("random", False)


def test_tests_were_run_as_listed_and_drifted_unless_stated() -> None:
    campaign = lb.Campaign((make(),))
    assert campaign.order is None
    assert campaign.drift


@pytest.mark.parametrize(
    ("angle", "arc"),
    [
        (ANGLE, 360.0),
        (np.linspace(-10, 210, 50), 220.0),
        (np.linspace(0, 720, 200), 360.0),
        (ANGLE[::4], 360.0),
        (np.add.outer(np.arange(0.0, 360.0, 5.0), (0.0, 0.001, 0.002)).ravel(), 360.0),
        (np.add.outer(np.arange(0.0, 221.0, 5.0), (0.0, 0.001)).ravel(), 220.001),
    ],
)
def test_the_arc_is_what_the_angles_cover(angle: np.ndarray, arc: float) -> None:
    assert make(angle_deg=angle, reading_um=np.zeros(len(angle))).arc_deg == pytest.approx(arc)


# ---- preparation


def recording(start: float = -30.0, stop: float = 390.0) -> lb.CircularTest:
    angle = np.arange(start, stop)
    return lb.CircularTest(
        force_N=36.0, angle_deg=angle, reading_um=np.sin(np.deg2rad(angle)), name="a"
    )


def test_a_force_law_converts_pressure_and_force() -> None:
    law = lb.campaign.ForceLaw()
    for pressure, force in ((0.4, 36.0), (3.0, 364.0), (6.0, 742.0)):
        assert law.force_N(pressure) == pytest.approx(force, abs=0.3)
        assert law.pressure_bar(law.force_N(pressure)) == pytest.approx(pressure)
    refuses("slope_N_per_bar must be", lb.campaign.ForceLaw, slope_N_per_bar=0.0)


def test_reversal_points_are_masked() -> None:
    test = lb.reading.mask_reversals(recording(0.0, 360.0), 5.0)
    distance = np.abs((test.angle_deg + 45.0) % 90.0 - 45.0)
    assert distance.min() > 5.0
    assert len(test.angle_deg) == 360 - 4 * 11
    refuses("between 0 and 45", lb.reading.mask_reversals, recording(), 60.0)


def test_masked_arcs_may_run_through_zero() -> None:
    test = lb.reading.mask_angles(recording(0.0, 360.0), [(350.0, 370.0), (100.0, 110.0)])
    assert {355.0, 5.0, 105.0, 11.0, 99.0, 111.0, 349.0} & set(test.angle_deg) == {
        11.0,
        99.0,
        111.0,
        349.0,
    }
    refuses("must leave readings", lb.reading.mask_angles, recording(), [(0.0, 360.0)])


ROUND = {"harmonics_um": ((2, 0.21, 35.0), (3, 0.1, -20.0)), "U_um": 0.05}


def test_certificates_go_where_the_campaign_goes() -> None:
    """And leave the digest of the readings as it is."""
    plain = lb.Campaign((recording(), replace(recording(), name="b")))
    instrument = lb.Instrument(
        lb.Ball(grade="G20"),
        lb.Ball(**ROUND),
        bar_length_error_um=-0.4,
        bar_U_um=1.0,
        mount_U_percent=2.0,
    )
    stated = replace(plain, instrument=instrument)
    assert {
        variant.instrument for variant in (stated.plan(), stated.select(["b"]), stated.without("b"))
    } == {instrument}
    assert (instrument.work.stated_sphericity_um, instrument.tool.stated_sphericity_um) == (
        0.5,
        None,
    )
    assert stated.sha256 == plain.sha256


@pytest.mark.parametrize(
    ("grade", "sphericity_um"),
    [
        ("G3", 0.08),
        ("G5", 0.13),
        ("G10", 0.25),
        ("G16", 0.4),
        ("G20", 0.5),
        ("G24", 0.6),
        ("G28", 0.7),
        ("G40", 1.0),
        ("G100", 2.5),
        ("G200", 5.0),
    ],
)
def test_a_grade_states_the_sphericity_of_iso_3290(grade: str, sphericity_um: float) -> None:
    assert lb.Ball(grade=grade).stated_sphericity_um == sphericity_um


@pytest.mark.parametrize(
    ("kind", "stated", "message"),
    [
        (lb.Ball, {"grade": "G21"}, "Did you mean 'G20'"),
        (lb.Ball, {"grade": "G20", "sphericity_um": 0.5}, "got both"),
        (lb.Ball, {"harmonics_um": [(2, 0.2, 35.0)]}, "harmonics_um alone"),
        (
            lb.Ball,
            ROUND | {"harmonics_um": [(2, 0.2, 35.0), (2, 0.1, 0.0)]},
            r"each order once, got \[2, 2\]",
        ),
        (lb.Instrument, {"bar_length_error_um": 1.0}, "must come with its U_um"),
    ],
)
def test_certificates_that_cannot_be_are_refused(
    kind: type, stated: dict[str, Any], message: str
) -> None:
    refuses(message, kind, **stated)
