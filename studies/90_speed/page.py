"""What the page of `ldbb-bayes app` takes, on Linux: seconds until it is there, memory with
sessions that have read, fitted and planned, seconds of an answer to a slider, of a fit and of the
best forces. By hand; a few minutes.

    python studies/90_speed/page.py [SESSIONS]
"""

from __future__ import annotations

import http.client
import json
import re
import signal
import statistics
import subprocess
import sys
import time
from contextlib import closing, suppress
from pathlib import Path
from typing import Any
from urllib.parse import urlsplit


def ask(
    method: str, address: str, path: str = "", record: Any = None
) -> tuple[http.client.HTTPResponse, bytes]:
    """An answer and its content."""
    own = urlsplit(address)
    headers = {} if method == "GET" else {"Origin": f"http://{own.netloc}"}
    with closing(http.client.HTTPConnection(own.netloc, timeout=300)) as link:
        link.request(
            method, own.path + path, None if record is None else json.dumps(record), headers
        )
        answer = link.getresponse()
        return answer, answer.read()


def memory_mb(process: int) -> float:
    """Proportional set size of a process and all that it has started [MB]."""
    parents: dict[int, list[int]] = {}
    for stat in Path("/proc").glob("[0-9]*/stat"):
        with suppress(OSError):
            parents.setdefault(int(stat.read_text().rpartition(")")[2].split()[1]), []).append(
                int(stat.parent.name)
            )
    tree = [process]
    total = 0
    for own in tree:
        tree += parents.get(own, [])
        with suppress(OSError):
            rollup = Path(f"/proc/{own}/smaps_rollup").read_text()
            total += sum(int(size) for size in re.findall(r"^Pss:\s+(\d+)", rollup, re.MULTILINE))
    return total / 1024


def opened(address: str) -> str:
    """The address of a new session."""
    answer, _ = ask("GET", address)
    return f"http://{urlsplit(address).netloc}{answer.getheader('location')}"


def main(sessions: int) -> None:
    command = [sys.executable, "-m", "ldbb_bayes", "app", "--no-browser"]
    start = time.monotonic()
    with subprocess.Popen(command, stdout=subprocess.PIPE, text=True) as running:
        assert running.stdout is not None
        address = running.stdout.readline().strip()
        ask("GET", opened(address))
        print(f"start to page {time.monotonic() - start:.2f} s")
        tabs = [opened(address) for _ in range(sessions)]
        for tab in tabs:
            ask("POST", tab, "example")
            for part in ("understood", "worth"):
                ask("GET", tab, f"part/{part}")
        print(f"memory, {sessions} sessions understood: {memory_mb(running.pid):.0f} MB")
        fits = []
        highest = 0.0
        for tab in tabs:
            begun = time.monotonic()
            ask("POST", tab, "fit")
            while json.loads(ask("GET", tab, "state?tab=1")[1])["running"]:
                highest = max(highest, memory_mb(running.pid))
                for other in tabs:  # each page asks now and then; a silent one is ended
                    ask("GET", other, "state?tab=1")
                time.sleep(0.2)
            fits.append(time.monotonic() - begun)
        print(
            f"a fit {statistics.median(fits):.1f} s; memory while one of {sessions} fits:"
            f" {highest:.0f} MB at most"
        )
        sliders = []
        best = []
        for tab in tabs:
            ask("GET", tab, "part/plan")
            for asked in ({"circles": circles, "fine": False} for circles in (6, 8, 10, 12)):
                begun = time.monotonic()
                ask("POST", tab, "plan", asked)
                sliders.append(time.monotonic() - begun)
            begun = time.monotonic()
            ask("POST", tab, "plan", {"circles": 6, "best": True})
            best.append(time.monotonic() - begun)
        print(f"a slider {statistics.median(sliders):.2f} s, {max(sliders):.2f} s at most")
        print(f"best forces {statistics.median(best):.1f} s")
        print(f"memory, {sessions} sessions fitted and planned: {memory_mb(running.pid):.0f} MB")
        running.send_signal(signal.SIGINT)


if __name__ == "__main__":
    main(int(sys.argv[1]) if len(sys.argv) > 1 else 10)
