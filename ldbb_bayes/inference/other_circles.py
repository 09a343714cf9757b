"""Effects that a fit has learnt on its circles, carried to circles at other places of the machine.

`Position` describes how the compliance of an axis changes along its travel, in units of the radius
and about the centre of the measured circle. On a circle of another centre or radius, the axis moves
over another part of its travel, and the same change of its compliance acts differently.
"""

from __future__ import annotations

from dataclasses import replace
from typing import NamedTuple

import numpy as np

from ldbb_bayes.campaign.circular_test import CircularTest
from ldbb_bayes.inference.coefficients import shared_terms
from ldbb_bayes.model.hybrid import BoundModel
from ldbb_bayes.model.terms import Columns
from ldbb_bayes.model.terms.joints import Position, compliance_along_travel
from ldbb_bayes.results import Array

__all__ = ["shared_terms_of_plan"]


class _Places(NamedTuple):
    """Where planned circles lie, as seen from the measured circles nearest to them."""

    #: shift of each centre along X, Y and Z, in radii of the measured circle, shape (tests, 3)
    shift: Array
    ratio: Array  #: radius of each planned circle, in radii of the measured circle, shape (tests,)


def shared_terms_of_plan(measured: BoundModel, planned: BoundModel) -> list[Columns]:
    """Return the shared nuisances of planned tests, in terms of the coefficients that a fit learnt.

    Shared nuisances are effects that are modelled but not of interest and that are common to
    several tests. Their columns are those of the planned tests, except for `Position`. Its
    coefficients belong to the measured circle of the same plane whose centre is nearest to that of
    the planned circle; of equally near circles, the one with the most similar radius is taken.

    Parameters
    ----------
    measured, planned : BoundModel
        The model applied to the measured and to the planned tests.

    Returns
    -------
    list of Columns
    """
    setting = planned.setting
    places = _places_of(_tests_of(planned), _tests_of(measured))
    letters = {"XYZ"[axis]: axis for axis, _ in setting.driven_axes()}
    terms = []
    for term in shared_terms(planned.nuisance_columns):
        if term.names[0].startswith(f"{Position.stem}_"):
            axis = letters[term.names[0].split("_")[1]]
            values = compliance_along_travel(
                setting, axis, shift=places.shift[:, axis], ratio=places.ratio
            )
            term = replace(term, values=values)
        terms.append(term)
    return terms


def _tests_of(bound: BoundModel) -> list[CircularTest]:
    """Return the tests that a model is applied to, which may be a part of its campaign."""
    tests = {test.name: test for test in bound.campaign.tests}
    return [tests[name] for name in bound.test_names]


def _places_of(planned: list[CircularTest], measured: list[CircularTest]) -> _Places:
    """Return where each planned circle lies, as seen from the measured circle nearest to it."""
    shifts = []
    ratios = []
    for test in planned:
        in_plane = [entry for entry in measured if entry.plane == test.plane]
        nearest = min(in_plane or measured, key=lambda entry: _distances(entry, test))
        radius_mm = nearest.circle.radius_mm
        shifts.append(_from_centre_to_centre(nearest, test) / radius_mm)
        ratios.append(test.circle.radius_mm / radius_mm)
    return _Places(np.array(shifts), np.array(ratios))


def _from_centre_to_centre(first: CircularTest, second: CircularTest) -> Array:
    """Return the vector from the centre of the first circle to that of the second [mm], (3,)."""
    return np.asarray(second.circle.centre_mm) - np.asarray(first.circle.centre_mm)


def _distances(first: CircularTest, second: CircularTest) -> tuple[float, float]:
    """Return the distance of two centres, and the difference of two radii [mm]."""
    distance = float(np.linalg.norm(_from_centre_to_centre(first, second)))
    return distance, abs(first.circle.radius_mm - second.circle.radius_mm)
