"""Tables of campaigns: what `print` shows of their tests."""

from __future__ import annotations

from dataclasses import replace

import pytest
from campaigns import plan


@pytest.mark.parametrize(
    ("radii_mm", "text"), [((100.0,) * 4, "R = 100 mm"), ((150.0, 100.0) * 2, "R = 100, 150 mm")]
)
def test_a_campaign_states_the_radii_of_its_tests(radii_mm: tuple[float, ...], text: str) -> None:
    tests = []
    for test, radius_mm in zip(plan().tests, radii_mm, strict=True):
        tests.append(replace(test, radius_mm=radius_mm))
    printed = " ".join(str(replace(plan(), tests=tuple(tests))).split())
    assert f"plane XY, {text} " in printed
