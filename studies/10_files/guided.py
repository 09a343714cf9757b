"""A coverage-guided hunt: inputs that reach new lines of a reader are kept and mutated further.

pip install atheris    # Python 3.11; libFuzzer inside
python studies/10_files/guided.py --seconds 600 --write    # by hand: writes guided.json
"""

from __future__ import annotations

import argparse
import json
import re
import subprocess
import sys
import tempfile
from pathlib import Path
from typing import Any

HERE = Path(__file__).resolve().parent
READERS = ("import, text", "import, workbook", "layout", "tidy table", "campaign.toml", "truths")
# Of memory, with what libFuzzer itself gathers (1 kB an input with pandas, which without it stays
# flat): `fuzz.py` measures.
LIMIT_S = 2
LIMIT_MB = 1000
LONGEST = 20_000
# What libFuzzer says at the end.
_SAID = {
    "inputs": r"stat::number_of_executed_units:\s+(\d+)",
    "largest_mb": r"stat::peak_rss_mb:\s+(\d+)",
}


def hunt(name: str, corpus: Path, seconds: int) -> None:
    """In a process of its own: libFuzzer ends it."""
    import atheris

    with atheris.instrument_imports(
        include=[
            "ldbb_bayes.campaign",
            "ldbb_bayes.reading",
            "ldbb_bayes.files",
            "ldbb_bayes.model.specification",
        ]
    ):
        import ldbb_bayes.campaign.folder
        import ldbb_bayes.model.specification
        import ldbb_bayes.reading.importing
    sys.path.insert(0, str(HERE))
    from fuzz import readers

    import ldbb_bayes as lb

    reader = readers({})[name]
    seeds = reader.seeds if any(reader.seeds) else [lb_campaign_toml()]
    for k, seed in enumerate(seeds):
        (corpus / f"seed-{k}").write_bytes(seed)
    path = Path(tempfile.mkdtemp()) / reader.file

    def one(content: bytes) -> None:
        path.write_bytes(content)
        try:
            reader.read(path)
        except lb.InputError:
            return

    options = [
        f"-max_total_time={seconds}",
        f"-timeout={LIMIT_S}",
        f"-rss_limit_mb={LIMIT_MB}",
        f"-max_len={LONGEST}",
    ]
    atheris.Setup(
        [
            sys.argv[0],
            *options,
            "-print_final_stats=1",
            "-seed=1",
            f"-artifact_prefix={corpus}/found-",
            str(corpus),
        ],
        one,
    )
    atheris.Fuzz()


def lb_campaign_toml() -> bytes:
    """A campaign.toml as the package writes it."""
    import awkward

    import ldbb_bayes as lb

    with tempfile.TemporaryDirectory() as folder:
        lb.write_campaign(awkward.campaign(), Path(folder) / "campaign")
        return (Path(folder) / "campaign" / "campaign.toml").read_bytes()


def hunted(name: str, seconds: int) -> dict[str, Any]:
    """What libFuzzer found: inputs run, lines' edges first and last, what was wrong."""
    with tempfile.TemporaryDirectory() as corpus:
        ended = subprocess.run(
            [
                sys.executable,
                __file__,
                "--reader",
                name,
                "--corpus",
                corpus,
                "--seconds",
                str(seconds),
            ],
            capture_output=True,
            text=True,
            errors="replace",
            check=False,
        )
        covered = [int(value) for value in re.findall(r"cov: (\d+)", ended.stderr)]
        numbers = {}
        for key, sign in _SAID.items():
            match = re.search(sign, ended.stderr)
            numbers[key] = int(match[1]) if match else 0
        wrong = sorted(path.name for path in Path(corpus).glob("found-*"))
        last_lines = []
        if ended.returncode:
            last_lines = ended.stderr.strip().splitlines()[-25:]
    edges = {
        "edges_at_first": covered[0] if covered else 0,
        "edges_at_last": covered[-1] if covered else 0,
    }
    return {
        "reader": name,
        "seconds": seconds,
        **numbers,
        **edges,
        "wrong": wrong,
        "said": last_lines,
    }


def main() -> None:
    """Hunt through all readers one after the other."""
    parser = argparse.ArgumentParser(
        description=__doc__, formatter_class=argparse.RawTextHelpFormatter
    )
    parser.add_argument("--seconds", type=int, default=600, help="of each reader")
    parser.add_argument("--write", action="store_true", help="write guided.json")
    parser.add_argument("--reader", choices=READERS, help=argparse.SUPPRESS)
    parser.add_argument("--corpus", type=Path, help=argparse.SUPPRESS)
    options = parser.parse_args()
    if options.corpus:
        hunt(options.reader, options.corpus, options.seconds)
        return
    hunts = []
    for name in READERS:
        hunts.append(hunted(name, options.seconds))
        print(json.dumps(hunts[-1], indent=1), flush=True)
    if options.write:
        (HERE / "guided.json").write_text(json.dumps(hunts, indent=1) + "\n", encoding="utf-8")
    sys.exit(1 if any(hunt["wrong"] for hunt in hunts) else 0)


if __name__ == "__main__":
    main()
