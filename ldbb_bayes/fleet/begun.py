"""What a batch is: its campaigns and options, written down before the first is fitted, and held against those of a resume."""

from __future__ import annotations

import hashlib
import json
import os
import re
import shutil
from collections.abc import Iterator, Mapping, Sequence
from contextlib import ExitStack, contextmanager
from dataclasses import asdict, is_dataclass
from pathlib import Path
from typing import Any

from ldbb_bayes.errors import InputError
from ldbb_bayes.files import bytes_of, write_whole
from ldbb_bayes.fleet.dataset import PART
from ldbb_bayes.fleet.gather import listed
from ldbb_bayes.fleet.hold import HOLD_FILES, alone_in
from ldbb_bayes.fleet.journal import JOURNAL_FILES
from ldbb_bayes.fleet.row import Settings
from ldbb_bayes.inference.sample import versions
from ldbb_bayes.model.spec import model_sha256

__all__ = ["BATCH_FILES", "DATASET", "JOURNAL", "POSTERIORS", "RECORD", "batch_record", "begin", "held"]

SCHEMA = 1
RECORD, LIST, JOURNAL, DATASET, POSTERIORS = "batch.json", "campaigns.txt", "journal", "campaigns.parquet", "posteriors"
BATCH_FILES = (RECORD, LIST, JOURNAL, DATASET, POSTERIORS, *HOLD_FILES)
_LARGEST_RECORD = 2**24
_SCRATCH = re.compile(rf"\.({re.escape(DATASET)}-[a-z0-9_]{{8}}(-old)?|.*\.part)")
# What may be in its folders; a killed run leaves scratch as well.
_INSIDE = {
    JOURNAL: re.compile("|".join(map(re.escape, JOURNAL_FILES))),
    DATASET: PART,
    POSTERIORS: re.compile(rf"\d{{7,}}-[0-9a-f]{{12}}\.nc|{_SCRATCH.pattern}"),
}
_MARK = re.compile(rf"{re.escape(HOLD_FILES[1])}-[0-9a-f]{{8}}")
_WORDS = {
    "ci_prob": "probability of the intervals",
    "compare": "comparison",
    "ess": "effective sample size",
    "prior_from": "population",
}


def batch_record(campaigns: Sequence[str], settings: Settings) -> dict[str, Any]:
    """What makes a batch what it is, plain enough for JSON; of relative paths also the folder they start from."""
    here = {} if all(map(os.path.isabs, campaigns)) else {"here": settings.here}
    return here | {
        "schema": SCHEMA,
        "campaigns": {"number": len(campaigns), "sha256": hashlib.sha256(listed(campaigns)).hexdigest(), "file": LIST},
        "model": {"sha256": model_sha256(settings.model), "toml": settings.model_toml},
        "options": {
            "sampler": settings.sampler,
            "seed": settings.seed,
            "ess": float(settings.ess),
            "ci_prob": float(settings.ci_prob),
            "compare": settings.compare,
            "posteriors": settings.posteriors is not None,
            "prior_from": None if settings.population is None else settings.population.sha256,
            "table": {name: _plain(value) for name, value in sorted(settings.table.items())},
        },
        "versions": versions(),
    }


@contextmanager
def held(out: Path) -> Iterator[None]:
    """Keep other runs from a folder, which is made if need be.

    Raises
    ------
    InputError
        When another run is at work there, it holds what no batch wrote, or it cannot be written.
    """
    if out.exists() and not out.is_dir():
        raise InputError(f"{out} must be a folder, got a file. Choose another name.")
    try:
        foreign = _foreign(out) if out.exists() else None
        if foreign is not None:
            raise InputError(f"{out} must hold nothing but a batch, got {foreign!r}. Move it away or choose another name.")
        made = not out.exists()
        out.mkdir(parents=True, exist_ok=True)
        with ExitStack() as stack:
            stack.enter_context(alone_in(out))
            release = stack.pop_all()
    except OSError as error:
        raise InputError(f"{out} must be writable, got: {error.strerror}. Choose another place.") from None
    with release:
        try:
            yield
        finally:
            if made and all(own.name in HOLD_FILES for own in out.iterdir()):
                shutil.rmtree(out, ignore_errors=True)  # nothing was begun


def _foreign(out: Path) -> str | None:
    """The first thing there that no batch wrote."""
    for own in sorted(out.iterdir()):
        inside = _INSIDE.get(own.name)
        if not (own.name in BATCH_FILES or _SCRATCH.fullmatch(own.name) or _MARK.fullmatch(own.name)):
            return own.name
        if inside is None:
            continue
        if not own.is_dir():
            return own.name
        with os.scandir(own) as entries:
            for entry in entries:
                if entry.is_dir() or not inside.fullmatch(entry.name):
                    return f"{own.name}/{entry.name}"
    return None


def begin(
    out: Path, campaigns: Sequence[str], record: Mapping[str, Any], *, resume: bool, force: bool
) -> tuple[dict[str, Any], str]:
    """Write the record down, or hold it against the one that is there; in a folder that is held.

    Returns
    -------
    record : dict
        The batch's: on a resume, as it was written then.
    key : str
        Digest of what the batch is; not of where it is.

    Raises
    ------
    InputError
        When a batch is there that may not be resumed or replaced, or is another one.
    """
    begun = (out / RECORD).exists()
    if begun and not resume and not force:
        state = "a finished" if (out / DATASET).exists() else "an unfinished"
        raise InputError(
            f"{out} must not hold a batch, got {state} one. Go on with it (--resume; failed campaigns again: --resume --retry), "
            "begin anew (--force), or choose another name."
        )
    left = [name for name in (JOURNAL, DATASET, POSTERIORS) if (out / name).exists()]
    if left and not begun and not force:
        raise InputError(
            f"{out} must hold the record of its batch, got {left[0]} without {RECORD}. Put {RECORD} back and go on (--resume), "
            "begin anew and lose what is done (--force), or choose another name."
        )
    try:
        for own in [own for own in out.iterdir() if _SCRATCH.fullmatch(own.name)]:
            shutil.rmtree(own) if own.is_dir() else own.unlink()
        if begun and resume:
            accepted = _same(out, campaigns, record)
        else:
            _clear(out)
            write_whole(out / LIST, listed(campaigns))
            text = json.dumps(record, indent=2, ensure_ascii=False)
            write_whole(out / RECORD, f"{text}\n".encode())
            accepted = json.loads(text)
    except OSError as error:
        raise InputError(f"{out} must be writable, got: {error.strerror}. Free some space or choose another place.") from None
    known = json.dumps({name: value for name, value in accepted.items() if name != "here"}, sort_keys=True)
    return accepted, hashlib.sha256(known.encode()).hexdigest()


def _clear(out: Path) -> None:
    """Drop an earlier batch; its record last, without which nobody may touch the rest."""
    for name in (DATASET, JOURNAL, POSTERIORS, LIST, RECORD):
        path = out / name
        if path.is_dir() and not path.is_symlink():
            shutil.rmtree(path)
        else:
            path.unlink(missing_ok=True)


def _same(out: Path, campaigns: Sequence[str], record: Mapping[str, Any]) -> dict[str, Any]:
    """The record there, which must say the same."""
    path = out / RECORD
    try:
        before: dict[str, Any] = json.loads(bytes_of(path, _LARGEST_RECORD, what="the record of a batch"))
        flat, wanted = _flat(before), _flat(record)
        number = int(flat["campaigns"]["number"])
    except (ValueError, KeyError, TypeError, AttributeError) as error:
        if isinstance(error, InputError):
            raise
        raise InputError(f"{path} must be the record of a batch, got a damaged file. Begin anew (--force).") from None
    cure = "Resume with what the batch was begun with, or begin anew (--force)."
    for name in sorted({*flat, *wanted} - {"campaigns"}):
        if flat.get(name) != wanted.get(name):
            got, has = (_shown(known.get(name)) for known in (flat, wanted))
            raise InputError(f"{path} must be of this batch, got {_WORDS.get(name, name)} {got} where this run has {has}. {cure}")
    if flat["campaigns"] != wanted["campaigns"]:
        more = " Campaigns that are new make a batch of their own." if len(campaigns) > number else ""
        raise InputError(
            f"{path} must be of this batch, got other campaigns ({_first_change(out, campaigns)}). Go on with its own list: "
            f"@{out / LIST} --resume.{more}"
        )
    if before.get("here") != record.get("here"):
        raise InputError(
            f"{path} must be of this batch, got campaigns relative to {before.get('here')} where this run stands in "
            f'{record.get("here")}. Go there (cd); if that folder was moved here, correct "here" in {RECORD}.'
        )
    return before


def _flat(record: Mapping[str, Any]) -> dict[str, Any]:
    """One name for each thing that must be the same."""
    named = {f"version of {name}": value for name, value in record["versions"].items()}
    table = {f"table option {name}": value for name, value in record["options"]["table"].items()}
    options = {name: value for name, value in record["options"].items() if name != "table"}
    model = str(record["model"]["sha256"])[:12]
    return {"schema": record["schema"], "model": model, "campaigns": record["campaigns"], **options, **table, **named}


def _shown(value: Any) -> str:
    return "nothing" if value is None else str(value)


def _first_change(out: Path, campaigns: Sequence[str]) -> str:
    try:
        before = (out / LIST).read_text(encoding="utf-8").splitlines()
    except (OSError, UnicodeDecodeError):
        return f"its {LIST} is damaged"
    now = listed(campaigns).decode().splitlines()
    place = next((k for k, pair in enumerate(zip(before, now, strict=False)) if pair[0] != pair[1]), None)
    if place is None:
        return f"{len(before)} where this run has {len(now)}"
    return f"number {place + 1} is {before[place]} where this run has {now[place]}"


def _plain(value: Any) -> Any:
    return asdict(value) if is_dataclass(value) and not isinstance(value, type) else value
