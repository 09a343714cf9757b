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

# Numbers of circles that the slider is moved to.
SLIDER_CIRCLES = (6, 8, 10, 12)


def ask(
    method: str, address: str, path: str = "", record: Any = None
) -> tuple[http.client.HTTPResponse, bytes]:
    """An answer and its content."""
    url = urlsplit(address)
    headers = {}
    if method != "GET":
        headers = {"Origin": f"http://{url.netloc}"}
    body = None
    if record is not None:
        body = json.dumps(record)
    with closing(http.client.HTTPConnection(url.netloc, timeout=300)) as link:
        link.request(method, url.path + path, body, headers)
        answer = link.getresponse()
        return answer, answer.read()


def seconds_of(method: str, address: str, path: str, record: Any = None) -> float:
    """Seconds until an answer is there."""
    start = time.monotonic()
    ask(method, address, path, record)
    return time.monotonic() - start


def children_by_process() -> dict[int, list[int]]:
    """Numbers of the processes that each process has started."""
    children: dict[int, list[int]] = {}
    for stat in Path("/proc").glob("[0-9]*/stat"):
        with suppress(OSError):
            parent = int(stat.read_text().rpartition(")")[2].split()[1])
            children.setdefault(parent, []).append(int(stat.parent.name))
    return children


def memory_MB(process: int) -> float:
    """Proportional set size of a process and all that it has started [MB]."""
    children = children_by_process()
    waiting = [process]
    total_kB = 0
    while waiting:
        member = waiting.pop()
        waiting += children.get(member, [])
        with suppress(OSError):
            rollup = Path(f"/proc/{member}/smaps_rollup").read_text()
            sizes = re.findall(r"^Pss:\s+(\d+)", rollup, re.MULTILINE)
            total_kB += sum(int(size) for size in sizes)
    return total_kB / 1024


def opened(address: str) -> str:
    """The address of a new session."""
    answer, _ = ask("GET", address)
    return f"http://{urlsplit(address).netloc}{answer.getheader('location')}"


def read_example(tab: str) -> None:
    """Read the example and look at what is understood of it."""
    ask("POST", tab, "example")
    for section in ("understood", "worth"):
        ask("GET", tab, f"part/{section}")


def is_fitting(tab: str) -> bool:
    """Whether a session still fits."""
    _, content = ask("GET", tab, "state?tab=1")
    return bool(json.loads(content)["running"])


def fit_one_by_one(tabs: list[str], process: int) -> None:
    """Fit in every session, one after the other, and print seconds and memory."""
    fits_s = []
    highest_MB = 0.0
    for tab in tabs:
        start = time.monotonic()
        ask("POST", tab, "fit")
        while is_fitting(tab):
            highest_MB = max(highest_MB, memory_MB(process))
            for other in tabs:  # each page asks now and then; a silent one is ended
                ask("GET", other, "state?tab=1")
            time.sleep(0.2)
        fits_s.append(time.monotonic() - start)
    print(
        f"a fit {statistics.median(fits_s):.1f} s; memory while one of {len(tabs)} fits:"
        f" {highest_MB:.0f} MB at most"
    )


def plan_one_by_one(tabs: list[str]) -> None:
    """Move the slider and ask for the best forces in every session, and print seconds."""
    sliders_s = []
    best_s = []
    for tab in tabs:
        ask("GET", tab, "part/plan")
        for circles in SLIDER_CIRCLES:
            sliders_s.append(seconds_of("POST", tab, "plan", {"circles": circles, "fine": False}))
        best_s.append(seconds_of("POST", tab, "plan", {"circles": 6, "best": True}))
    print(f"a slider {statistics.median(sliders_s):.2f} s, {max(sliders_s):.2f} s at most")
    print(f"best forces {statistics.median(best_s):.1f} s")


def main(sessions: int) -> None:
    """Start the page, and go through all sessions: read, fit, plan."""
    command = [sys.executable, "-m", "ldbb_bayes", "app", "--no-browser"]
    start = time.monotonic()
    with subprocess.Popen(command, stdout=subprocess.PIPE, text=True) as running:
        assert running.stdout is not None
        address = running.stdout.readline().strip()
        ask("GET", opened(address))
        print(f"start to page {time.monotonic() - start:.2f} s")
        tabs = [opened(address) for _ in range(sessions)]
        for tab in tabs:
            read_example(tab)
        print(f"memory, {sessions} sessions understood: {memory_MB(running.pid):.0f} MB")
        fit_one_by_one(tabs, running.pid)
        plan_one_by_one(tabs)
        print(f"memory, {sessions} sessions fitted and planned: {memory_MB(running.pid):.0f} MB")
        running.send_signal(signal.SIGINT)


if __name__ == "__main__":
    main(int(sys.argv[1]) if len(sys.argv) > 1 else 10)
