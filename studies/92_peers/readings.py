"""What every method of the comparison is given, and what it answers.

A method takes a campaign and answers with 95 % intervals of the parameters. Given a circle that is
not among the tests of the campaign, it answers with a 95 % band and the density of every reading of
that circle too.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

import ldbb_bayes as lb

__all__ = [
    "LEVELS",
    "MODEL",
    "READINGS_OF_A_CIRCLE",
    "SETUP_UM",
    "Answer",
    "Array",
    "Budget",
    "CirclePrediction",
    "Readings",
    "evenly_picked",
    "picked_readings_um",
    "readings_of",
]

Array = NDArray[np.float64]

MODEL = lb.HybridModel.default(1)
# Ends of a 95 % interval.
LEVELS = np.array([0.025, 0.975])
# Readings of a circle that the Gaussian process is given, and that every method predicts.
READINGS_OF_A_CIRCLE = 36
# Scale of the shifts of zero and centre from circle to circle [µm].
SETUP_UM = MODEL.prior.delta_um
# Geometric errors are the last columns of J.
GEOMETRIC_ERRORS = 7
# From the smallest force to the largest [N].
FORCE_RANGE_N = 706.0
# Step of the central difference of J along the angle [rad].
STEP_RAD = 1e-4
UM_PER_MM = 1e3


@dataclass(frozen=True, eq=False)
class CirclePrediction:
    """What a method says of a circle that was left out.

    Attributes
    ----------
    band_um : array, shape (2, n)
        95 % band [µm].
    log_density : array, shape (n,)
        Log density of every reading [nat, per µm].
    """

    band_um: Array
    log_density: Array


class Answer(NamedTuple):
    """What a method says of a campaign.

    ``interval``, shape (2, p), holds the 95 % intervals of the parameters [mm, N, rad];
    ``circle`` is the prediction of the circle that was asked for, if any.
    """

    interval: Array
    circle: CirclePrediction | None


class Budget(NamedTuple):
    """What one standard uncertainty of every line of a budget adds to the readings [µm].

    ``shared``, shape (n, q), is common to all circles; ``by_circle``, shape (n, k), is independent
    from circle to circle.
    """

    shared: Array
    by_circle: Array


@dataclass(frozen=True, eq=False)
class Readings:
    """Readings of several tests one below the other, with the conditions they were taken under.

    Attributes
    ----------
    reading_um, angle_rad, force_N, pressure_bar : arrays, shape (n,)
    test : array of int, shape (n,)
        Position of the test that a reading belongs to.
    jacobian : array, shape (n, p)
        J of the hybrid model [µm per prior sd].
    jacobian_slope : array, shape (n, p)
        Its derivative along the angle [µm per prior sd and rad].
    """

    reading_um: Array
    angle_rad: Array
    force_N: Array
    pressure_bar: Array
    test: NDArray[np.int64]
    jacobian: Array
    jacobian_slope: Array

    def deflection_um(self, theta: Array) -> Array:
        """What compliances and their slopes, the first columns of J, add, shape (n,) [µm]."""
        elastic = self.jacobian.shape[1] - GEOMETRIC_ERRORS
        return np.asarray(self.jacobian[:, :elastic] @ theta[:elastic])

    def budget(self, campaign: lb.Campaign, theta: Array, *, full: bool) -> Budget:
        """Return the budget of the instrument about the parameters ``theta``.

        The short budget has bar length, mount and force. The full one has every line of
        `lb.terms.uncertainties`, and how far zero and centre move between circles.
        """
        sd = {line.name: line.sd for line in lb.terms.uncertainties(campaign).assumed}
        deflection_um = self.deflection_um(theta)
        shared = [
            UM_PER_MM * sd["bar_length"] * np.ones(len(deflection_um)),
            UM_PER_MM * sd["mount"] * self.pressure_bar,
            sd["force_gain"] * deflection_um,
        ]
        by_circle = [sd["force_random"] * (deflection_um / self.force_N)]
        if full:
            largest_force_N = float(campaign.forces_N.max())
            shared += self._curvatures(sd, deflection_um, largest_force_N)
            shared.append(self._error_of_angle(sd, theta))
            shared += self._forms_of_balls(sd)
            by_circle += [
                SETUP_UM * np.ones(len(deflection_um)),
                SETUP_UM * np.cos(self.angle_rad),
                SETUP_UM * np.sin(self.angle_rad),
            ]
        return Budget(np.column_stack(shared), np.column_stack(by_circle))

    def _curvatures(
        self, sd: dict[str, float], deflection_um: Array, largest_force_N: float
    ) -> list[Array]:
        """Curvature of the mount and of the force, zero at no force and at the largest [µm]."""
        bow = 4.0 * self.force_N / largest_force_N * (1.0 - self.force_N / largest_force_N)
        softness = deflection_um / self.force_N
        return [
            UM_PER_MM * sd["mount_curvature"] * bow,
            sd["force_curvature"] * largest_force_N * bow * softness,
        ]

    def _error_of_angle(self, sd: dict[str, float], theta: Array) -> Array:
        """Error of the angle's reference, and its lag [µm].

        Circles that state no direction lag as the reference is off, for all run the same way.
        """
        return np.asarray(
            np.hypot(sd["angle_reference"], sd["angle_lag"]) * (self.jacobian_slope @ theta)
        )

    def _forms_of_balls(self, sd: dict[str, float]) -> list[Array]:
        """Form of both balls at the orders 2 and 3, cosine and sine [µm]."""
        columns = []
        for order in (2, 3):
            size_um = UM_PER_MM * np.hypot(sd[f"work_form_{order}"], sd[f"tool_form_{order}"])
            columns.append(size_um * np.cos(order * self.angle_rad))
            columns.append(size_um * np.sin(order * self.angle_rad))
        return columns

    def separated_by_test(self, by_circle: Array) -> Array:
        """Columns (n, k) repeated for every test and zero elsewhere, shape (n, k · tests)."""
        in_test = self.test[:, None] == np.arange(self.test.max() + 1)
        columns = by_circle[:, :, None] * in_test[:, None, :]
        return np.asarray(columns.reshape(len(by_circle), -1))

    def coordinates(self) -> Array:
        """Where the Gaussian process sees the readings, shape (n, 3).

        Angles lie on the unit circle, and the range of forces is one radius long.
        """
        return np.column_stack(
            [np.cos(self.angle_rad), np.sin(self.angle_rad), self.force_N / FORCE_RANGE_N]
        )


def evenly_picked(test: lb.CircularTest, count: int = READINGS_OF_A_CIRCLE) -> NDArray[np.int64]:
    """Return the positions of ``count`` readings of a circle, evenly picked."""
    return np.arange(count) * len(test.angle_deg) // count


def picked_readings_um(test: lb.CircularTest) -> Array:
    """Return the readings of a circle that every method predicts [µm]."""
    return np.asarray(test.reading_um)[evenly_picked(test)]


def readings_of(
    campaign: lb.Campaign,
    tests: tuple[lb.CircularTest, ...],
    prior_sd: Array,
    count: int | None = None,
) -> Readings:
    """Return ``count`` readings of every test, or all of them.

    Slopes of compliances turn about mid-range of the campaign's forces.
    """
    middle_N = 0.5 * float(campaign.forces_N.min() + campaign.forces_N.max())
    blocks = []
    for number, test in enumerate(tests):
        if count is None:
            index = np.arange(len(test.angle_deg))
        else:
            index = evenly_picked(test, count)
        angle_rad = np.deg2rad(test.angle_deg[index])
        force_N = float(test.force_N or 0.0)
        blocks.append(
            Readings(
                reading_um=np.asarray(test.reading_um)[index],
                angle_rad=angle_rad,
                force_N=np.full(len(index), force_N),
                pressure_bar=np.full(len(index), _pressure_bar(test, force_N)),
                test=np.full(len(index), number),
                jacobian=_jacobian(campaign, test, angle_rad, middle_N) * prior_sd * UM_PER_MM,
                jacobian_slope=(
                    _jacobian_slope(campaign, test, angle_rad, middle_N) * prior_sd * UM_PER_MM
                ),
            )
        )
    return _joined(blocks)


def _pressure_bar(test: lb.CircularTest, force_N: float) -> float:
    """The pressure that a test states, or that which gives its force [bar]."""
    if test.pressure_bar is None:
        return lb.campaign.ForceLaw().pressure_bar(force_N)
    return test.pressure_bar


def _jacobian(
    campaign: lb.Campaign, test: lb.CircularTest, angle_rad: Array, middle_N: float
) -> Array:
    """J of the hybrid model with linear compliances, shape (n, p) [mm per unit]."""
    return np.asarray(
        lb.machine.hybrid_jacobian(
            campaign.machine(),
            test.circle,
            angle_rad,
            float(test.force_N or 0.0),
            degree=1,
            reference_force_N=middle_N,
        ).to_numpy()
    )


def _jacobian_slope(
    campaign: lb.Campaign, test: lb.CircularTest, angle_rad: Array, middle_N: float
) -> Array:
    """Derivative of J along the angle, by central differences, shape (n, p) [mm per unit, rad]."""
    ahead = _jacobian(campaign, test, angle_rad + STEP_RAD, middle_N)
    behind = _jacobian(campaign, test, angle_rad - STEP_RAD, middle_N)
    return np.asarray((ahead - behind) / (2.0 * STEP_RAD))


def _joined(blocks: list[Readings]) -> Readings:
    """The readings of several tests, one below the other."""
    return Readings(
        reading_um=np.concatenate([block.reading_um for block in blocks]),
        angle_rad=np.concatenate([block.angle_rad for block in blocks]),
        force_N=np.concatenate([block.force_N for block in blocks]),
        pressure_bar=np.concatenate([block.pressure_bar for block in blocks]),
        test=np.concatenate([block.test for block in blocks]),
        jacobian=np.concatenate([block.jacobian for block in blocks]),
        jacobian_slope=np.concatenate([block.jacobian_slope for block in blocks]),
    )
