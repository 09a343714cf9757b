"""Batches: rows are what a fit says, a bad campaign is its own row, and whatever stops a batch, the table is the same."""

from __future__ import annotations

import errno
import os
import shutil
import signal
import subprocess
import sys
import time
from collections.abc import Iterator
from concurrent.futures import Executor, ThreadPoolExecutor
from contextlib import contextmanager
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
import pandas as pd
import pytest
from batches import CONSTANT, FORCES_N, LINEAR, dataset_bytes, made_row, write_campaigns
from campaigns import plan, simulated

import ldbb_bayes as lb
from ldbb_bayes.errors import InputError
from ldbb_bayes.files import write_whole
from ldbb_bayes.fleet.batch import Batch
from ldbb_bayes.fleet.executors import process_executor
from ldbb_bayes.fleet.gather import gather, listed
from ldbb_bayes.fleet.row import Job, Settings, fit_row
from ldbb_bayes.fleet.statistics import fleet_statistics
from ldbb_bayes.inference.quadrature import HyperPosterior
from ldbb_bayes.inference.sufficient import sufficient_statistics
from ldbb_bayes.model.population_prior import PopulationPrior
from ldbb_bayes.model.spec import model_to_toml
from ldbb_bayes.report.result import full_result

pytest.importorskip("pyarrow")
ESS = 150.0


@pytest.fixture(scope="module")
def folders(tmp_path_factory: pytest.TempPathFactory) -> list[str]:
    return write_campaigns(tmp_path_factory.mktemp("campaigns"), 3)


@pytest.fixture(scope="module")
def fitted(folders: list[str], tmp_path_factory: pytest.TempPathFactory) -> Batch:
    return lb.batch(folders, tmp_path_factory.mktemp("batch") / "out", model=LINEAR, ess=ESS, seed=3, posteriors=True)


def test_rows_are_what_a_fit_says(folders: list[str], fitted: Batch) -> None:
    rows = fitted.rows()
    assert rows["campaign"].tolist() == folders
    campaign = lb.read_campaign(folders[1])
    posterior = lb.sample(LINEAR, campaign, sampler="quadrature", seed=3, rule=lb.StoppingRule(ess=ESS))
    result, row = full_result(posterior, 0.95), rows.iloc[1]
    for name, own in lb.summarize(posterior).iterrows():
        for key in ("mean", "sd", "median", "ci_low", "ci_high"):
            assert row[f"{name}.{key}"] == own[key]
        assert rows.attrs["units"][name] == own["unit"]
    for column, value in {
        "name": campaign.name,
        "sha256": campaign.sha256,
        "tests": 3,
        "readings": 180,
        "force_min_N": 36.0,
        "force_max_N": 742.0,
        "reference_force_N": 389.0,
        "degree": 1,
        "topology": "wCAFYXZSt",
        "planes": "XY",
        "model_sha256": result["model"]["sha256"],
        "converged": result["sampler"]["converged"],
        "verdict": result["fit"]["verdict"],
        "log_prob_truncation": result["fit"]["log_prob_truncation"],
        "rmse_um": result["fit"]["rmse_um"],
    }.items():
        assert row[column] == value, column
    assert list(row["terms"]) == result["model"]["terms"]
    assert list(row["warnings"]) == result["fit"]["warnings"]
    assert list(row["misfits"]) == result["fit"]["misfits"]
    assert pd.isna(row["reason"])
    assert pd.isna(row["machine_id"])


def test_the_bayes_factor_is_that_of_evidences(folders: list[str], fitted: Batch) -> None:
    campaign, row = lb.read_campaign(folders[2]), fitted.rows().iloc[2]
    linear, constant = (lb.log_evidence(own, campaign) for own in (LINEAR, LINEAR.with_degree(0)))
    value, error = lb.log_bayes_factor(linear, constant)
    assert abs(row["log_bayes_factor"] - value) < row["log_bayes_factor_error"] + error + 0.02


def test_statistics_are_those_of_the_untruncated_posterior(folders: list[str], fitted: Batch) -> None:
    rows = fitted.rows()
    found = sufficient_statistics(HyperPosterior(LINEAR.bind(lb.read_campaign(folders[0])), truncated=False, seed=3))
    row = rows.iloc[0]
    assert tuple(row["gaussian_names"]) == found.names
    np.testing.assert_allclose(row["gaussian_mean"], found.mean, rtol=1e-9, atol=1e-15)
    np.testing.assert_allclose(row["gaussian_covariance"], found.covariance[np.tril_indices(len(found.names))], rtol=1e-9)
    assert len(fleet_statistics(rows)) == 3


def test_posteriors_are_kept_on_request(folders: list[str], fitted: Batch) -> None:
    files = sorted(path.name for path in (fitted.out / "posteriors").iterdir())
    assert files == [f"{k:07d}-{lb.read_campaign(path).sha256[:12]}.nc" for k, path in enumerate(folders)]
    kept = lb.load(fitted.out / "posteriors" / files[1])
    assert lb.summarize(kept)["mean"]["C_XXX"] == fitted.rows()["C_XXX.mean"][1]


@pytest.mark.slow
def test_the_same_bytes_on_processes(folders: list[str], fitted: Batch, tmp_path: Path) -> None:
    with process_executor(2) as executor:
        other = lb.batch(folders, tmp_path / "out", model=LINEAR, ess=ESS, seed=3, posteriors=True, executor=executor)
    assert dataset_bytes(other.out) == dataset_bytes(fitted.out)


DASK = """
import sys
import ldbb_bayes as lb
from batches import LINEAR
from ldbb_bayes.fleet.executors import executor_named
if __name__ == "__main__":
    out, *folders = sys.argv[1:]
    with executor_named("dask", 2, None) as executor:
        lb.batch(folders, out, model=LINEAR, ess=150.0, seed=3, posteriors=True, executor=executor)
"""


@pytest.mark.slow
def test_the_same_bytes_on_dask(folders: list[str], fitted: Batch, tmp_path: Path) -> None:
    pytest.importorskip("distributed")
    (tmp_path / "run.py").write_text(DASK)
    run_script(tmp_path / "run.py", tmp_path / "out", *folders).check_returncode()
    assert dataset_bytes(tmp_path / "out") == dataset_bytes(fitted.out)


def test_what_goes_wrong_stays_in_its_row(folders: list[str], tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    good = simulated(plan((60,) * 3, forces_N=FORCES_N))
    torn = lb.write_campaign(good, tmp_path / "torn")
    csv = next(torn.glob("*.csv"))
    csv.write_bytes(csv.read_bytes()[:-3] + b"\n1.0,")
    bad = lb.write_campaign(good, tmp_path / "nan")
    csv = next(bad.glob("*.csv"))
    csv.write_text(csv.read_text().replace("\n", "\n0.0,nan\n", 2))
    one = replace(good, tests=tuple(replace(test, force_N=100.0, pressure_bar=None) for test in good.tests))
    paths: list[Any] = [
        tmp_path / "missing",
        torn,
        bad,
        lb.write_campaign(one, tmp_path / "one_force"),
        lb.write_campaign(good.plan(), tmp_path / "plan"),
        folders[0],
    ]
    done = lb.batch(paths, tmp_path / "out", model=LINEAR, ess=ESS, compare=False)
    rows = done.rows()
    assert rows["status"].tolist() == ["failed"] * 5 + ["done"]
    assert (done.done, done.failed, len(done.failures)) == (1, 5, 5)
    for reason, expected in zip(
        rows["reason"],
        ("which does not exist", "torn", "nan", "force", "must have readings to be sampled"),
        strict=False,
    ):
        assert expected in reason
        assert "\n" not in reason
    assert rows["sha256"][3] == lb.read_campaign(paths[3]).sha256
    assert np.isnan(rows["log_bayes_factor"][5])
    with pytest.raises(InputError, match="degree"):
        LINEAR.bind(lb.read_campaign(paths[3]))


@pytest.mark.parametrize(
    ("error", "message"),
    [
        (np.linalg.LinAlgError("not positive definite"), "got a numerical breakdown (not positive definite)"),
        (OverflowError("too large"), "must be within reach of double precision, got: too large"),
        (OSError(13, "Permission denied", "/x/y"), "/x/y must be usable, got: Permission denied"),
        (MemoryError("8 GB"), "must fit into memory, got: 8 GB"),
        (KeyError("a\nb"), "unexpected KeyError: 'a\\nb' (fleet/test_batch.py, line"),
        (RecursionError("too deep"), "unexpected RecursionError: too deep"),
    ],
)
def test_every_kind_of_error_is_a_reason(error: Exception, message: str, monkeypatch: pytest.MonkeyPatch) -> None:
    def broken(*_: object, **__: object) -> None:
        raise error

    monkeypatch.setattr("ldbb_bayes.fleet.row.read_campaign", broken)
    row = fit_row(Settings(model_to_toml(CONSTANT)), Job(0, "x"))
    assert row["status"] == "failed"
    assert message in row["reason"]
    assert "\n" not in row["reason"]


@pytest.mark.parametrize("code", [errno.EIO, errno.ESTALE, errno.ENOSPC, errno.EMFILE])
def test_a_sick_disk_is_no_failed_campaign(made: tuple[list[str], list[int]], code: int, monkeypatch: pytest.MonkeyPatch) -> None:
    """However deep it is in what went wrong, and where it is only seen as a campaign that is not there."""

    def broken(*_: object, **__: object) -> None:
        try:
            raise OSError(code, os.strerror(code), "/x/y")
        except OSError:
            raise InputError("the table must be readable, got nothing.") from None

    settings, paths = Settings(model_to_toml(CONSTANT)), made[0]
    with monkeypatch.context() as patch:
        patch.setattr("ldbb_bayes.fleet.row.read_campaign", broken)
        with pytest.raises(InputError, match=rf"/x/y must be usable, got: {os.strerror(code)}. That is the place, not the camp"):
            fit_row(settings, Job(0, paths[0]))

    def gone(path: object) -> None:
        raise OSError(code, os.strerror(code), path)

    monkeypatch.setattr("ldbb_bayes.fleet.places.os.stat", gone)
    with pytest.raises(InputError, match=r"p1 must be usable.*--resume"):
        fit_row(settings, Job(0, paths[1]))


def test_a_full_disk_ends_the_batch_and_keeps_what_is_done(
    folders: list[str], fitted: Batch, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    written: list[Path] = []

    def full(target: Path, content: bytes) -> None:
        if len(written) == 1:
            raise InputError(f"{target} must be writable, got: No space left on device.")
        written.append(target)
        write_whole(target, content)

    options: dict[str, Any] = {"model": LINEAR, "ess": ESS, "seed": 3, "posteriors": True, "resume": True}
    with monkeypatch.context() as patch:
        patch.setattr("ldbb_bayes.fleet.row.write_whole", full)
        with pytest.raises(InputError, match="No space left on device"):
            lb.batch(folders, tmp_path / "out", **options)
    again = lb.batch(folders, tmp_path / "out", **options)
    assert (again.fitted, again.failed) == (2, 0)
    assert dataset_bytes(again.out) == dataset_bytes(fitted.out)


def test_an_interruption_is_no_reason(monkeypatch: pytest.MonkeyPatch) -> None:
    def broken(*_: object, **__: object) -> None:
        raise KeyboardInterrupt

    monkeypatch.setattr("ldbb_bayes.fleet.row.read_campaign", broken)
    with pytest.raises(KeyboardInterrupt):
        fit_row(Settings(model_to_toml(CONSTANT)), Job(0, "x"))


def test_flat_priors_have_neither_evidence_nor_statistics(folders: list[str], tmp_path: Path) -> None:
    rows = lb.batch(folders[:1], tmp_path / "out", model=lb.HybridModel.paper(1), ess=ESS).rows()
    assert rows["status"][0] == "done"
    assert rows["gaussian_names"][0] is None
    assert np.isnan(rows["log_bayes_factor"][0])
    with pytest.raises(InputError, match="must have sufficient statistics, got none of 1"):
        fleet_statistics(rows)


def test_the_prior_of_a_population(folders: list[str], tmp_path: Path) -> None:
    """As `fit --prior-from` does, its doubts among the warnings; another machine is a row that says so."""
    told = PopulationPrior(389.0, 3, 3, {"C_XXX": 5e-5}, {"C_XXX": 4e-6}, "0" * 64, "wCAFYXZSt", (36.0, 742.0))
    done = lb.batch(folders[:1], tmp_path / "b", model=CONSTANT, prior_from=told, ess=ESS)
    (row,) = done.rows().to_dict("records")
    direct = lb.sample(told.model(CONSTANT), lb.read_campaign(folders[0]), sampler="quadrature", rule=lb.StoppingRule(ess=ESS))
    assert row["C_XXX.mean"] == lb.summarize(direct).loc["C_XXX", "mean"]
    assert any("fewer than 6" in warning for warning in row["warnings"])
    assert row["gaussian_prior_mean"][list(row["gaussian_names"]).index("C_XXX")] == 5e-5
    with pytest.raises(InputError, match=r"got population 000.* where this run has nothing"):
        lb.batch(folders[:1], tmp_path / "b", model=told.model(CONSTANT), ess=ESS, resume=True)
    other = replace(told, topology="wXYZt")
    (row,) = lb.batch(folders[:1], tmp_path / "c", model=CONSTANT, prior_from=other, ess=ESS).rows().to_dict("records")
    assert (row["status"], "topology must be the population's" in row["reason"]) == ("failed", True)


def test_a_tidy_csv_takes_what_its_table_does_not_say(tmp_path: Path) -> None:
    campaign = simulated(plan((60,) * 3, forces_N=FORCES_N))
    frame = pd.concat(
        pd.DataFrame({"test": t.name, "force_N": t.force_N, "angle_deg": t.angle_deg, "reading_um": t.reading_um})
        for t in campaign.tests
    )
    frame.to_csv(tmp_path / "t.csv", index=False)
    settings = Settings(model_to_toml(CONSTANT), ess=ESS, table={"radius_mm": 100.0})
    row = fit_row(settings, Job(0, str(tmp_path / "t.csv")))
    assert row["sha256"] == lb.read_campaign(tmp_path / "t.csv", radius_mm=100.0).sha256
    assert row["sha256"] != lb.read_campaign(tmp_path / "t.csv").sha256


def test_gather(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.chdir(tmp_path)
    for name in ("shop/b", "shop/a", "lone", "shop/none"):
        Path(name).mkdir(parents=True)
        if not name.endswith("none"):
            (Path(name) / "campaign.toml").touch()
    Path("t.csv").touch()
    Path("list.txt").write_text("# all\nshop\n\nlone # by itself\nmissing#1\n")
    odd = ("a #1", "#2", '"quoted"', '"', "b#3", "it's", 'say "x #4"')
    Path("odd").write_bytes(listed(odd))
    assert gather([*odd, "lone"]).paths == gather(["@odd", "lone"]).paths == (*odd, "lone")
    assert gather(["shop", "t.csv"]).paths == ("shop/a", "shop/b", "t.csv")
    assert gather("@list.txt").paths == ("shop/a", "shop/b", "lone", "missing#1")
    assert gather(["list.txt", tmp_path / "lone" / "campaign.toml"]).repeated == (str(tmp_path / "lone" / "campaign.toml"),)
    for given, message in (
        ([], "at least one campaign, got none"),
        (["nowhere", "there"], r"must have campaigns that exist, got none among 2 \(nowhere\)"),
        (["shop/none"], "must have campaigns that exist"),
        (["@nowhere"], "nowhere must be a list of campaigns, one path a line, got nothing"),
        (["a\nb", "lone"], "must be printable and stand on one line"),
        (["a\udcff", "lone"], "must be printable"),
    ):
        with pytest.raises(InputError, match=message):
            gather(given)


@pytest.fixture
def made(monkeypatch: pytest.MonkeyPatch, tmp_path: Path) -> tuple[list[str], list[int]]:
    """Paths that exist, and the calls of a fit that takes no time."""
    (tmp_path / "p0").mkdir()
    (tmp_path / "p0" / "campaign.toml").touch()
    calls: list[int] = []

    def fit(settings: Settings, job: Job) -> dict[str, Any]:
        calls.append(job.index)
        return made_row(settings, job)

    monkeypatch.setattr("ldbb_bayes.fleet.batch.fit_row", fit)
    return [str(tmp_path / f"p{k}") for k in range(20)], calls


def test_a_resume_does_what_is_left(made: tuple[list[str], list[int]], tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    paths, calls = made
    whole = lb.batch(paths, tmp_path / "whole")
    assert (whole.fitted, whole.failed, whole.resumed) == (20, 4, False)
    calls.clear()
    seen: list[tuple[int, int, int]] = []

    def stop(done: int, total: int, failed: int) -> None:
        seen.append((done, total, failed))
        if done == 7:
            raise KeyboardInterrupt

    with pytest.raises(KeyboardInterrupt):
        lb.batch(paths, tmp_path / "out", progress=stop)
    assert seen == [(k, 20, k // 5) for k in range(8)]
    with pytest.raises(InputError, match=r"must not hold a batch, got an unfinished one. Go on with it \(--resume"):
        lb.batch(paths, tmp_path / "out")
    with pytest.raises(InputError, match="must be a finished batch"):
        lb.read_batch(tmp_path / "out")
    again = lb.batch(paths, tmp_path / "out", resume=True)
    assert calls == list(range(20))
    assert (again.fitted, again.resumed) == (13, True)
    assert dataset_bytes(again.out) == dataset_bytes(whole.out)


def test_nothing_left(made: tuple[list[str], list[int]], tmp_path: Path) -> None:
    paths, calls = made
    out = lb.batch(paths, tmp_path / "out").out
    first = dataset_bytes(out)
    calls.clear()
    assert lb.batch(paths, out, resume=True).fitted == 0
    for part in (out / "campaigns.parquet").iterdir():
        part.unlink()
    (out / "campaigns.parquet").rmdir()
    assert lb.batch(paths, out, resume=True).fitted == 0
    assert calls == []
    assert dataset_bytes(out) == first
    with pytest.raises(InputError, match="must not hold a batch, got a finished one"):
        lb.batch(paths, out)
    assert lb.batch(paths[:3], out, force=True).campaigns == 3


def test_failed_ones_again(made: tuple[list[str], list[int]], tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    paths, calls = made
    out = lb.batch(paths, tmp_path / "out").out
    calls.clear()

    def stop(done: int, total: int, failed: int) -> None:
        if done == 18:
            raise KeyboardInterrupt

    with monkeypatch.context() as patch:
        patch.setattr("ldbb_bayes.fleet.batch.fit_row", lambda settings, job: made_row(settings, Job(0, job.path)))
        with pytest.raises(KeyboardInterrupt):
            lb.batch(paths, out, resume=True, retry=True, progress=stop)
    assert (lb.read_batch(out)["status"] == "failed").sum() == 4
    found = lb.batch(paths, out, resume=True)
    assert (found.fitted, found.failed) == (0, 2)
    assert (found.rows()["status"] == "failed").sum() == 2
    assert lb.batch(paths, out, resume=True, retry=True).fitted == 2
    assert calls == [14, 19]


def test_mended_ones_again(tmp_path: Path) -> None:
    paths = write_campaigns(tmp_path / "shop", 3)
    toml = Path(paths[2]) / "campaign.toml"
    sound = toml.read_text(encoding="utf-8")
    whose = 'machine_id = "M\\u00fc 7"\ndate = 2026-03-04\n'
    toml.write_text(whose + sound.replace("topology", "topolgy"), encoding="utf-8")
    options: dict[str, Any] = {"model": CONSTANT, "ess": ESS, "posteriors": True}
    out = lb.batch(paths, tmp_path / "out", **options).out
    first = lb.read_batch(out)
    assert first[["status", "machine_id", "date"]].iloc[2].tolist() == ["failed", "Mü 7", "2026-03-04"]
    os.utime(toml, ns=(0, 0))
    table = sorted(Path(paths[1]).glob("*.csv"))[0]
    table.write_text(table.read_text(encoding="utf-8").rstrip()[:-6] + "\n", encoding="utf-8")
    assert lb.batch(paths, out, resume=True, **options).fitted == 0
    toml.write_text(whose + sound, encoding="utf-8")
    found = lb.batch(paths, out, resume=True, retry=True, **options)
    assert (found.fitted, found.done) == (2, 3)
    rows = found.rows()
    assert rows["sha256"].iloc[0] == first["sha256"].iloc[0]
    assert rows["sha256"].iloc[1] == lb.read_campaign(paths[1]).sha256 != first["sha256"].iloc[1]
    kept = [f"{k:07d}-{own[:12]}.nc" for k, own in enumerate(rows["sha256"])]
    assert sorted(path.name for path in (out / "posteriors").iterdir()) == kept
    shutil.rmtree(paths[0])
    assert lb.batch(paths, out, resume=True, retry=True, **options).fitted == 0


def test_damaged_rows_are_done_again(made: tuple[list[str], list[int]], tmp_path: Path) -> None:
    paths, calls = made
    out = lb.batch(paths, tmp_path / "out").out
    first = dataset_bytes(out)
    journal = out / "journal" / "rows.jsonl"
    lines = journal.read_bytes().splitlines(keepends=True)
    lines[3] = lines[3][:40] + b"#" + lines[3][41:]
    journal.write_bytes(b"".join(lines)[:-30])
    calls.clear()
    again = lb.batch(paths, out, resume=True)
    assert calls == [3, 4, 9, 14, 19]
    assert (again.damaged, again.fitted) == (1, 5)
    assert dataset_bytes(out) == first
    again = lb.batch(paths, out, resume=True)
    assert (again.damaged, again.fitted) == (0, 0)


def test_a_damaged_retry_does_not_bring_the_failure_back(
    made: tuple[list[str], list[int]], tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    paths, _ = made
    out = lb.batch(paths, tmp_path / "out").out
    with monkeypatch.context() as patch:
        patch.setattr("ldbb_bayes.fleet.batch.fit_row", lambda settings, job: made_row(settings, Job(0, job.path)))
        assert lb.batch(paths, out, resume=True, retry=True).failed == 0
        first = dataset_bytes(out)
        journal = out / "journal" / "rows.jsonl"
        raw = bytearray(journal.read_bytes())
        raw[-50] ^= 1
        journal.write_bytes(raw)
        again = lb.batch(paths, out, resume=True)
        assert (again.damaged, again.fitted, again.failed) == (1, 1, 0)
        assert dataset_bytes(out) == first


@pytest.mark.parametrize(
    ("change", "message"),
    [
        ({"seed": 2}, "got seed 1 where this run has 2"),
        ({"model": CONSTANT}, "got model .* where this run has"),
        ({"ess": 500.0}, r"got effective sample size 1000.0 where this run has 500.0"),
        ({"ci_prob": 0.9}, "got probability of the intervals 0.95 where this run has 0.9"),
        ({"posteriors": True}, "got posteriors False where this run has True"),
        ({"table": {"radius_mm": 100.0}}, "got table option radius_mm nothing where this run has 100.0"),
        ({"sampler": "joint"}, "got sampler quadrature where this run has joint"),
    ],
)
def test_another_batch_is_not_resumed(
    made: tuple[list[str], list[int]], tmp_path: Path, change: dict[str, Any], message: str
) -> None:
    paths, _ = made
    lb.batch(paths, tmp_path / "out")
    with pytest.raises(InputError, match=rf"batch.json must be of this batch, {message}.*Resume with what"):
        lb.batch(paths, tmp_path / "out", resume=True, **change)


def test_other_campaigns_are_not_resumed(made: tuple[list[str], list[int]], tmp_path: Path) -> None:
    paths, _ = made
    out = lb.batch(paths, tmp_path / "out").out
    own = rf"Go on with its own list: @{out}/campaigns.txt --resume\."
    with pytest.raises(InputError, match=rf"got other campaigns \(20 where this run has 19\)\. {own}$"):
        lb.batch(paths[:-1], out, resume=True)
    with pytest.raises(InputError, match=rf"\(20 where this run has 21\)\. {own} Campaigns that are new make a batch of their"):
        lb.batch([*paths, "one more"], out, resume=True)
    assert lb.batch(f"@{out}/campaigns.txt", out, resume=True).fitted == 0
    with pytest.raises(InputError, match=r"got other campaigns \(number 1 is .*p0 where this run has .*p1\)"):
        lb.batch(paths[1::-1] + paths[2:], out, resume=True)
    (out / "batch.json").write_text("{")
    with pytest.raises(InputError, match=r"batch.json must be the record of a batch, got a damaged file. Begin anew"):
        lb.batch(paths, out, resume=True)


def test_relative_paths_are_those_of_one_folder(
    made: tuple[list[str], list[int]], tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    """The same names elsewhere are other campaigns; the table says nothing of where it was made."""
    _, calls = made
    paths, out = [f"p{k}" for k in range(20)], tmp_path / "out"
    (tmp_path / "b").mkdir()
    (tmp_path / "p0").rename(tmp_path / "b" / "p0")
    for name in ("a", "c"):
        shutil.copytree(tmp_path / "b", tmp_path / name)
    monkeypatch.chdir(tmp_path / "a")
    first = dataset_bytes(lb.batch(paths, out).out)
    monkeypatch.chdir(tmp_path / "b")
    with pytest.raises(InputError, match=rf"campaigns relative to {tmp_path}/a where this run stands in {tmp_path}/b. Go there"):
        lb.batch(paths, out, resume=True)
    assert dataset_bytes(lb.batch(paths, tmp_path / "other").out) == first
    record = out / "batch.json"
    record.write_text(record.read_text().replace(f"{tmp_path}/a", f"{tmp_path}/b"))
    calls.clear()
    assert lb.batch(paths, out, resume=True).damaged == 0
    assert calls == []


def test_the_same_said_otherwise_is_the_same_batch(made: tuple[list[str], list[int]], tmp_path: Path) -> None:
    paths, calls = made
    terms = lb.HybridModel.default(0)
    other = replace(terms, nuisances=terms.nuisances[::-1])
    out = lb.batch(paths, tmp_path / "out", model=terms, table={"radius_mm": 150}, seed=3, ess=200).out
    first = dataset_bytes(out)
    calls.clear()
    (out / "journal" / "stale").touch()
    again = lb.batch(paths, out, model=other, table={"radius_mm": 150.0}, seed=np.int64(3), ess=np.float32(200), resume=True)
    assert (again.damaged, again.fitted, calls) == (0, 0, [])
    assert dataset_bytes(out) == first


def test_parts_of_a_batch_are_not_thrown_away(made: tuple[list[str], list[int]], tmp_path: Path) -> None:
    """Without its record nobody knows what they are of; and what no batch wrote stays even with force."""
    paths, calls = made
    out = lb.batch(paths, tmp_path / "out").out
    record, rows = (out / "batch.json").read_text(), (out / "journal" / "rows.jsonl").read_bytes()
    (out / "batch.json").unlink()
    for resume in (True, False):
        with pytest.raises(InputError, match=r"got journal without batch.json. Put batch.json back and go on"):
            lb.batch(paths, out, resume=resume)
    assert (out / "journal" / "rows.jsonl").read_bytes() == rows
    (out / "batch.json").write_text(record)
    calls.clear()
    assert lb.batch(paths, out, resume=True).fitted == 0
    for name in ("posteriors/of_mine.nc", "journal/diary.txt", "campaigns.parquet/notes"):
        own = out / name
        own.parent.mkdir(exist_ok=True)
        own.touch()
        for options in ({"force": True}, {"resume": True}):
            with pytest.raises(InputError, match=f"must hold nothing but a batch, got '{name}'"):
                lb.batch(paths, out, **options)  # type: ignore[arg-type]
        own.unlink()
    (out / "posteriors" / ".0000001-0123456789ab.nc-01234567.part").touch()
    assert lb.batch(paths, out, resume=True).fitted == 0
    (tmp_path / "new" / "posteriors").mkdir(parents=True)
    (tmp_path / "new" / "posteriors" / "thesis.nc").touch()
    for options in ({}, {"resume": True}, {"force": True}):
        with pytest.raises(InputError, match=r"must hold nothing but a batch, got 'posteriors/thesis.nc'"):
            lb.batch(paths, tmp_path / "new", **options)  # type: ignore[arg-type]
    assert (tmp_path / "new" / "posteriors" / "thesis.nc").exists()


def test_what_is_refused(made: tuple[list[str], list[int]], tmp_path: Path) -> None:
    paths, calls = made
    foreign = tmp_path / "foreign"
    foreign.mkdir()
    (foreign / "thesis.tex").touch()
    (tmp_path / "file").touch()
    for options, message in (
        ({"out": foreign}, "must hold nothing but a batch, got 'thesis.tex'"),
        ({"out": foreign, "force": True}, "must hold nothing but a batch, got 'thesis.tex'"),
        ({"out": tmp_path / "file"}, "must be a folder, got a file"),
        ({"retry": True}, r"retry \(--retry\) must come with resume"),
        ({"force": True, "resume": True}, "must not come together"),
        ({"sampler": "quadratur"}, "Did you mean 'quadrature'"),
        ({"ci_prob": 1.0}, "ci_prob must lie between 0 and 1"),
        ({"ess": 0.0}, "ess must be above zero"),
        ({"seed": 2**63}, "seed must be a whole number from 0 to 2\\^63 - 1, got 9223372036854775808"),
        ({"seed": -1}, "seed must be a whole number from 0"),
    ):
        out = options.pop("out", tmp_path / "new")
        with pytest.raises(InputError, match=message):
            lb.batch(paths, out, **options)  # type: ignore[arg-type]
    assert calls == []
    assert not (tmp_path / "new").exists()
    assert [path.name for path in foreign.iterdir()] == ["thesis.tex"]


def test_two_at_once(made: tuple[list[str], list[int]], tmp_path: Path) -> None:
    paths, _ = made

    def second(done: int, total: int, failed: int) -> None:
        with pytest.raises(InputError, match="out must not be in use, got another run at work there"):
            lb.batch(paths, tmp_path / "out", resume=True)

    assert lb.batch(paths, tmp_path / "out", progress=second).campaigns == 20


def test_the_folder_is_held_until_the_workers_have_ended(made: tuple[list[str], list[int]], tmp_path: Path) -> None:
    """Those that an interruption stops may still write posteriors."""
    paths, _ = made
    told = []

    @contextmanager
    def workers() -> Iterator[None]:
        try:
            yield None
        finally:
            with pytest.raises(InputError, match="must not be in use") as refused:
                lb.batch(paths, tmp_path / "out", resume=True)
            told.append(refused.value)

    def stop(*_: int) -> None:
        raise KeyboardInterrupt

    with pytest.raises(KeyboardInterrupt):
        lb.batch(paths, tmp_path / "out", executor=workers, progress=stop)
    assert len(told) == 1
    assert lb.batch(paths, tmp_path / "out", executor=workers, resume=True).campaigns == 20


def test_workers_that_do_not_start_leave_no_folder(made: tuple[list[str], list[int]], tmp_path: Path) -> None:
    @contextmanager
    def workers() -> Iterator[None]:
        raise InputError("a cluster must answer, got silence.")
        yield

    with pytest.raises(InputError, match="got silence"):
        lb.batch(made[0], tmp_path / "out", executor=workers)
    assert not (tmp_path / "out").exists()


def test_what_a_worker_took_with_it_is_a_row(made: tuple[list[str], list[int]], tmp_path: Path) -> None:
    paths, _ = made

    class Deadly(Executor):
        """Whatever it does ends in the death of a worker."""

        def submit(self, fn: Any, /, *args: Any, **kwargs: Any) -> Any:
            from concurrent.futures import BrokenExecutor, Future

            future: Future[Any] = Future()
            if args[1].index == 1:
                future.set_exception(BrokenExecutor("gone"))
            else:
                future.set_result(fn(*args, **kwargs))
            return future

        def fresh(self) -> None:
            pass

    rows = lb.batch(paths[:3], tmp_path / "out", executor=Deadly()).rows()
    assert rows["status"].tolist() == ["done", "failed", "done"]
    assert "its worker died" in rows["reason"][1]


def test_any_order_gives_the_same_bytes(made: tuple[list[str], list[int]], tmp_path: Path) -> None:
    paths, _ = made
    one = lb.batch(paths, tmp_path / "one").out
    with ThreadPoolExecutor(8) as executor:
        other = lb.batch(paths, tmp_path / "other", executor=executor).out
    assert dataset_bytes(one) == dataset_bytes(other)


MADE = """
import os, sys, time
import ldbb_bayes as lb
import ldbb_bayes.fleet.batch as home
from batches import made_row
def fit(settings, job):
    handle = os.open(sys.argv[2], os.O_WRONLY | os.O_APPEND | os.O_CREAT)
    os.write(handle, f"{job.index}\\n".encode())
    os.close(handle)
    time.sleep(0.02)
    return made_row(settings, job)
home.fit_row = fit
lb.batch([f"p{k}" for k in range(60)], sys.argv[1], resume=True)
"""
REAL = """
import sys
import ldbb_bayes as lb
from batches import LINEAR
from ldbb_bayes.fleet.executors import process_executor
if __name__ == "__main__":
    out, *folders = sys.argv[1:]
    with process_executor(2) as executor:
        lb.batch(folders, out, model=LINEAR, ess=150.0, seed=3, posteriors=True, executor=executor, resume=True)
"""


def environment() -> dict[str, str]:
    root = Path(__file__).resolve().parents[2]
    return os.environ | {"PYTHONPATH": os.pathsep.join([str(root), str(root / "tests")]), "OPENBLAS_NUM_THREADS": "1"}


def run_script(script: Path, *arguments: object) -> subprocess.CompletedProcess[bytes]:
    command = [sys.executable, str(script), *map(str, arguments)]
    return subprocess.run(command, env=environment(), timeout=300, check=False, cwd=script.parent)


@contextmanager
def started(script: Path, *arguments: object) -> Iterator[subprocess.Popen[bytes]]:
    process = subprocess.Popen([sys.executable, str(script), *map(str, arguments)], env=environment(), cwd=script.parent)
    try:
        yield process
    finally:
        process.kill()
        process.wait()


def kill_after(process: subprocess.Popen[bytes], journal: Path, size: int, delay_s: float) -> None:
    """SIGKILL some time after the journal has passed a size."""
    deadline = time.monotonic() + 120.0
    while process.poll() is None and time.monotonic() < deadline:
        if journal.exists() and journal.stat().st_size >= size:
            time.sleep(delay_s)
            process.send_signal(signal.SIGKILL)
            process.wait()
        time.sleep(0.002)


def test_killed_at_any_moment(
    made: tuple[list[str], list[int]], tmp_path: Path, rng: np.random.Generator, monkeypatch: pytest.MonkeyPatch
) -> None:
    """Rows that take no time, killed twice: the same bytes, and at most one campaign a death is done twice."""
    script = tmp_path / "made.py"
    script.write_text(MADE)
    journal = tmp_path / "out" / "journal" / "rows.jsonl"
    for size in (1, 20_000):
        with started(script, "out", "calls") as process:
            kill_after(process, journal, size, float(rng.uniform(0.0, 0.1)))
            assert process.returncode == -signal.SIGKILL
    run_script(script, "out", "calls").check_returncode()
    calls = [int(line) for line in (tmp_path / "calls").read_text().split()]
    assert set(calls) == set(range(60))
    assert len(calls) <= 60 + 2
    monkeypatch.chdir(tmp_path)
    lb.batch([f"p{k}" for k in range(60)], "whole")
    assert dataset_bytes(tmp_path / "out") == dataset_bytes(tmp_path / "whole")


@pytest.mark.slow
def test_killed_ten_times_on_processes(fitted: Batch, folders: list[str], tmp_path: Path, rng: np.random.Generator) -> None:
    script = tmp_path / "real.py"
    script.write_text(REAL)
    journal = tmp_path / "out" / "journal" / "rows.jsonl"
    for k in range(10):
        with started(script, "out", *folders) as process:
            kill_after(process, journal, 0 if k < 5 else 1, float(rng.uniform(0.0, 4.0)))
    run_script(script, "out", *folders).check_returncode()
    assert dataset_bytes(tmp_path / "out") == dataset_bytes(fitted.out)
