"""Units, radii, forces and conventions of field files changed at random: what is accepted is true,
or a note names the very quantity that was changed, with the value that was assumed."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path

import field_mutations
import mutation_outcomes
import numpy as np
import pytest
from field_mutations import Meaning, Mutation, WrittenCircle

N_MUTATIONS = 40


@pytest.mark.parametrize("seed", range(4))
def test_no_mutation_is_misread_in_silence(seed: int, tmp_path: Path) -> None:
    random = np.random.default_rng(seed)
    for _ in range(N_MUTATIONS):
        mutated = field_mutations.mutation(random)
        became = mutation_outcomes.outcome(tmp_path, mutated)
        assert not became.startswith("silent"), mutated.description


@pytest.mark.slow
def test_no_mutation_among_thousands_is_misread_in_silence(tmp_path: Path) -> None:
    random = np.random.default_rng(5)
    for _ in range(3000):
        mutated = field_mutations.mutation(random)
        became = mutation_outcomes.outcome(tmp_path, mutated)
        assert not became.startswith("silent"), mutated.description


def one_file(header: str, meaning: Meaning, stated: frozenset[str] = frozenset()) -> Mutation:
    """Return the first circle in a file of its own, with its true meaning."""
    circle = field_mutations.TRUTH[0]
    name = f"{circle.force_N:g}N.csv"
    rows = [header]
    for angle, reading in zip(circle.angle_deg, circle.reading_um, strict=True):
        rows.append(f"{angle:g};{reading:.3f}")
    content = "\n".join([*rows, ""]).encode()
    written = WrittenCircle(name, circle.force_N, circle.angle_deg, circle.reading_um, meaning)
    return Mutation("", {name: content}, (written,), stated)


def test_a_true_file_is_true(tmp_path: Path) -> None:
    mutated = one_file("Angle [deg];Reading [um]", Meaning(1.0))
    assert mutation_outcomes.outcome(tmp_path, mutated) == "true"


def log_over_time(start: str, meaning: Meaning) -> Mutation:
    """Return the first circle as a log over time at 1500 mm/min, with its true meaning."""
    circle = field_mutations.TRUTH[0]
    name = f"{circle.force_N:g}N.csv"
    seconds = np.deg2rad(circle.angle_deg) * 150.0 / 25.0
    rows = ["Feed: 1500 mm/min", start, "Time [s];Reading [um]"]
    for time, reading in zip(seconds, circle.reading_um, strict=True):
        rows.append(f"{time:.6f};{reading:.3f}")
    content = "\n".join([*rows, ""]).encode()
    written = WrittenCircle(name, circle.force_N, seconds, circle.reading_um, meaning)
    return Mutation("", {name: content}, (written,), frozenset())


def test_a_log_that_starts_at_an_axis_is_true(tmp_path: Path) -> None:
    mutated = log_over_time("Start at +Y", Meaning(1.0, zero_deg=90.0, feed_mm_per_min=1500.0))
    assert mutation_outcomes.outcome(tmp_path, mutated) == "true"


def test_a_log_whose_feed_a_note_names_is_told(tmp_path: Path) -> None:
    mutated = log_over_time("Start: 0°", Meaning(1.0, feed_mm_per_min=1600.0))
    assert mutation_outcomes.outcome(tmp_path, mutated).startswith("told")


def test_a_log_of_another_unit_of_time_without_a_note_is_silent(tmp_path: Path) -> None:
    meaning = Meaning(1.0, feed_mm_per_min=1500.0, s_per_time=1.1)
    mutated = log_over_time("Start: 0°", meaning)
    assert mutation_outcomes.outcome(tmp_path, mutated).startswith("silent")


def test_a_wrong_guess_that_a_note_names_is_told(tmp_path: Path) -> None:
    mutated = one_file("Angle [deg];Reading", Meaning(0.1))
    assert mutation_outcomes.outcome(tmp_path, mutated) == "told: reading_um"


def test_a_note_on_another_quantity_does_not_count(tmp_path: Path) -> None:
    mutated = one_file("Angle [deg];Reading", Meaning(1.0, sense=-1))
    assert mutation_outcomes.outcome(tmp_path, mutated) == "silent: reading_um"


def test_a_note_with_another_value_does_not_count(tmp_path: Path) -> None:
    mutated = one_file("Angle [deg];Reading", Meaning(1.0))
    doubled = replace(mutated.circles[0], reading=2.0 * mutated.circles[0].reading)
    mutated = replace(mutated, circles=(doubled,))
    assert mutation_outcomes.outcome(tmp_path, mutated) == "silent: reading_um"


def test_a_note_that_passes_over_what_the_file_states_does_not_count(tmp_path: Path) -> None:
    stated = frozenset({"unit of the reading"})
    mutated = one_file("Angle [deg];Reading", Meaning(0.1), stated)
    became = mutation_outcomes.outcome(tmp_path, mutated)
    assert became == "silent, passed over: unit of the reading"
