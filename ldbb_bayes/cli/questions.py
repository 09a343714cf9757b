"""Questions that ``ldbb-bayes`` asks at a terminal, about files, machine, mount and balls.

A question is asked if files and options leave something open. For example, the files may not show
which of two units the readings have, or whether the readings are compensated for the deflection of
the mount, the part that holds the work ball.
"""

from __future__ import annotations

import shutil
import sys
from collections.abc import Callable, Collection, Sequence
from dataclasses import replace
from typing import Any, NamedTuple

import typer

import ldbb_bayes as lb
from ldbb_bayes.cli.layout_options import LAYOUT_FLAGS
from ldbb_bayes.cli.options import CATALOGUE
from ldbb_bayes.cli.values import ball_in
from ldbb_bayes.errors import InputError, require
from ldbb_bayes.reading.import_result import Imported
from ldbb_bayes.reading.open_question import OpenQuestionError
from ldbb_bayes.results import wrapped

__all__ = ["MACHINES", "MachineType", "can_ask", "complete_campaign", "import_with_answers"]


class MachineType(NamedTuple):
    """A type of machine tool: its name, its topology, and the axes that move workpiece and tool."""

    #: Kind of machine tool in words, such as C-frame.
    name: str
    #: Topology of the machine tool: its axes from workpiece to tool, such as wCAFYXZSt.
    topology: str
    #: Text that says which axes of the machine tool move the workpiece, and which move the tool.
    looks: str


# Types of machine tools from which the user can choose.
MACHINES = tuple(MachineType(**entry) for entry in CATALOGUE["machines"])
# Meaning of the answers to a yes-or-no question, in English and German.
_ANSWERS = {"y": True, "yes": True, "j": True, "ja": True, "n": False, "no": False, "nein": False}


def can_ask() -> bool:
    """Return whether a user can answer questions: whether stdin and stderr are a terminal."""
    return sys.stdin is not None and sys.stdin.isatty() and sys.stderr.isatty()


def import_with_answers(
    import_with: Callable[[lb.reading.Layout], Imported], layout: lb.reading.Layout, *, ask: bool
) -> Imported:
    """Import tables, and ask the user for the information that the tables do not give.

    The user is asked, for example, for the unit of the readings if two units are possible.

    Parameters
    ----------
    import_with
        Function that imports the tables with a layout.
    layout
        Layout of the tables according to options. The answers of the user complete this layout.
    ask
        Whether to ask the user. If false, tables that do not give all information are refused.

    Returns
    -------
    Imported

    Raises
    ------
    InputError
        If the tables cannot be read, or if they do not give all information and ``ask`` is false.
    """
    while True:
        try:
            return import_with(layout)
        except OpenQuestionError as question:
            if not ask:
                raise
            layout = _ask_what_is_open(question, layout)


def _ask_what_is_open(question: OpenQuestionError, layout: lb.reading.Layout) -> lb.reading.Layout:
    """Ask the user what the tables do not state, and return ``layout`` with the answer added.

    ``question`` says what is missing, such as the unit of the readings. ``layout`` says how the
    tables are to be read.
    """

    def read(answer: str) -> lb.reading.Layout:
        """Return a copy of ``layout``, completed with the user's answer to the question."""
        value: Any = answer
        if question.field == "sign" and answer in question.answers:
            value = int(answer)
        return layout.with_given({question.field: value}, LAYOUT_FLAGS)

    typer.echo(str(question), err=True)
    completed: lb.reading.Layout = _ask(", ".join(question.answers), "", read)
    return completed


def complete_campaign(campaign: lb.Campaign, unstated: Collection[str]) -> lb.Campaign:
    """Ask the user about machine, mount and balls, and return the campaign with the answers.

    Parameters
    ----------
    campaign
        The campaign as read from files.
    unstated
        What the user is asked about, because neither the files nor the options give it: one or
        several of the names ``topology``, ``mount`` and ``balls``.

    Returns
    -------
    Campaign
        The campaign with the topology, the mount and the balls that the user stated.
    """
    if "topology" in unstated:
        topology = _ask_topology(campaign.machine().planes)
        if topology != campaign.topology:
            campaign = replace(campaign, topology=topology, frames_mm={})
    if "mount" in unstated:
        question = "Are the readings compensated for the mount of the work ball? (y/n)"
        if not _ask(question, "y", _read_yes_or_no):
            campaign = replace(campaign, mount=replace(campaign.mount, compensated=False))
    if "balls" in unstated:
        question = (
            "Grade of the balls, G3 to G200, or deviation from sphericity, for example 0.5um"
            " (Enter: not known)"
        )
        ball = _ask(question, "", _read_ball)
        if ball is not None:
            instrument = replace(campaign.instrument, work=ball, tool=ball)
            campaign = replace(campaign, instrument=instrument)
    return campaign


def _ask_topology(planes: Sequence[str]) -> str:
    """Ask the user for the topology of the machine, and return the topology.

    The question is repeated until the user states a machine that can move in all ``planes`` of the
    tests.
    """

    def read(answer: str) -> str:
        """Return the topology of the machine from the user's typed answer."""
        return _read_topology(answer, planes)

    typer.echo("What does the machine look like?", err=True)
    for line in _lines_of_machines(shutil.get_terminal_size().columns):
        typer.echo(line, err=True)
    question = f"Its number, or its joints from workpiece to tool (plane {', '.join(planes)})"
    topology: str = _ask(question, "1", read)
    return topology


def _lines_of_machines(width: int) -> list[str]:
    """Return the list `MACHINES` as numbered lines of at most ``width`` characters."""
    lines = []
    for number, machine in enumerate(MACHINES, start=1):
        text = f"{machine.name} ({machine.topology}): {machine.looks}"
        lines += wrapped(text, width, f"  {number}  ", "     ")
    return lines


def _ask(question: str, default: str, read: Callable[[str], Any]) -> Any:
    """Ask the user a question until the answer is valid, and return the converted answer.

    ``default`` is the answer if the user only presses Enter. ``read`` is the function that converts
    the typed answer and raises an `InputError` if it is not valid.
    """
    while True:
        answer = typer.prompt(question, default=default, err=True, show_default=bool(default))
        try:
            return read(str(answer).strip())
        except InputError as error:
            typer.echo(str(error), err=True)


def _read_topology(answer: str, planes: Sequence[str]) -> str:
    """Return the topology of a machine, given the user's answer.

    The answer is the number of a type of machine in the list `MACHINES`, counted from 1, or the
    topology itself. Raise an `InputError` for any other number, and for a machine that cannot move
    in the ``planes`` of the tests.
    """
    if not answer.isdecimal():
        return lb.Machine(answer, planes).topology
    number = int(answer)
    require(
        1 <= number <= len(MACHINES),
        f"a number must be 1 to {len(MACHINES)}, got {answer}. Or type the joints.",
    )
    return MACHINES[number - 1].topology


def _read_yes_or_no(answer: str) -> bool:
    """Return whether the user's answer to a yes-or-no question means yes."""
    require(
        answer.casefold() in _ANSWERS,
        f"the answer must be y or n, got {answer!r}. Type one of them.",
    )
    return _ANSWERS[answer.casefold()]


def _read_ball(answer: str) -> lb.Ball | None:
    """Return the ball that the user describes by its grade or its deviation from sphericity.

    ``answer`` is the typed description. Return None if it is empty.
    """
    if not answer:
        return None
    return ball_in(answer, "the grade")
