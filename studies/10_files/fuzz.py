"""Every reader on mutated files: what is wrong must end as one `InputError`, in little time and
memory.

python studies/10_files/fuzz.py                      # 100 000 inputs over all readers
python studies/10_files/fuzz.py --reader layout --inputs 5000 --seed 7
"""

from __future__ import annotations

import argparse
import io
import json
import multiprocessing
import re
import resource
import signal
import sys
import tempfile
import time
import zipfile
from collections.abc import Callable, Iterator, Mapping, Sequence
from concurrent.futures import ProcessPoolExecutor
from dataclasses import asdict, dataclass
from pathlib import Path

import numpy as np

import ldbb_bayes as lb
from ldbb_bayes.analysis.comparison import read_comparison
from ldbb_bayes.analysis.design import read_design
from ldbb_bayes.inference.mcmc import StoppingRule
from ldbb_bayes.model.specification import model_to_toml, read_model, read_truths
from ldbb_bayes.reading.layout import layout_to_toml

HERE = Path(__file__).resolve().parent
sys.path.insert(0, str(HERE))
import awkward
import malformed
from command_line import run_command

INPUTS = 100_000
LIMIT_S = 2.0
LIMIT_MB = 500.0
# Pieces that mean something to some reader.
WORDS = (
    b"",
    b"\x00",
    b"\xff",
    b"\xef\xbb\xbf",
    b"\xff\xfe",
    b"\n",
    b"\r",
    b"\r\n",
    b";",
    b",",
    b"\t",
    b"|",
    b'"',
    b"'",
    b"nan",
    b"inf",
    b"-",
    b"1e999",
    b"1e308",
    b"-1e308",
    b"0",
    b"9" * 400,
    b"=1+1",
    b"[[test]]\n",
    b"[",
    b"]",
    b"{",
    b"}",
    b"a.b.c",
    b"=",
    b"angle_deg",
    b"reading_um",
    b"test",
    b"force_N",
    b"../../x",
    b"/etc/passwd",
    b"true",
    b"null",
    b"\\",
    b"\xc2\xb5",
    b"\xe2\x88\x92",
    b" ",
    b"#",
    b"1,234.5",
    b"1.234,5",
    b"Force: 1e9 N",
    b"Feed 0 mm/min",
    b"t (ms)",
    b"schema = 99\n",
    b"file = 'x.csv'\n",
    b"PK\x03\x04",
    b"\x89HDF",
)


@dataclass(frozen=True)
class Reader:
    """What is fuzzed.

    Attributes
    ----------
    name : str
        Of the file as it is written.
    seeds : sequence of bytes
    read : callable
        Reads a file; may raise `InputError`.
    share : float
        Of the inputs.
    """

    file: str
    seeds: Sequence[bytes]
    read: Callable[[Path], object]
    share: float


@dataclass(frozen=True)
class Findings:
    """Of one reader: how many inputs were read and refused, what was slowest, largest, and wrong.

    ``slowest_s`` is the longest time that passed for an input, ``slowest_cpu_s`` the longest time
    that the processor spent on one. Only the latter is limited, because the former grows when the
    machine is busy.
    """

    reader: str
    inputs: int
    read: int
    refused: int
    slowest_s: float
    slowest_cpu_s: float
    largest_mb: float
    wrong: tuple[str, ...]


def written() -> dict[str, bytes]:
    """Files of a campaign, a fit, a comparison and a design."""
    model = lb.HybridModel.first(degree=0)
    campaign = awkward.campaign()
    rule = StoppingRule(ess=1e6, block=2, max_steps=4)
    with tempfile.TemporaryDirectory() as folder:
        place = Path(folder)
        lb.write_campaign(campaign, place / "campaign")
        posterior = lb.sample(model, campaign, seed=1, walkers=48, rule=rule)
        lb.save(posterior, place / "posterior.nc")
        # Few nuisances: a comparison has the same tables, and is made in a quarter of the time.
        few_nuisances = ("--preset", "first", "--without", "discrepancy,hysteresis,setup-shift")
        for command, options in (("compare", few_nuisances), ("design", ("--tests", "4"))):
            ended = run_command(
                [command, str(place / "campaign"), "--out", str(place / command), *options]
            )
            assert ended.exit_code == 0, ended.output
        return {
            "campaign": (place / "campaign" / "campaign.toml").read_bytes(),
            "posterior": (place / "posterior.nc").read_bytes(),
            "comparison": (place / "compare" / "comparison.json").read_bytes(),
            "design": (place / "design" / "design.json").read_bytes(),
        }


def read_campaign_toml(path: Path) -> object:
    """With the tables it may name beside it."""
    for test in awkward.campaign().tests:
        table = path.parent / f"{test.name}.csv"
        if not table.exists():
            table.write_bytes(awkward.Writing().table(test))
    return lb.read_campaign(path)


def read_posterior(path: Path) -> object:
    """And what a report reads of it."""
    posterior = lb.load(path)
    return lb.summarize(posterior)


def awkward_files(suffix: str, *, ends_so: bool) -> list[bytes]:
    """Contents of the awkward files whose names end so, or of the others."""
    contents = []
    for case in awkward.CASES.values():
        for file, content in case.files.items():
            if file.endswith(suffix) == ends_so:
                contents.append(content)
    return contents


def small_malformed(suffix: str) -> list[bytes]:
    """Contents of the malformed files whose name ends so, but for the large ones."""
    contents = []
    for case in malformed.CASES.values():
        if case.file.endswith(suffix) and len(case.content) < 20_000:
            contents.append(case.content)
    return contents


def readers(package_files: Mapping[str, bytes]) -> dict[str, Reader]:
    """All of them, with what `written` wrote; shares add to one."""
    texts = awkward_files("xlsx", ends_so=False) + small_malformed("csv")
    books = awkward_files("xlsx", ends_so=True) + small_malformed("xlsx")
    tidy = b"test,force_N,angle_deg,reading_um\n" + b"".join(
        b"%d,%d,%d,1.5\n" % (k // 36, 36 + k // 36, 10 * (k % 36)) for k in range(72)
    )
    layout = layout_to_toml(lb.import_campaign(written_table()).layout).encode()
    model = model_to_toml(lb.HybridModel.first()).encode()
    truths = (
        b"schema = 1\nforces_N = [36.0, 389.0]\nreadings = 90\n[parameters]\nC_XXX ="
        b" 5e-5\n[hyper_um]\nsigma = 0.3\n"
    )
    return {
        "import, text": Reader("light 1 bar.csv", texts, lb.import_campaign, 0.40),
        "import, workbook": Reader("light 1 bar.xlsx", books, lb.import_campaign, 0.04),
        "layout": Reader("layout.toml", [layout], lb.reading.read_layout, 0.10),
        "tidy table": Reader("tidy.csv", [tidy], lb.read_campaign, 0.15),
        "campaign.toml": Reader(
            "campaign.toml", [package_files.get("campaign", b"")], read_campaign_toml, 0.08
        ),
        "model": Reader("model.toml", [model], read_model, 0.08),
        "truths": Reader("truths.toml", [truths], read_truths, 0.06),
        "comparison": Reader(
            "comparison.json", [package_files.get("comparison", b"")], read_comparison, 0.02
        ),
        "design": Reader("design.json", [package_files.get("design", b"")], read_design, 0.02),
        "posterior": Reader(
            "posterior.nc", [package_files.get("posterior", b"")], read_posterior, 0.01
        ),
    }


def written_table() -> Path:
    """A table to find a layout of."""
    path = Path(tempfile.mkdtemp()) / "light 1 bar.csv"
    path.write_bytes(awkward.CASES["14_words"].files["light 1 bar.csv"])
    return path


def mutated(raw: bytes, rng: np.random.Generator) -> bytes:
    """A few pieces changed, inserted, removed, repeated or exchanged."""
    content = bytearray(raw)
    for _ in range(int(rng.integers(1, 5))):
        size = len(content)
        at, end = sorted(int(k) for k in rng.integers(0, size + 1, 2)) if size else (0, 0)
        end = min(end, at + int(rng.integers(1, 40)))
        word = WORDS[int(rng.integers(len(WORDS)))]
        match int(rng.integers(7)):
            case 0 if size:
                content[min(at, size - 1)] ^= 1 << int(rng.integers(8))
            case 1:
                content[at:end] = word
            case 2:
                content[at:at] = word
            case 3:
                del content[at:end]
            case 4:
                content[at:at] = content[at:end] * int(rng.integers(1, 20))
            case 5:
                del content[at:]
            case _:
                lines = bytes(content).split(b"\n")
                first, second = (int(k) for k in rng.integers(0, len(lines), 2))
                lines[first], lines[second] = lines[second], lines[first]
                content = bytearray(b"\n".join(lines))
    return bytes(content)


def mutated_workbook(raw: bytes, rng: np.random.Generator) -> bytes:
    """One part of a workbook mutated, and packed again; every fourth time, or where it cannot be
    unpacked, its bytes."""
    if rng.integers(4) == 0:
        return mutated(raw, rng)
    stream = io.BytesIO()
    try:
        with zipfile.ZipFile(io.BytesIO(raw)) as old, zipfile.ZipFile(stream, "w") as new:
            names = old.namelist()
            chosen = names[int(rng.integers(len(names)))]
            for name in names:
                new.writestr(
                    name, mutated(old.read(name), rng) if name == chosen else old.read(name)
                )
    except (zipfile.BadZipFile, RuntimeError):
        return mutated(raw, rng)
    return stream.getvalue()


def fuzz(name: str, inputs: int, seed: int, package_files: Mapping[str, bytes]) -> Findings:
    """Mutated files of one reader, one after the other."""
    reader = readers(package_files)[name]
    rng = np.random.default_rng([seed, sum(name.encode())])
    read = refused = 0
    slowest = 0.0
    slowest_cpu = 0.0
    change = mutated_workbook if reader.file.endswith("xlsx") else mutated
    wrong: list[str] = []
    signal.signal(signal.SIGALRM, _too_long)
    with tempfile.TemporaryDirectory() as folder:
        path = Path(folder) / reader.file
        path.write_bytes(reader.seeds[0])
        reader.read(path)
        for k in range(inputs):
            content = change(reader.seeds[int(rng.integers(len(reader.seeds)))], rng)
            path.unlink(missing_ok=True)  # cheaper than cutting off a file that is there
            path.write_bytes(content)
            start = time.perf_counter()
            cpu_start = time.process_time()
            signal.setitimer(signal.ITIMER_REAL, 5.0 * LIMIT_S)
            try:
                reader.read(path)
                read += 1
            except lb.InputError as error:
                refused += 1
                if "\n" in str(error) or len(str(error)) > 1500:
                    wrong.append(
                        f"input {k}: a message of {len(str(error))} signs: {str(error)[:200]!r}"
                    )
            except Exception as error:  # noqa: BLE001, any other is what is looked for
                wrong.append(f"input {k}: {type(error).__name__}: {str(error)[:200]}")
                keep(name, k, content)
            finally:
                signal.setitimer(signal.ITIMER_REAL, 0.0)
            slowest = max(slowest, time.perf_counter() - start)
            cpu_spent = time.process_time() - cpu_start
            slowest_cpu = max(slowest_cpu, cpu_spent)
            if cpu_spent > LIMIT_S:
                wrong.append(f"input {k}: {cpu_spent:.1f} s of the processor")
                keep(name, k, content)
    largest = _largest_mb()
    if largest > LIMIT_MB:
        wrong.append(f"{largest:.0f} MB")
    return Findings(name, inputs, read, refused, slowest, slowest_cpu, largest, tuple(wrong))


def keep(name: str, k: int, content: bytes) -> None:
    """The input that went wrong, to look at."""
    folder = Path(tempfile.gettempdir()) / "fuzz-findings"
    folder.mkdir(exist_ok=True)
    (folder / f"{name.replace(', ', '-').replace(' ', '-')}-{k}").write_bytes(content)


def _largest_mb() -> float:
    """Of this process since it began; what getrusage says holds the process it was started from."""
    status = Path("/proc/self/status")
    if status.is_file():
        peak = re.search(r"VmHWM:\s+(\d+) kB", status.read_text())
        if peak is not None:
            return float(peak[1]) / 1024.0
    return float(resource.getrusage(resource.RUSAGE_SELF).ru_maxrss) / 1024.0


def _too_long(*_: object) -> None:
    raise TimeoutError(f"no answer in {5.0 * LIMIT_S:.0f} s")


def fuzz_all(inputs: int, seed: int, names: Sequence[str], workers: int = 2) -> Iterator[Findings]:
    """Each reader in a process of its own, so that memory is its own."""
    package_files = written()
    by_name = readers(package_files)
    context = multiprocessing.get_context("spawn")
    with ProcessPoolExecutor(workers, mp_context=context, max_tasks_per_child=1) as pool:
        total = sum(by_name[name].share for name in names)
        jobs = []
        for name in names:
            inputs_of_reader = round(inputs * by_name[name].share / total)
            jobs.append(pool.submit(fuzz, name, inputs_of_reader, seed, package_files))
        for job in jobs:
            yield job.result()


def main() -> None:
    """Fuzz and say what was found; exit code 1 when anything was."""
    parser = argparse.ArgumentParser(
        description=__doc__, formatter_class=argparse.RawTextHelpFormatter
    )
    parser.add_argument("--inputs", type=int, default=INPUTS)
    parser.add_argument("--seed", type=int, default=1)
    parser.add_argument("--reader", action="append", choices=list(readers({})))
    parser.add_argument("--write", action="store_true", help="write fuzz.json")
    options = parser.parse_args()
    wrong = 0
    rows = []
    for findings in fuzz_all(options.inputs, options.seed, options.reader or list(readers({}))):
        print(
            f"{findings.reader}: {findings.inputs} inputs, {findings.read} read,"
            f" {findings.refused} refused, slowest {findings.slowest_s:.2f} s,"
            f" {findings.largest_mb:.0f} MB, {len(findings.wrong)} wrong",
            flush=True,
        )
        for line in findings.wrong[:20]:
            print(f"  {line}")
        wrong += len(findings.wrong)
        rows.append({**asdict(findings), "wrong": len(findings.wrong)})
    if options.write:
        record = {"inputs": options.inputs, "seed": options.seed, "readers": rows}
        (HERE / "fuzz.json").write_text(json.dumps(record, indent=1) + "\n", encoding="utf-8")
    sys.exit(1 if wrong else 0)


if __name__ == "__main__":
    main()
