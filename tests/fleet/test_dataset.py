"""The table on disk: the rows it was made of, the same bytes again, one message for whatever else lies there."""

from __future__ import annotations

import json
import sys
import tracemalloc
from collections.abc import Callable
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from batches import dataset_bytes, made_row

import ldbb_bayes as lb
from ldbb_bayes.errors import InputError
from ldbb_bayes.fleet.dataset import check_pyarrow, write_dataset
from ldbb_bayes.fleet.journal import Journal
from ldbb_bayes.fleet.reading import tally
from ldbb_bayes.fleet.row import Job, Settings

pa = pytest.importorskip("pyarrow")
import pyarrow.parquet as pq  # noqa: E402

SETTINGS = Settings("")
UNITS = {f"C_{k}": "mm/N" for k in range(4)}


def write(out: Path, number: int = 20, **said: Any) -> Path:
    rows = (made_row(SETTINGS, Job(k, f"p{k}")) for k in range(number))
    out.mkdir()
    write_dataset(rows, UNITS, out / "campaigns.parquet", {"campaigns": number, **said})
    return out


def test_rows_come_back(tmp_path: Path) -> None:
    frame = lb.read_batch(write(tmp_path / "b", seed=7))
    assert frame["campaign"].tolist() == [f"p{k}" for k in range(20)]
    assert frame["status"].tolist() == ["failed" if k % 5 == 4 else "done" for k in range(20)]
    for k in (0, 3, 4):
        made = made_row(SETTINGS, Job(k, f"p{k}"))
        for name in UNITS:
            own = made.get("parameters", {}).get(name)
            expected = np.nan if own is None else own["ci_low"]
            np.testing.assert_equal(frame[f"{name}.ci_low"][k], expected)
    assert list(frame["gaussian_names"][1]) == ["C_0", "C_1", "C_2", "C_3"]
    assert frame["gaussian_names"][4] is None
    assert np.isnan(frame["log_prob_truncation"][0])
    assert frame.attrs["units"] == UNITS
    assert frame.attrs["batches"][0]["seed"] == 7


def test_same_rows_same_bytes_and_parts(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr("ldbb_bayes.fleet.dataset._ROWS_A_PART", 8)
    one, other = write(tmp_path / "a"), write(tmp_path / "b")
    assert dataset_bytes(one) == dataset_bytes(other)
    assert list(dataset_bytes(one)) == [f"part-{k:05d}.parquet" for k in range(3)]
    assert lb.read_batch(one)["campaign"].tolist() == [f"p{k}" for k in range(20)]
    counts = tally(one / "campaigns.parquet")
    assert (counts.campaigns, counts.done, counts.failed, counts.doubtful, counts.not_converged) == (20, 16, 4, 2, 0)
    assert counts.failures[0] == ("p4", "campaign must be good, got none. Mend it.")


def test_half_characters_are_question_marks(tmp_path: Path) -> None:
    """As they come from names of files that are no UTF-8; the journal keeps them, Parquet cannot."""
    row = made_row(SETTINGS, Job(4, "p")) | {"reason": "no \udcff here", "warnings": ["\ud800"]}
    write_dataset([row], {}, tmp_path / "d" / "campaigns.parquet", {"campaigns": 1})
    found = lb.read_batch(tmp_path / "d").iloc[0]
    assert (found["reason"], list(found["warnings"])) == ("no ? here", ["?"])


@pytest.mark.parametrize(("column", "value"), [("tests", "many"), ("seed", 2**63), ("rmse_um", [1.0]), ("terms", 3)])
def test_a_row_that_does_not_fit_is_said(tmp_path: Path, column: str, value: object) -> None:
    row = made_row(SETTINGS, Job(0, "p")) | {column: value}
    with pytest.raises(InputError, match=r"campaigns.parquet must (be writable|have rows that fit).*The rows are kept"):
        write_dataset([row], {}, tmp_path / "d" / "campaigns.parquet", {"campaigns": 1})
    assert not (tmp_path / "d" / "campaigns.parquet").exists()


def test_only_the_columns_asked_for(tmp_path: Path) -> None:
    out = write(tmp_path / "b")
    found = lb.read_batch(out, columns=["campaign", "gaussian_names", "status"])
    assert list(found) == ["campaign", "gaussian_names", "status"]
    assert found["campaign"].tolist() == [f"p{k}" for k in range(20)]
    assert found.attrs["units"] == {}
    found = lb.read_batch([out, out], columns=["C_1.mean"])
    assert list(found) == ["C_1.mean"]
    assert (len(found), found.attrs["units"]) == (40, {"C_1": "mm/N"})
    with pytest.raises(InputError, match=r"column must be one of campaign, .*, got 'reasn'. Did you mean 'reason'"):
        lb.read_batch(out, columns=["reasn"])


def test_several_batches(tmp_path: Path) -> None:
    one, other = write(tmp_path / "a", 2), write(tmp_path / "b", 3)
    frame = lb.read_batch([one, other / "campaigns.parquet"])
    assert frame["campaign"].tolist() == ["p0", "p1", "p0", "p1", "p2"]
    assert len(frame.attrs["batches"]) == 2


def test_any_other_reader_finds_units(tmp_path: Path) -> None:
    schema = pq.read_schema(write(tmp_path / "a") / "campaigns.parquet" / "part-00000.parquet")
    assert schema.field("C_0.mean").metadata == {b"unit": b"mm/N"}
    assert schema.field("rmse_um").metadata == {b"unit": b"um"}


def damage(part: Path) -> None:
    raw = bytearray(part.read_bytes())
    raw[len(raw) // 3 : len(raw) // 3 + 200] = bytes(200)
    part.write_bytes(raw)


def halve(part: Path) -> None:
    part.write_bytes(part.read_bytes()[:-500])


def rewrite(change: Callable[[Any], Any]) -> Callable[[Path], None]:
    def run(part: Path) -> None:
        pq.write_table(change(pq.read_table(part)), part)

    return run


def schema_of(number: int) -> dict[bytes, bytes]:
    return {b"ldbb_bayes": json.dumps({"schema": number, "campaigns": 20}).encode()}


@pytest.mark.parametrize(
    ("spoil", "message"),
    [
        (halve, r"part-00000.parquet must be a part of a batch, got a damaged file \(.*--resume"),
        (damage, "part-00000.parquet"),
        (lambda part: part.write_bytes(b""), "got a damaged file"),
        (lambda part: part.rename(part.with_name("part-00001.parquet")), "got part-00001.parquet where part 0 should be"),
        (lambda part: part.unlink(), "must have 1 rows, got 0"),
        (rewrite(lambda table: table.drop_columns(["reason"])), "must have a column reason, got none"),
        (rewrite(lambda table: table.replace_schema_metadata({})), "got a Parquet file of something else"),
        (rewrite(lambda table: table.replace_schema_metadata(schema_of(2))), "must have schema 1, got 2. Upgrade"),
        (rewrite(lambda table: table.slice(0, 11)), "must have 20 rows, got 11: a part is missing"),
        (
            rewrite(lambda t: t.set_column(t.schema.get_field_index("tests"), "tests", pa.array(["x"] * 20))),
            "column tests must be of type int64, got string",
        ),
        (
            rewrite(lambda t: t.set_column(t.schema.get_field_index("status"), "status", pa.array(["good"] * 20))),
            "status must be done or failed, got 'good'",
        ),
    ],
)
def test_what_is_damaged_is_named(tmp_path: Path, spoil: Callable[[Path], None], message: str) -> None:
    out = write(tmp_path / "b")
    spoil(out / "campaigns.parquet" / "part-00000.parquet")
    with pytest.raises(InputError, match=message):
        lb.read_batch(out)


def test_what_is_no_batch_is_refused(tmp_path: Path) -> None:
    with pytest.raises(InputError, match=r"nowhere must be the --out folder of a batch.*got nothing"):
        lb.read_batch(tmp_path / "nowhere")
    with pytest.raises(InputError, match="got a folder without one"):
        lb.read_batch(tmp_path)
    (tmp_path / "batch.json").write_text("{}")
    with pytest.raises(InputError, match=r"must be a finished batch, got one that stopped before. Go on with it \(--resume\)"):
        lb.read_batch(tmp_path)
    with pytest.raises(InputError, match="batches must be given, got none"):
        lb.read_batch([])


def test_a_dataset_is_replaced_whole(tmp_path: Path) -> None:
    out = write(tmp_path / "b")
    before = dataset_bytes(out)

    def broken() -> Any:
        yield made_row(SETTINGS, Job(0, "p0"))
        raise InputError("no more")

    with pytest.raises(InputError, match="no more"):
        write_dataset(broken(), UNITS, out / "campaigns.parquet", {"campaigns": 2})
    assert dataset_bytes(out) == before
    assert [path.name for path in out.iterdir()] == ["campaigns.parquet"]
    write_dataset([made_row(SETTINGS, Job(0, "p0"))], UNITS, out / "campaigns.parquet", {"campaigns": 1})
    assert len(lb.read_batch(out)) == 1


def test_without_pyarrow(monkeypatch: pytest.MonkeyPatch, tmp_path: Path) -> None:
    monkeypatch.setitem(sys.modules, "pyarrow", None)
    monkeypatch.setitem(sys.modules, "pyarrow.parquet", None)
    with pytest.raises(InputError, match=r"got none. Run pip install 'ldbb-bayes\[fleet\]'"):
        check_pyarrow()
    with pytest.raises(InputError, match="pyarrow must be installed"):
        lb.batch([tmp_path], tmp_path / "out")
    assert not (tmp_path / "out").exists()


def test_a_changed_number_is_seen(tmp_path: Path, rng: np.random.Generator) -> None:
    """Whatever bit is turned: an error that names the file, or the very same rows (a byte that says nothing)."""
    part = write(tmp_path / "b") / "campaigns.parquet" / "part-00000.parquet"
    raw, before = part.read_bytes(), pq.read_table(part)
    seen = 0
    for place in rng.integers(0, len(raw), 100):
        changed = bytearray(raw)
        changed[place] ^= 4
        part.write_bytes(changed)
        try:
            found = lb.read_batch(tmp_path / "b")
        except InputError:
            seen += 1
        else:
            assert found["campaign"].tolist() == before["campaign"].to_pylist()
            np.testing.assert_array_equal(found["C_1.mean"], before["C_1.mean"].to_pandas())
    assert seen > 20


def peak_bytes(folder: Path, number: int) -> int:
    row = made_row(SETTINGS, Job(1, "p"), parameters=8)
    tracemalloc.start()
    try:
        with Journal(folder / "j", number, "key") as journal:
            for index in range(number):
                journal.append(index, row)
            rows = (journal.read(index) for index in range(number))
            write_dataset(rows, dict.fromkeys(row["parameters"], "mm/N"), folder / "d", {"campaigns": number})
        return tracemalloc.get_traced_memory()[1]
    finally:
        tracemalloc.stop()


def test_memory_does_not_grow_with_rows(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    """Of the collector: sixteen times as many rows through journal and dataset, in parts of 50."""
    monkeypatch.setattr("ldbb_bayes.fleet.dataset._ROWS_A_PART", 50)
    for name in ("first", "few", "many"):
        (tmp_path / name).mkdir()
    peak_bytes(tmp_path / "first", 100)
    few, many = peak_bytes(tmp_path / "few", 100), peak_bytes(tmp_path / "many", 1600)
    assert (tmp_path / "many" / "j" / "rows.jsonl").stat().st_size > 2e6
    assert many < few + 100_000
