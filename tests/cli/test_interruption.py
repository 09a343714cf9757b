"""Ctrl-C ends the program with one line and exit code 130, whatever a library makes of it."""

from __future__ import annotations

import signal
from collections.abc import Callable, Iterator

import pytest
from pydantic_core import SchemaError, SchemaValidator, core_schema

from ldbb_bayes import __main__ as program

LINE = "ldbb-bayes: interrupted; nothing is half-written.\n"


@pytest.fixture(autouse=True)
def usual_handler() -> Iterator[None]:
    """The handler of Ctrl-C that Python has when it starts."""
    before = signal.signal(signal.SIGINT, signal.default_int_handler)
    yield
    signal.signal(signal.SIGINT, before)


class _PressesInInstanceCheck(type):
    def __instancecheck__(cls, _: object) -> bool:
        signal.raise_signal(signal.SIGINT)
        return False


class _Checked(metaclass=_PressesInInstanceCheck):
    """Pydantic asks for instances of this class while it makes a validator."""


class _Hashed:
    def __hash__(self) -> int:
        signal.raise_signal(signal.SIGINT)
        return 1


def make_validator_that_fails() -> None:
    SchemaValidator(core_schema.is_instance_schema(_Checked))


def make_validator_all_the_same() -> None:
    SchemaValidator(core_schema.literal_schema([_Hashed()]))


def test_pydantic_turns_an_interruption_into_an_error_of_its_own() -> None:
    with pytest.raises(SchemaError):
        make_validator_that_fails()


def test_pydantic_passes_over_an_interruption() -> None:
    make_validator_all_the_same()


@pytest.mark.parametrize("make", [make_validator_that_fails, make_validator_all_the_same])
def test_an_interruption_while_commands_are_loaded(
    make: Callable[[], None], monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    def load() -> Callable[[], None]:
        make()
        return lambda: None

    monkeypatch.setattr(program, "_load_commands", load)
    with pytest.raises(SystemExit) as ended:
        program.run()
    assert ended.value.code == 130
    assert capsys.readouterr() == ("", LINE)


def test_an_interruption_while_a_command_runs(
    monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    monkeypatch.setattr(program, "_load_commands", lambda: make_validator_that_fails)
    with pytest.raises(SystemExit) as ended:
        program.run()
    assert ended.value.code == 130
    assert capsys.readouterr() == ("", LINE)


def test_an_error_without_an_interruption_stays_one(monkeypatch: pytest.MonkeyPatch) -> None:
    def fail() -> None:
        raise RuntimeError("a fault")

    monkeypatch.setattr(program, "_load_commands", lambda: fail)
    with pytest.raises(RuntimeError, match="a fault"):
        program.run()


def test_where_ctrl_c_is_ignored_it_stays_so(monkeypatch: pytest.MonkeyPatch) -> None:
    signal.signal(signal.SIGINT, signal.SIG_IGN)
    monkeypatch.setattr(program, "_load_commands", lambda: lambda: None)
    program.run()
    assert signal.getsignal(signal.SIGINT) is signal.SIG_IGN
