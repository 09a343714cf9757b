"""Long runs: resumed to the last bit, and damaged or foreign blocks refused by name."""

from __future__ import annotations

import os
from collections.abc import Callable
from dataclasses import replace
from functools import partial
from pathlib import Path

import numpy as np
import pytest
import xarray as xr
from campaigns import plan, simulated

import ldbb_bayes as lb
from ldbb_bayes.errors import InputError
from ldbb_bayes.inference.checkpoint import remove_checkpoint
from ldbb_bayes.inference.ensemble import Progress
from ldbb_bayes.inference.stopping import StoppingRule

MODEL = lb.HybridModel.default(0)
RULE = StoppingRule(ess=1500.0, rhat=1.3, block=5, lengths=0.1)
run = partial(lb.sample, walkers=48)


@pytest.fixture(scope="module")
def campaign() -> lb.Campaign:
    return simulated(plan())


def same(first: xr.DataTree, second: xr.DataTree) -> bool:
    groups = ("posterior", "sample_stats", "log_likelihood")
    return all(first[name].dataset.drop_attrs().equals(second[name].dataset.drop_attrs()) for name in groups)


def stop_after(looks: int) -> Callable[[Progress], None]:
    seen: list[Progress] = []

    def stop(state: Progress) -> None:
        seen.append(state)
        if len(seen) == looks:
            raise KeyboardInterrupt

    return stop


@pytest.mark.parametrize("sampler", ["joint", "collapsed"])
def test_resumed_is_uninterrupted_to_the_last_bit(campaign: lb.Campaign, tmp_path: Path, sampler: str) -> None:
    whole = run(MODEL, campaign, sampler=sampler, seed=4, rule=RULE)
    folder = tmp_path / "run"
    for looks in (1, 2):
        with pytest.raises(KeyboardInterrupt):
            run(MODEL, campaign, sampler=sampler, seed=4, rule=RULE, progress=stop_after(looks), checkpoint=folder, resume=True)
    assert len(list(folder.iterdir())) == 2
    resumed = run(MODEL, campaign, sampler=sampler, seed=4, rule=RULE, checkpoint=folder, resume=True)
    assert same(whole, resumed)
    assert len(list(folder.iterdir())) > 2
    again = run(MODEL, campaign, sampler=sampler, seed=4, rule=RULE, checkpoint=folder, resume=True)
    assert same(whole, again)


def test_a_raised_target_goes_on_where_the_run_ended(campaign: lb.Campaign, tmp_path: Path) -> None:
    more = replace(RULE, ess=2500.0)
    run(MODEL, campaign, seed=4, rule=replace(RULE, max_steps=10, ess=1e6), checkpoint=tmp_path / "run")
    further = run(MODEL, campaign, seed=4, rule=more, checkpoint=tmp_path / "run", resume=True)
    assert same(further, run(MODEL, campaign, seed=4, rule=more))


def test_what_is_there_is_not_begun_anew(campaign: lb.Campaign, tmp_path: Path) -> None:
    run(MODEL, campaign, seed=4, rule=RULE, checkpoint=tmp_path / "run")
    with pytest.raises(InputError, match=r"run must not hold an unfinished run, got \d+ of its blocks.*--resume"):
        run(MODEL, campaign, seed=4, rule=RULE, checkpoint=tmp_path / "run")
    (tmp_path / "run" / "notes.txt").write_text("mine")
    remove_checkpoint(tmp_path / "run")
    assert [path.name for path in (tmp_path / "run").iterdir()] == ["notes.txt"]


@pytest.mark.parametrize(
    ("change", "message"),
    [
        ({"seed": 5}, r"block-00000\.npz must be of this run, got seed 4 where this run has 5"),
        ({"walkers": 66}, r"must be of this run, got walkers 48 where this run has 66"),
        ({"sampler": "collapsed"}, r"got sampler joint where this run has collapsed"),
        ({"model": MODEL.without("mount")}, r"must be of this run, got model [0-9a-f]{64} where"),
        ({"campaign": simulated(plan(), seed=2)}, r"must be of this run, got campaign [0-9a-f]{64} where"),
    ],
)
def test_foreign_blocks_are_refused(campaign: lb.Campaign, tmp_path: Path, change: dict, message: str) -> None:
    given = {"model": MODEL, "campaign": campaign, "seed": 4, "rule": RULE}
    run(**given, checkpoint=tmp_path / "run")
    with pytest.raises(InputError, match=message):
        run(**(given | change), checkpoint=tmp_path / "run", resume=True)


@pytest.mark.parametrize("damage", ["short", "flipped", "other", "empty", "folder"])
def test_damaged_blocks_are_refused_by_name(campaign: lb.Campaign, tmp_path: Path, damage: str) -> None:
    folder = tmp_path / "run"
    whole = run(MODEL, campaign, seed=4, rule=RULE, checkpoint=folder)
    block = folder / "block-00001.npz"
    content = bytearray(block.read_bytes())
    if damage == "flipped":
        content[len(content) // 2] ^= 0xFF
    ruined = {"short": bytes(content[: len(content) // 2]), "flipped": bytes(content), "other": b"not a block", "empty": b""}
    block.unlink()
    if damage == "folder":
        block.mkdir()
    else:
        block.write_bytes(ruined[damage])
    with pytest.raises(InputError, match=r"block-00001\.npz must be a block of a run, got a damaged file"):
        run(MODEL, campaign, seed=4, rule=RULE, checkpoint=folder, resume=True)
    block.rmdir() if damage == "folder" else block.unlink()
    assert same(whole, run(MODEL, campaign, seed=4, rule=RULE, checkpoint=folder, resume=True))


def test_a_block_that_does_not_follow_is_refused(campaign: lb.Campaign, tmp_path: Path) -> None:
    run(MODEL, campaign, seed=4, rule=RULE, checkpoint=tmp_path / "run")
    (tmp_path / "run" / "block-00001.npz").write_bytes((tmp_path / "run" / "block-00000.npz").read_bytes())
    with pytest.raises(InputError, match=r"block-00001\.npz must follow the block before it"):
        run(MODEL, campaign, seed=4, rule=RULE, checkpoint=tmp_path / "run", resume=True)


def test_a_block_holds_nothing_but_numbers(campaign: lb.Campaign, tmp_path: Path) -> None:
    run(MODEL, campaign, seed=4, rule=RULE, checkpoint=tmp_path / "run")
    with np.load(tmp_path / "run" / "block-00000.npz", allow_pickle=False) as block:
        assert all(block[name].dtype.kind in "iufU" for name in block.files)


def rewritten(path: Path, **arrays: object) -> None:
    """A block with other arrays, its header as it was."""
    with np.load(path, allow_pickle=False) as file:
        content = {name: file[name] for name in file.files}
    with path.open("wb") as out:
        np.savez(out, **(content | arrays))


@pytest.mark.parametrize("change", ["shape", "nan", "random", "fifo"])
def test_a_block_of_other_numbers_is_refused(campaign: lb.Campaign, tmp_path: Path, change: str) -> None:
    folder = tmp_path / "run"
    with pytest.raises(KeyboardInterrupt):
        run(MODEL, campaign, sampler="joint", seed=4, rule=RULE, progress=stop_after(1), checkpoint=folder, resume=True)
    (block,) = folder.iterdir()
    with np.load(block, allow_pickle=False) as file:
        chain, coords, random = file["chain"], file["coords"], file["random"]
    if change == "fifo":
        block.unlink()
        os.mkfifo(block)
    else:
        new = {"shape": {"chain": chain[0]}, "nan": {"coords": coords * np.nan}, "random": {"random": 0 * random}}[change]
        rewritten(block, **new)
    with pytest.raises(InputError, match=f"{block.name} must be a block of a run, got a damaged file"):
        run(MODEL, campaign, sampler="joint", seed=4, rule=RULE, checkpoint=folder, resume=True)
