"""Distances with which tilts of joints act on circles."""

from __future__ import annotations

from dataclasses import replace

import pytest
from campaigns import plan

import ldbb_bayes as lb
from ldbb_bayes.analysis.tilt_levers import largest_lever_mm

MODEL = lb.HybridModel.first(0)


def centred_at(*centres_mm: float) -> lb.Campaign:
    """The plan with its first circles at these places on X."""
    planned = plan()
    tests = list(planned.tests)
    for k, x_mm in enumerate(centres_mm):
        tests[k] = replace(tests[k], centre_x_mm=x_mm)
    return replace(planned, tests=tuple(tests))


def test_circles_at_zero_have_no_lever() -> None:
    assert largest_lever_mm(MODEL.bind(centred_at()), "Y") == 0.0


def test_the_farthest_centre_counts() -> None:
    assert largest_lever_mm(MODEL.bind(centred_at(100.0, -400.0)), "Y") == pytest.approx(400.0)


def test_a_joint_whose_tilts_are_not_in_the_model_has_no_lever() -> None:
    assert largest_lever_mm(MODEL.bind(centred_at(100.0, -400.0)), "X") == 0.0


def test_the_distance_is_from_the_frame_of_the_joint() -> None:
    framed = replace(centred_at(), frames_mm={"Y": (300.0, 0.0, 50.0)})
    assert largest_lever_mm(MODEL.bind(framed), "Y") == pytest.approx(300.0)
