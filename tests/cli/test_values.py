"""Values of options and answers to questions, as they are typed."""

from __future__ import annotations

import re
from dataclasses import replace

import pytest
from campaigns import refuses
from typer.models import CommandInfo

import ldbb_bayes as lb
from ldbb_bayes.cli import app
from ldbb_bayes.cli.chosen_model import model_options
from ldbb_bayes.cli.file_reports import _Analyses, _next_tests, _printed_annex
from ldbb_bayes.cli.goal_designs import running_order
from ldbb_bayes.cli.questions import _read_topology
from ldbb_bayes.cli.ranges import read_force_levels
from ldbb_bayes.cli.values import ball_in, directions_in


@pytest.mark.parametrize(
    ("entry", "values"),
    [
        ("0:0.3:0.1", (0.0, 0.1, 0.2, 0.3)),
        ("1000:1000.3:0.1", (1000.0, 1000.1, 1000.2, 1000.3)),
        ("0:1:0.4", (0.0, 0.4, 0.8, 1.0)),
        ("5:5:1", (5.0,)),
        ("0:1:3", (0.0, 1.0)),
    ],
)
def test_a_range_has_each_end_once(entry: str, values: tuple[float, ...]) -> None:
    assert read_force_levels(entry, "--forces-N") == pytest.approx(values, rel=1e-12)


def test_a_range_has_at_most_5000_values() -> None:
    assert len(read_force_levels("1:5000:1", "--forces-N")) == 5000
    message = "--forces-N must give at most 5000 values, got 5001. Take a longer step."
    refuses(message, read_force_levels, "0:5000:1", "--forces-N")
    refuses("got 5001", read_force_levels, "0:4999.5:1", "--forces-N")


def test_a_range_ends_exactly() -> None:
    assert read_force_levels("0:0.3:0.1", "--forces-N")[-1] == 0.3


@pytest.mark.parametrize(
    ("text", "sphericity_um"),
    [("0.5um", 0.5), ("0,5 µm", 0.5), (".5 μm", 0.5), ("500 nm", 0.5), ("0.0005 mm", 0.5)],
)
def test_a_ball_by_its_deviation_from_sphericity(text: str, sphericity_um: float) -> None:
    assert ball_in(text, "--balls") == lb.Ball(sphericity_um=sphericity_um)


@pytest.mark.parametrize(
    ("text", "directions"),
    [
        ("both", ("CW", "CCW")),
        ("CCW", ("CCW",)),
        ("ccw, cw", ("CCW", "CW")),
        ("CW,Both", ("CW", "CCW")),
        ("CW,CW", ("CW",)),
    ],
)
def test_directions_are_named_or_both(text: str, directions: tuple[str, ...]) -> None:
    assert directions_in(text, "--directions") == directions


@pytest.mark.parametrize("text", ["0.5", "5 N", "-", "1 2 um"])
def test_a_number_that_is_no_length_is_no_ball(text: str) -> None:
    refuses("--balls must be a grade like G20, or a deviation", ball_in, text, "--balls")


def test_a_topology_needs_the_axes_of_the_tested_planes() -> None:
    assert _read_topology("wFZYt", ("YZ",)) == "wFZYt"
    assert _read_topology("wFXZt", ("ZX",)) == "wFXZt"
    refuses("topology", _read_topology, "wFXYt", ("ZX",))


def test_help_of_without_lists_every_term() -> None:
    help_text = model_options()["without"].help
    for kind in lb.terms.Term.kinds.values():
        if kind.__module__.startswith("ldbb_bayes."):
            assert kind.key() in help_text
    assert "truncation" in help_text


def test_next_tests_are_listed_by_force_with_direction(recovered: lb.Campaign) -> None:
    test = recovered.plan().tests[0]
    one_plane = replace(
        recovered.plan(),
        tests=[
            replace(test, name="a", force_N=417.0, direction="CW"),
            replace(test, name="b", force_N=36.0, direction="CCW"),
        ],
    )
    assert _next_tests(one_plane) == (
        "Run next, in this order: 417 N (CW), 36 N (CCW). At these forces the readings are expected"
        " to tell most about the parameters."
    )


def test_tests_are_listed_with_plane_set_up_and_balls_where_they_differ(
    recovered: lb.Campaign,
) -> None:
    test = replace(recovered.plan().tests[0], force_N=417.0, direction="CW")
    two_planes = replace(
        recovered.plan(),
        tests=[
            replace(test, name="a", direction="CCW", work_ball_deg=45.0),
            replace(test, name="b", plane="YZ", setup=2),
        ],
        topology="wXFYZSt",
    )
    settings = ("plane XY, set-up 1, CCW, balls 45/0°", "plane YZ, set-up 2, CW, balls 0/0°")
    assert running_order(two_planes) == f"a ({settings[0]}), b ({settings[1]})"
    listed = f"Run next, in this order: 417 N ({settings[0]}), 417 N ({settings[1]}). At these"
    assert _next_tests(two_planes).startswith(listed)


@pytest.mark.parametrize("is_odd", [False, True])
def test_a_report_names_an_odd_circle_at_the_terminal(
    is_odd: bool, compared: lb.analysis.Comparison
) -> None:
    tests = {}
    for name, test in compared.tests.items():
        p_value = 0.001 if is_odd and name == "f490" else 0.5
        tests[name] = replace(test, lofo_family_wise_p_value=p_value, flag=p_value < 0.02)
    analyses = _Analyses(replace(compared, tests=tests), None, lambda: "No design.")
    first, *others = _printed_annex(analyses)
    assert "ln B(linear/constant)" in first
    assert others[-1] == "No design."
    assert len(others) == 1 + is_odd
    assert others[0].startswith("f490 does not belong with the others") is is_odd


@pytest.mark.parametrize("command", app.registered_commands, ids=lambda command: command.name)
def test_help_of_a_command_has_whole_sentences(command: CommandInfo) -> None:
    text = " ".join((command.callback.__doc__ or "").split())
    assert not re.search(r"(^|\. )(Exit code \d:|Prints|Says|Fits) ?", text)
