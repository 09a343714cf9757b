"""Batches: rows are what a fit says, a bad campaign is its own row, and whatever stops a batch, the
table is the same."""

from __future__ import annotations

import csv
import json
import os
import shutil
import signal
import sqlite3
import subprocess
import sys
from collections.abc import Iterator
from concurrent.futures import Executor, Future, ThreadPoolExecutor
from contextlib import closing, contextmanager
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
import pandas as pd
import pytest
from batches import CONSTANT, FORCES_N, LINEAR, dataset_bytes, made_row, write_campaigns
from campaigns import cases, full_disk, plan, refuses, simulated, tidy

import ldbb_bayes as lb
from ldbb_bayes.campaign import circle_preview, preview
from ldbb_bayes.errors import InputError
from ldbb_bayes.fleet.batch import Batch, _named_campaigns
from ldbb_bayes.fleet.campaign_row import Job, Settings, fit_row
from ldbb_bayes.fleet.campaign_statistics import sufficient_statistics
from ldbb_bayes.fleet.fleet_statistics import fleet_statistics
from ldbb_bayes.fleet.gathering import find_passed_over, gather
from ldbb_bayes.inference.hyper_posterior import HyperPosterior
from ldbb_bayes.model.specification import model_to_toml
from ldbb_bayes.parallel import WorkerDiedError
from ldbb_bayes.report.fit_record import full_result

pytest.importorskip("pyarrow")
ESS = 150.0
OPTIONS: dict[str, Any] = {"model": LINEAR, "ess": ESS, "seed": 3}
LIMITS = {"C_XXX": "60 nm/N", "stiffness_Y": "15 N/µm"}


@pytest.fixture(scope="module")
def folders(tmp_path_factory: pytest.TempPathFactory) -> list[str]:
    return write_campaigns(tmp_path_factory.mktemp("campaigns"), 3)


@pytest.fixture(scope="module")
def fitted(folders: list[str], tmp_path_factory: pytest.TempPathFactory) -> Batch:
    return lb.fleet.run_batch(
        folders, tmp_path_factory.mktemp("batch") / "out", tolerances=LIMITS, **OPTIONS
    )


def test_a_row_previews_the_readings_of_each_circle_once(
    folders: list[str], monkeypatch: pytest.MonkeyPatch
) -> None:
    previewed: list[str] = []

    def counted(test: lb.CircularTest, campaign: lb.Campaign) -> Any:
        previewed.append(test.name)
        return circle_preview.preview_test(test, campaign)

    monkeypatch.setattr(preview, "preview_test", counted)
    row = fit_row(Settings(model_to_toml(LINEAR), ess=ESS), Job(0, folders[0], folders[0]))
    assert row["status"] == "done"
    assert previewed == [test.name for test in lb.read_campaign(folders[0]).tests]


@pytest.mark.parametrize("text", ["60", "60 µm"])
def test_a_tolerance_without_its_unit_is_refused_before_any_fit(
    folders: list[str], tmp_path: Path, text: str
) -> None:
    limits = {"stiffness_Y": "15 N/µm", "C_XXX": text}
    with pytest.raises(InputError, match="tolerance of C_XXX must be a number with its unit"):
        lb.fleet.run_batch(folders, tmp_path / "out", tolerances=limits, **OPTIONS)
    assert not (tmp_path / "out").exists()


def test_a_campaign_whose_own_tolerance_has_no_unit_is_refused_in_its_row(
    folders: list[str], tmp_path: Path
) -> None:
    folder = tmp_path / "stated"
    campaign = lb.read_campaign(folders[0])
    lb.write_campaign(replace(campaign, tolerances={"C_XXX": "60"}), folder)
    row = lb.fleet.run_batch([str(folder)], tmp_path / "out", **OPTIONS).rows().iloc[0]
    assert row["status"] == "failed"
    assert row["reason"] == (
        "campaign.toml, [tolerance]: tolerance of C_XXX must be a number with its unit, got '60'."
        " Write it in nm/N, like 0.5 nm/N."
    )
    assert row["name"] == campaign.name


def test_rows_are_what_a_fit_says(folders: list[str], fitted: Batch) -> None:
    rows = fitted.rows()
    assert rows["campaign"].tolist() == folders
    campaign = lb.read_campaign(folders[1])
    posterior = lb.sample(
        LINEAR, campaign, sampler="independent", seed=3, rule=lb.inference.StoppingRule(ess=ESS)
    )
    result = full_result(posterior, 0.95)
    row = rows.iloc[1]
    for name, numbers in lb.summarize(posterior).iterrows():
        for key in ("mean", "sd", "median", "ci_low", "ci_high"):
            assert row[f"{name}.{key}"] == numbers[key]
        assert rows.attrs["units"][name] == numbers["unit"]
    assert json.loads(row["tolerances"]) == LIMITS
    for name, numbers in lb.assess_conformity(posterior, LIMITS).items():
        assert (row[f"{name}.probability"], row[f"{name}.decision"]) == (
            numbers.probability,
            numbers.decision,
        )
    fields = {
        "sha256": campaign.sha256,
        "tests": 3,
        "readings": 180,
        "force_max_N": 742.0,
        "reference_force_N": 389.0,
    }
    fields |= {"degree": 1, "planes": "XY", "model_sha256": result["model"]["sha256"]}
    fields |= {"converged": result["sampler"]["converged"]}
    fields |= {
        name: result["fit"][name] for name in ("state", "verdict", "log_prob_truncation", "rmse_um")
    }
    for column, value in fields.items():
        assert row[column] == value, column
    assert list(row["terms"]) == result["model"]["terms"]
    for column in ("kinds", "warnings", "misfits"):
        assert list(row[column]) == result["fit"][column]
    assert pd.isna(row["reason"])
    assert pd.isna(row["machine_id"])


def test_what_is_beside_the_fit(folders: list[str], fitted: Batch) -> None:
    """The Bayes factor is that of the evidences, the statistics those of the untruncated
    posterior."""
    rows = fitted.rows()
    campaign = lb.read_campaign(folders[2])
    value, error = lb.inference.log_bayes_factor(
        *(lb.log_evidence(model, campaign) for model in (LINEAR, LINEAR.with_degree(0)))
    )
    assert (
        abs(rows["log_bayes_factor"][2] - value) < rows["log_bayes_factor_error"][2] + error + 0.02
    )
    statistics = sufficient_statistics(
        HyperPosterior(LINEAR.bind(lb.read_campaign(folders[0])), truncated=False, seed=3)
    )
    row = rows.iloc[0]
    assert tuple(row["gaussian_names"]) == statistics.names
    np.testing.assert_allclose(row["gaussian_mean"], statistics.mean, rtol=1e-9, atol=1e-15)
    np.testing.assert_allclose(
        row["gaussian_covariance"],
        statistics.covariance[np.tril_indices(len(statistics.names))],
        rtol=1e-9,
    )
    assert len(fleet_statistics(rows)) == 3


def test_flat_priors_have_neither_evidence_nor_statistics(
    folders: list[str], tmp_path: Path
) -> None:
    rows = lb.fleet.run_batch(
        folders[:1], tmp_path / "out", model=lb.HybridModel.paper(1), ess=ESS
    ).rows()
    assert rows["status"][0] == "done"
    assert rows["gaussian_names"][0] is None
    assert np.isnan(rows["log_bayes_factor"][0])


def test_what_goes_wrong_stays_in_its_row(folders: list[str], tmp_path: Path) -> None:
    good = simulated(plan((60,) * 3, forces_N=FORCES_N))
    torn = lb.write_campaign(good, tmp_path / "torn")
    csv = next(torn.glob("*.csv"))
    csv.write_bytes(csv.read_bytes()[:-3] + b"\n1.0,")
    one = replace(
        good, tests=tuple(replace(test, force_N=100.0, pressure_bar=None) for test in good.tests)
    )
    single = lb.write_campaign(one, tmp_path / "one_force")
    paths = [
        tmp_path / "missing",
        torn,
        single,
        lb.write_campaign(good.plan(), tmp_path / "plan"),
        folders[0],
    ]
    finished = lb.fleet.run_batch(paths, tmp_path / "out", model=LINEAR, ess=ESS, compare=False)
    rows = finished.rows()
    assert rows["status"].tolist() == ["failed"] * 4 + ["done"]
    assert (finished.done, finished.failures, len(finished.failed)) == (1, 4, 4)
    for reason, expected in zip(
        rows["reason"],
        ("which does not exist", "torn", "force", "must have readings"),
        strict=False,
    ):
        assert expected in reason
        assert "\n" not in reason
    assert rows["sha256"][2] == lb.read_campaign(single).sha256
    assert np.isnan(rows["log_bayes_factor"][4])
    record = finished.as_dict()
    assert (record["failures"], [entry["campaign"] for entry in record["failed"]]) == (
        4,
        rows["campaign"][:4].tolist(),
    )
    assert Batch.from_dict(json.loads(json.dumps(record))) == finished


@pytest.mark.parametrize("states", [("a",), ("a", "c"), ("a", "b", "c")])
def test_campaigns_are_named_by_any_number_of_states(states: tuple[str, ...]) -> None:
    with closing(sqlite3.connect(":memory:")) as journal:
        journal.execute("CREATE TABLE campaigns (number, status, state, row)")
        for number, state in enumerate("abcd"):
            row = json.dumps({"campaign": state, "reason": "none"})
            journal.execute("INSERT INTO campaigns VALUES (?, 'ok', ?, ?)", (number, state, row))
        named = _named_campaigns(journal, "reason", states)
    assert tuple(campaign["campaign"] for campaign in named) == states


@pytest.mark.parametrize(
    ("error", "message"),
    [
        (
            np.linalg.LinAlgError("not positive definite"),
            "got a numerical breakdown (not positive definite)",
        ),
        (OverflowError("too large"), "must be within reach of double precision, got: too large"),
        (OSError(13, "Permission denied", "/x/y"), "/x/y must be usable, got: Permission denied"),
        (MemoryError("8 GB"), "unexpected MemoryError: 8 GB"),
        (KeyError("a\nb"), "unexpected KeyError: 'a\\nb' (fleet/test_batch.py, line"),
    ],
)
def test_every_kind_of_error_is_a_reason(
    error: Exception, message: str, monkeypatch: pytest.MonkeyPatch
) -> None:
    def broken(*_: object, **__: object) -> None:
        raise error

    monkeypatch.setattr("ldbb_bayes.fleet.campaign_row.read_campaign", broken)
    row = fit_row(Settings(model_to_toml(CONSTANT)), Job(0, "x", "x"))
    assert row["status"] == "failed"
    assert message in row["reason"]
    assert "\n" not in row["reason"]
    error = KeyboardInterrupt()  # type: ignore[assignment]
    with pytest.raises(KeyboardInterrupt):
        fit_row(Settings(model_to_toml(CONSTANT)), Job(0, "x", "x"))


def test_a_tidy_csv_takes_what_its_table_does_not_say(tmp_path: Path) -> None:
    tidy(simulated(plan((60,) * 3, forces_N=FORCES_N)), tmp_path / "t.csv")
    settings = Settings(model_to_toml(CONSTANT), ess=ESS, table={"radius_mm": 100.0})
    row = fit_row(settings, Job(0, "t.csv", str(tmp_path / "t.csv")))
    assert row["sha256"] == lb.read_campaign(tmp_path / "t.csv", radius_mm=100.0).sha256
    assert row["sha256"] != lb.read_campaign(tmp_path / "t.csv").sha256
    incomplete = replace(settings, certificates={"bar_length_error_um": 1.0})
    assert (
        "must come with its U_um"
        in fit_row(incomplete, Job(0, "t.csv", str(tmp_path / "t.csv")))["reason"]
    )


def test_campaigns_are_gathered_from_folders_and_lists(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.chdir(tmp_path)
    for name in ("shop/b", "shop/a", "lone", "shop/none"):
        Path(name).mkdir(parents=True)
        if not name.endswith("none"):
            (Path(name) / "campaign.toml").touch()
    Path("t.csv").touch()
    Path("list.txt").write_text("# all\nshop\n\n  lone\nmissing#1\n")
    assert gather(["shop", "t.csv"]) == ("shop/a", "shop/b", "t.csv")
    assert gather("@list.txt") == ("shop/a", "shop/b", "lone", "missing#1")
    assert gather(["list.txt", tmp_path / "lone" / "campaign.toml"]) == gather("@list.txt")
    for entries, message in (
        ([], "must have campaigns that exist, got none among 0"),
        (["nowhere", "there"], r"must have campaigns that exist, got none among 2 \(nowhere\)"),
        (["shop/none"], "must have campaigns that exist"),
        (["@nowhere"], "nowhere must be a list of campaigns, one path a line, found none"),
        (["a\nb", "lone"], "must be printable and stand on one line"),
        (["a\udcff", "lone"], "must be printable"),
    ):
        refuses(message, gather, entries)


def test_what_a_folder_holds_besides_campaigns_is_named(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.chdir(tmp_path)
    for name in ("shop/a", "shop/empty", "shop/2024/b", "shop/fitted", "shop/.cache"):
        Path(name).mkdir(parents=True)
    for name in ("shop/a/campaign.toml", "shop/2024/b/campaign.toml", "shop/readings.xlsx"):
        Path(name).touch()
    expected = ("shop/2024", "shop/empty", "shop/readings.xlsx")
    assert find_passed_over(["shop", "shop/a"], tmp_path / "shop" / "fitted") == expected


@pytest.fixture
def quick_batch(monkeypatch: pytest.MonkeyPatch, tmp_path: Path) -> tuple[list[str], list[int]]:
    """Paths that exist, and the calls of a fit that takes no time."""
    (tmp_path / "p0").mkdir()
    (tmp_path / "p0" / "campaign.toml").touch()
    calls: list[int] = []

    def fit(settings: Settings, job: Job) -> dict[str, Any]:
        calls.append(job.number)
        return made_row(settings, job)

    monkeypatch.setattr("ldbb_bayes.fleet.batch.fit_row", fit)
    return [str(tmp_path / f"p{k}") for k in range(20)], calls


def test_a_campaign_whose_files_have_changed_is_fitted_again(
    quick_batch: tuple[list[str], list[int]], tmp_path: Path
) -> None:
    paths, calls = quick_batch
    paths = [*paths, str(tmp_path / "tidy.csv")]
    (tmp_path / "tidy.csv").touch()
    toml = tmp_path / "p0" / "campaign.toml"
    readings = tmp_path / "p0" / "f036.csv"
    toml.write_text('[[test]]\nfile = "f036.csv"\n', encoding="utf-8")
    readings.write_text("angle_deg,reading_um\n0,1\n", encoding="utf-8")
    out = tmp_path / "out"
    assert lb.fleet.run_batch(paths, out).fitted == len(paths)
    os.utime(readings, (0.0, 0.0))
    assert lb.fleet.run_batch(paths, out, resume=True).fitted == 0
    calls.clear()
    readings.write_text("angle_deg,reading_um\n0,2\n", encoding="utf-8")
    assert lb.fleet.run_batch(paths, out, resume=True).fitted == 1
    assert calls == [0]
    assert lb.fleet.run_batch(paths, out, resume=True).fitted == 0
    shutil.rmtree(tmp_path / "p0")
    assert lb.fleet.run_batch(paths, out, resume=True).fitted == 0


@pytest.mark.slow
def test_interrupted_anywhere_and_resumed(
    quick_batch: tuple[list[str], list[int]], tmp_path: Path
) -> None:
    """What is done is not done again, and the table is the same; so it is on threads, in whatever
    order rows come."""
    paths, calls = quick_batch
    uninterrupted = dataset_bytes(lb.fleet.run_batch(paths, tmp_path / "whole").out)
    with ThreadPoolExecutor(8) as executor:
        assert (
            dataset_bytes(lb.fleet.run_batch(paths, tmp_path / "threads", executor=executor).out)
            == uninterrupted
        )
    calls.clear()
    out = tmp_path / "out"

    for count in (0, 5, 11, 19):

        def stop(finished: int, *_: int, count: int = count) -> None:
            if finished == count:
                raise KeyboardInterrupt

        with pytest.raises(KeyboardInterrupt):
            lb.fleet.run_batch(paths, out, resume=count > 0, progress=stop)
        refuses("must be a finished batch, got one that stopped before", lb.fleet.read_batch, out)
        refuses("must not hold a batch, got an unfinished one", lb.fleet.run_batch, paths, out)
    again = lb.fleet.run_batch(paths, out, resume=True)
    assert sorted(calls) == list(range(20))
    assert (again.resumed, again.failures, again.doubtful) == (True, 4, 2)
    assert dataset_bytes(out) == uninterrupted
    assert lb.fleet.run_batch(paths, out, resume=True).fitted == 0
    calls.clear()
    assert lb.fleet.run_batch(paths, out, resume=True, retry=True).fitted == 4
    assert calls == [4, 9, 14, 19]
    assert lb.fleet.run_batch(paths, out, force=True).fitted == 20


@pytest.mark.parametrize(("change", "message"), cases(__file__, "refusals.toml")["another_batch"])
def test_another_batch_is_not_resumed(
    quick_batch: tuple[list[str], list[int]], tmp_path: Path, change: dict[str, Any], message: str
) -> None:
    lb.fleet.run_batch(quick_batch[0], tmp_path / "out")
    with pytest.raises(
        InputError,
        match=rf"out must be resumed with the options .*, {message}.*Resume with the same",
    ):
        lb.fleet.run_batch(quick_batch[0], tmp_path / "out", resume=True, **change)


def test_other_campaigns_are_not_resumed(
    quick_batch: tuple[list[str], list[int]], tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    paths, _ = quick_batch
    out = lb.fleet.run_batch(paths, tmp_path / "out").out
    advice = rf"or in another order\). Go on with its own list: @{out}/campaigns.txt --resume\."
    for other_paths in (paths[:-1], [*paths, "one more"], paths[1::-1] + paths[2:]):
        refuses(
            rf"got other campaigns \(20 where this run has {len(other_paths)}, {advice}",
            lb.fleet.run_batch,
            other_paths,
            out,
            resume=True,
        )
    # The same said otherwise is the same batch.
    options: dict[str, Any] = {
        "model": replace(
            lb.HybridModel.default(), nuisances=lb.HybridModel.default().nuisances[::-1]
        )
    }
    options |= {"seed": np.int64(1), "ess": np.float32(1000)}
    monkeypatch.chdir(tmp_path)
    for other_paths in (f"@{out}/campaigns.txt", [os.path.relpath(path) for path in paths]):
        assert lb.fleet.run_batch(other_paths, out, resume=True, **options).fitted == 0


def test_what_is_refused(quick_batch: tuple[list[str], list[int]], tmp_path: Path) -> None:
    paths, calls = quick_batch
    foreign = tmp_path / "foreign"
    foreign.mkdir()
    (foreign / "thesis.tex").touch()
    (tmp_path / "file").touch()
    for options, message in (
        ({"out": foreign}, "must hold nothing but a batch, got 'thesis.tex'"),
        ({"out": tmp_path / "file"}, "must be a folder, got a file"),
        ({"retry": True}, "retry must come with resume"),
        ({"force": True, "resume": True}, "resume without force"),
        ({"ess": np.inf}, "ess must be a finite number above zero, got inf"),
        (
            {"seed": 2**63},
            "seed must be a whole number from 0 to 2\\^63 - 1, got 9223372036854775808",
        ),
    ):
        refuses(message, lb.fleet.run_batch, paths, options.pop("out", tmp_path / "new"), **options)
    assert calls == []
    assert not (tmp_path / "new").exists()
    out = lb.fleet.run_batch(paths, tmp_path / "out").out
    refuses("must not hold a batch, got a finished one", lb.fleet.run_batch, paths, out)
    (out / "batch.sqlite").rename(tmp_path / "aside")
    for resume in (True, False):
        refuses(
            "must hold the journal of its batch, got none",
            lb.fleet.run_batch,
            paths,
            out,
            resume=resume,
        )
    (out / "batch.sqlite").write_bytes(b"what no database is" * 100)
    refuses(
        r"sound journal .*, got: file is not a database.*remove a damaged one",
        lb.fleet.run_batch,
        paths,
        out,
        resume=True,
    )
    (tmp_path / "aside").replace(out / "batch.sqlite")
    assert lb.fleet.run_batch(paths, out, force=True).fitted == 20


def test_two_at_once(quick_batch: tuple[list[str], list[int]], tmp_path: Path) -> None:
    """The second is refused, as long as the first has workers."""
    paths = quick_batch[0]
    refused = []

    def second(*_: int) -> None:
        refuses(
            "that no other run is using, got: database is locked",
            lb.fleet.run_batch,
            paths,
            tmp_path / "out",
            resume=True,
        )
        refused.append(1)

    @contextmanager
    def workers() -> Iterator[None]:
        try:
            yield None
        finally:
            second()

    assert (
        lb.fleet.run_batch(paths, tmp_path / "out", executor=workers, progress=second).campaigns
        == 20
    )
    assert len(refused) == 22

    @contextmanager
    def silent() -> Iterator[None]:
        raise InputError("a cluster must answer, got silence.")
        yield

    refuses("got silence", lb.fleet.run_batch, paths, tmp_path / "new", executor=silent)
    assert not (tmp_path / "new").exists()


def test_what_a_worker_took_with_it_is_a_row(
    quick_batch: tuple[list[str], list[int]], tmp_path: Path
) -> None:
    class Deadly(Executor):
        """Campaign 1 is the death of its worker."""

        def submit(self, fn: Any, /, *args: Any, **kwargs: Any) -> Any:
            future: Future[Any] = Future()
            if fn.args[1].number == 1:
                future.set_exception(WorkerDiedError())
            else:
                future.set_result(fn(*args, **kwargs))
            return future

    rows = lb.fleet.run_batch(quick_batch[0][:3], tmp_path / "out", executor=Deadly()).rows()
    assert rows["status"].tolist() == ["done", "failed", "done"]
    assert "its worker died" in rows["reason"][1]


def test_a_full_disk_under_the_journal_and_the_table(
    quick_batch: tuple[list[str], list[int]], tmp_path: Path
) -> None:
    """Files may not grow beyond so much: a message, and what is done is kept."""
    paths, _ = quick_batch
    uninterrupted = dataset_bytes(lb.fleet.run_batch(paths, tmp_path / "whole").out)
    messages = set()
    message = r"(can|must) be (written|writable).*, got: .*free some space"
    for k, size in enumerate((10_000, 40_000, 80_000, len(uninterrupted) - 1)):
        with (
            full_disk(size),
            pytest.raises(InputError, match=message) as raised,
        ):
            lb.fleet.run_batch(paths, tmp_path / f"out{k}")
        messages.add(str(raised.value).split(" must")[0].rpartition("/")[2])
        assert not (tmp_path / f"out{k}" / "campaigns.parquet").exists()
        assert (
            dataset_bytes(lb.fleet.run_batch(paths, tmp_path / f"out{k}", resume=True).out)
            == uninterrupted
        )
    assert "batch.sqlite" in messages


@pytest.mark.slow
def test_killed_and_resumed(
    quick_batch: tuple[list[str], list[int]], tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    """kill -9 right after a row: the row is kept, and in the end the table is the same."""
    root = Path(__file__).resolve().parents[2]
    shutil.copy(root / "tests" / "scripts" / "killed_batch.py", tmp_path / "made.py")
    environment = os.environ | {"PYTHONPATH": os.pathsep.join([str(root), str(root / "tests")])}
    ended = subprocess.run(
        [sys.executable, "made.py"], env=environment, cwd=tmp_path, timeout=60, check=False
    )
    assert ended.returncode == -signal.SIGKILL
    monkeypatch.chdir(tmp_path)
    paths = [f"p{k}" for k in range(20)]
    calls = quick_batch[1]
    again = lb.fleet.run_batch(paths, "out", resume=True)
    assert sorted([*calls, *map(int, Path("calls").read_text().split())]) == list(range(20))
    assert dataset_bytes(lb.fleet.run_batch(paths, "whole").out) == dataset_bytes(again.out)


def test_the_table_is_a_csv_too_for_spreadsheets(folders: list[str], tmp_path: Path) -> None:
    paths = [folders[0], f"{tmp_path}/none"]
    batch = lb.fleet.run_batch(paths, tmp_path / "b", **OPTIONS)
    with batch.spreadsheet.open(encoding="utf-8", newline="") as stream:
        lines = list(csv.DictReader(stream))
    assert [line["campaign"] for line in lines] == paths
    assert [line["status"] for line in lines] == ["done", "failed"]
    assert not [name for name in lines[0] if name.startswith("gaussian_")]
    done, failed = batch.rows().to_dict("records")
    assert lines[0]["tests"] == "3"
    assert float(lines[0]["C_XXX.mean"]) == done["C_XXX.mean"]
    assert lines[0]["kinds"] == "; ".join(done["kinds"])
    assert lines[1]["reason"] == failed["reason"]
    assert lines[1]["tests"] == lines[1]["C_XXX.mean"] == lines[1]["kinds"] == ""


def test_several_batches_and_columns(
    quick_batch: tuple[list[str], list[int]], tmp_path: Path
) -> None:
    one, two = (lb.fleet.run_batch(quick_batch[0][:n], tmp_path / f"b{n}").out for n in (3, 12))
    rows = lb.fleet.read_batch([one, two / "campaigns.parquet"])
    assert len(rows) == 15
    assert rows["C_0.mean"].notna().sum() == 3 + 10
    assert rows.attrs["units"]["C_0"] == "mm/N"
    assert list(lb.fleet.read_batch(two, ["C_1.sd", "campaign"]).columns) == ["C_1.sd", "campaign"]
    refuses(
        r"column must be one of .*Did you mean 'campaign'", lb.fleet.read_batch, one, ["campain"]
    )


def test_tables_that_are_none(
    quick_batch: tuple[list[str], list[int]], tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    out = lb.fleet.run_batch(quick_batch[0], tmp_path / "b").out
    sound = dataset_bytes(out)
    pd.DataFrame({"a": [1]}).to_parquet(tmp_path / "other.parquet")
    for path, message in (
        (
            tmp_path / "none",
            "must be the --out folder of a batch, or its campaigns.parquet, found none",
        ),
        (tmp_path / "p0", r"got a folder without one\. Make one .* ldbb-bayes batch CAMPAIGN"),
        (tmp_path / "other.parquet", "got a Parquet file of something else"),
        (
            tmp_path / "p0" / "campaign.toml",
            r"must be the table of a batch, got another, or a damaged file .*\. Give a batch's",
        ),
    ):
        refuses(message, lb.fleet.read_batch, path)
    for damaged in (
        sound[: len(sound) // 2],
        sound[:500] + bytes([sound[500] ^ 255]) + sound[501:],
    ):
        (out / "campaigns.parquet").write_bytes(damaged)
        refuses(
            r"got a damaged file .*Remove it and run the batch with --resume",
            lb.fleet.read_batch,
            out,
        )
    monkeypatch.setitem(sys.modules, "pyarrow", None)
    refuses(
        r"pyarrow must be installed for batches, got none.*'ldbb-bayes\[fleet\]'",
        lb.fleet.read_batch,
        out,
    )
