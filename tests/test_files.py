"""Written whole or not at all: stopped at any moment, the disk full, two at once."""

from __future__ import annotations

import os
import re
import time
from collections.abc import Callable, Iterator
from concurrent.futures import ThreadPoolExecutor
from contextlib import suppress
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from campaigns import Invoke, full_disk, refuses
from pydantic import BaseModel, model_validator
from pydantic.dataclasses import dataclass

import ldbb_bayes as lb
from ldbb_bayes.campaign.folder import write_campaign_into
from ldbb_bayes.files import check_target, parse_toml, staged_folder, write_whole
from ldbb_bayes.files.similar_names import advice_on_path
from ldbb_bayes.files.validation import raises_input_error, validated


def refuse_different_numbers(pair: Any) -> Any:
    if pair.a != pair.b:
        raise ValueError("a and b differ")
    return pair


class Pair(BaseModel):
    """Content whose two numbers must agree."""

    a: int
    b: int

    agree = model_validator(mode="after")(refuse_different_numbers)


@raises_input_error("pair")
@dataclass
class PairOfArguments:
    """Arguments that must agree."""

    a: int
    b: int

    agree = model_validator(mode="after")(refuse_different_numbers)


FILES = {"campaign.toml", "f036.csv", "f389.csv", "f742.csv"}


def campaign(version: int) -> lb.Campaign:
    angle = np.arange(72) * 5.0
    tests = tuple(
        lb.CircularTest(force, angle, float(version) + 0.1 * np.cos(angle))
        for force in (36.0, 389.0, 742.0)
    )
    return lb.Campaign(tests, name=f"version {version}")


def version_of(folder: Path) -> int:
    """Which version stands there, whole; a mixture fails."""
    read = lb.read_campaign(folder)
    version = int(read.name.removeprefix("version "))
    assert {path.name for path in folder.iterdir()} == FILES
    assert read.sha256 == campaign(version).sha256
    return version


def refuse_once(
    call: Callable[..., object], calls: Iterator[int], moment: int
) -> Callable[..., object]:
    """Return a call that fails as on a full disk when the count of calls is at a moment."""

    def refuse(*arguments: object, **options: object) -> object:
        if next(calls) == moment:
            raise OSError(28, os.strerror(28))
        return call(*arguments, **options)

    return refuse


@pytest.mark.parametrize("call", ["mkdir", "rename", "chmod"])
def test_stopped_at_any_moment_the_old_result_or_the_new_one_stands(
    call: str, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    """Every call refuses once, one after the other, as on a full disk; nothing lies about."""
    lb.write_campaign(campaign(0), tmp_path / "result")
    call_of_os = getattr(os, call)
    stands = 0
    for moment in range(1, 30):
        calls = iter(range(1, 1000))

        monkeypatch.setattr(os, call, refuse_once(call_of_os, calls, moment))
        with suppress(lb.InputError):
            lb.write_campaign(campaign(moment), tmp_path / "result", force=True)
        monkeypatch.undo()
        assert version_of(tmp_path / "result") in (stands, moment)
        assert [path.name for path in tmp_path.iterdir()] == ["result"]
        stands = version_of(tmp_path / "result")
        if next(calls) <= moment:
            break
    assert moment > 1


def test_a_full_disk_keeps_the_old_result_and_the_old_file(tmp_path: Path) -> None:
    lb.write_campaign(campaign(1), tmp_path / "result")
    write_whole(tmp_path / "posterior.nc", bytes(1000))
    with (
        full_disk(300),
        pytest.raises(lb.InputError, match=r"result must be writable, got: .*Free some space"),
    ):
        lb.write_campaign(campaign(2), tmp_path / "result", force=True)
    for largest in (0, 500, 999):
        with (
            full_disk(largest),
            pytest.raises(
                lb.InputError, match=r"posterior\.nc must be writable, got: .*Free some space"
            ),
        ):
            write_whole(tmp_path / "posterior.nc", bytes(range(250)) * 4)
        assert (tmp_path / "posterior.nc").read_bytes() == bytes(1000)
    assert version_of(tmp_path / "result") == 1
    assert {path.name for path in tmp_path.iterdir()} == {"result", "posterior.nc"}


def test_of_two_runs_into_one_new_folder_the_second_is_refused(tmp_path: Path) -> None:
    """Without --force nobody's result is replaced, even if it came while this one was at work."""
    target = tmp_path / "result"
    first_run = staged_folder(target, force=False)
    (first_run.__enter__() / "mine").write_text("2")
    with staged_folder(target, force=False) as other:
        (other / "theirs").write_text("1")
    refuses("another run wrote meanwhile", first_run.__exit__, None, None, None)
    assert [path.name for path in target.iterdir()] == ["theirs"]


def test_runs_into_one_folder_at_once(tmp_path: Path) -> None:
    """In the end it is one of theirs, whole, and nothing is left beside it."""

    def replace(k: int) -> None:
        with staged_folder(tmp_path / "result", force=True, ours=FILES) as staging:
            write_campaign_into(campaign(2 + k % 4), staging)

    with ThreadPoolExecutor(4) as threads:
        list(threads.map(replace, range(40)))
        list(threads.map(lambda _: write_whole(tmp_path / "one", bytes(20_000)), range(100)))
    assert version_of(tmp_path / "result") in (2, 3, 4, 5)
    assert {path.name for path in tmp_path.iterdir()} == {"result", "one"}
    assert (tmp_path / "one").read_bytes() == bytes(20_000)


def test_a_folder_that_another_run_takes_away_between_two_renames(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    """It was there when this run came, and is not when this run looks again."""
    rename = os.rename
    moments = iter([OSError(39, "Directory not empty")])

    def taken_away(source: str, target: str) -> None:
        for error in moments:
            raise error
        rename(source, target)

    monkeypatch.setattr(os, "rename", taken_away)
    lb.write_campaign(campaign(3), tmp_path / "result", force=True)
    assert version_of(tmp_path / "result") == 3


def test_a_link_to_itself_is_refused(tmp_path: Path) -> None:
    loop = tmp_path / "loop"
    loop.symlink_to(loop)
    with pytest.raises(lb.InputError, match="leads nowhere"), staged_folder(loop, force=True):
        pass


def test_a_link_to_a_place_that_cannot_be_written_is_refused_before_the_work(
    tmp_path: Path,
) -> None:
    (tmp_path / "file").write_text("no folder")
    link = tmp_path / "link"
    link.symlink_to(tmp_path / "file" / "deep" / "result")
    refuses("link must be writable", check_target, link, force=False)


def test_a_link_to_a_folder_that_is_still_missing_is_followed(tmp_path: Path) -> None:
    link = tmp_path / "link"
    link.symlink_to(tmp_path / "new" / "result")
    lb.write_campaign(campaign(1), link)
    assert version_of(tmp_path / "new" / "result") == 1


def test_an_error_of_the_whole_content_names_the_file() -> None:
    message = r"pair\.toml: content must be valid, got {'a': 1, 'b': 2}: a and b differ"
    refuses(message, validated, Pair, {"a": 1, "b": 2}, "pair.toml")


def test_an_error_of_all_arguments_names_the_object() -> None:
    refuses("pair: arguments must be valid, got .*: a and b differ", PairOfArguments, a=1, b=2)


DEEP = "a.b.c.d.e.f.g.h.i"


@pytest.mark.parametrize(
    "text",
    [
        'note = "serial 1.2.3.4.5.6.7.8.9"',
        f"note = '{DEEP}'",
        f"# {DEEP}\nnote = 1",
        f'note = 1 # "{DEEP}',
        f'note = """\n{DEEP} = 1\n"""',
        f'note = """\n\\"""{DEEP} = 1\n"""',
        f'note = """a""""" # {DEEP}',
        f"note = '''\n{DEEP} = 1\n'''",
    ],
)
def test_toml_strings_and_comments_may_hold_many_dots(text: str) -> None:
    assert list(parse_toml(text, "notes")) == ["note"]


@pytest.mark.parametrize(
    "line",
    [
        f"{DEEP} = 1",
        f"[{DEEP}]",
        f"note = {{ {DEEP} = 1 }}",
        '"a".\'b\'.c."".e . f.g.h.i = 1',
    ],
)
def test_a_toml_key_of_many_parts_is_refused(line: str) -> None:
    shown = re.escape(f"notes, line 3: lines must be short and keys plain, got {line!r}. Correct")
    refuses(shown, parse_toml, f'first = """\n"""\n{line}\n', "notes")


def test_only_a_line_that_is_cut_off_ends_with_an_ellipsis() -> None:
    line = f"{DEEP} = {'1' * 40}"
    refuses(f"got {line[:40]!r}…. Correct", parse_toml, line, "notes")


@pytest.mark.parametrize("unit", ['"""', '\\"""', '"', "'", "'''", '"\\"', '""\\'])
def test_strings_without_end_are_refused_at_once(unit: str) -> None:
    start = time.perf_counter()
    line = f"note = {unit * (19_000 // len(unit))}"
    text = "\n".join([line] * 26)
    refuses("notes must be valid TOML", parse_toml, text, "notes")
    assert time.perf_counter() - start < 2.0


@pytest.mark.parametrize("command", ["identify", "report", "fit", "check"])
def test_a_command_names_the_nearest_file_where_there_is_none(
    command: str, tmp_path: Path, invoke: Invoke
) -> None:
    (tmp_path / "100N.csv").write_text("angle_deg,reading_um\n")
    code, _, stderr = invoke(command, tmp_path / "100n.cvs")
    assert code == 2
    assert f"Did you mean '{tmp_path / '100N.csv'}'?" in " ".join(stderr.split())


@pytest.mark.parametrize("command", ["identify", "report"])
def test_a_command_names_all_that_it_reads_where_there_is_no_file(
    command: str, tmp_path: Path, invoke: Invoke
) -> None:
    code, _, stderr = invoke(command, tmp_path / "nothing")
    assert code == 2
    for word in ("CSV", "XLSX", "XLS", "ODS", "campaign.toml", "of a fit"):
        assert word in stderr


def test_advice_on_a_path_names_the_first_folder_that_does_not_exist(tmp_path: Path) -> None:
    advice = advice_on_path(tmp_path / "a" / "b" / "c.csv")
    assert advice == f"There is no folder {tmp_path / 'a'}. Check the path."


def test_advice_on_a_path_names_no_file_that_is_called_otherwise(tmp_path: Path) -> None:
    (tmp_path / "36N.csv").touch()
    assert advice_on_path(tmp_path / "machine.xlsx") == "Check the path."


@pytest.mark.parametrize("force", [False, True])
def test_a_file_in_the_place_of_a_folder_is_not_offered_for_replacement(
    tmp_path: Path, force: bool
) -> None:
    """Without force the refusal proposed force, and with force it refused all the same."""
    (tmp_path / "report").write_text("notes", encoding="utf-8")
    staged = staged_folder(tmp_path / "report", force=force, ours=FILES)
    refuses(r"must be a folder, got a file\. Choose another name", staged.__enter__)
    assert (tmp_path / "report").read_text(encoding="utf-8") == "notes"
