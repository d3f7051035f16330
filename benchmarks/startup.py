"""Start-up time of commands: from the start of a new process to its end, or of a page to the moment
at which its robot moves.

    python -m benchmarks startup

Each command runs several times in its own process; medians of wall time and of CPU time, which is
independent of other load. The program prints one word. `hub check` without a hub ends when it has
found none. `demo` plays a policy of arrays, without TorchRL; `play RUN --page` an agent of TorchRL,
here one that has had a single episode. Takes about two minutes.
"""

from __future__ import annotations

import os
import re
import signal
import statistics
import subprocess
import sys
import tempfile
import time
from pathlib import Path
from typing import Any

from websockets.sync.client import connect
from websockets.typing import Origin

from benchmarks.session import Session

COMMANDS = (
    "--help",
    "list",
    "hub run --help",
    "hub run PROGRAM --robot bench",
    "hub run PROGRAM --robot two-wheeler",
    "hub check RunAway-v0 --yes",
    "hub check RunAway-v0 --yes --hub virtual",
)
PAGES = ("demo Walker-v1", "play RUN --page")
POSE = 1
"""First byte of a message that says where the parts of the robot are."""
LONGEST_S = 60.0


def measure(arguments: list[str], runs: int) -> dict[str, Any]:
    """Median times over ``runs`` runs, after one that warms up."""
    wall_s, cpu_s = [], []
    for _ in range(runs + 1):
        before, start_s = _children_s(), time.perf_counter()
        subprocess.run(  # noqa: S603 - our own command
            [sys.executable, "-m", "bricksrl", *arguments],
            stdin=subprocess.DEVNULL,
            capture_output=True,
            check=False,
        )
        wall_s.append(time.perf_counter() - start_s)
        cpu_s.append(_children_s() - before)
    return {
        "wall_s": round(statistics.median(wall_s[1:]), 3),
        "cpu_s": round(statistics.median(cpu_s[1:]), 3),
    }


def first_seconds(arguments: list[str], runs: int) -> dict[str, Any]:
    """Median seconds until a page answers, and until its robot moves, over ``runs`` runs after one
    that warms up."""
    found = [_first_seconds(arguments) for _ in range(runs + 1)][1:]
    names = ("page_s", "motion_s")
    return {
        name: round(statistics.median(values), 3)
        for name, values in zip(names, zip(*found, strict=True), strict=True)
    }


def _first_seconds(arguments: list[str]) -> tuple[float, float]:
    """Seconds until a page answers, and until its robot moves."""
    start_s = time.perf_counter()
    process = subprocess.Popen(  # noqa: S603 - our own command
        [sys.executable, "-u", "-m", "bricksrl", *arguments],
        stdin=subprocess.DEVNULL,
        stdout=subprocess.PIPE,
        stderr=subprocess.STDOUT,
        text=True,
    )
    try:
        assert process.stdout is not None
        url = next(found[0] for line in process.stdout if (found := re.search(r"http://\S+", line)))
        host, query = url.split("/")[2], url.partition("?")[2]
        origin = Origin(f"http://{host}")
        with connect(f"ws://{host}/ws?{query}", origin=origin, max_size=None) as socket:
            page_s = time.perf_counter() - start_s
            poses: set[bytes] = set()
            while len(poses) < 2:
                message = socket.recv(timeout=LONGEST_S)
                if isinstance(message, bytes) and message[0] == POSE:
                    poses.add(message)
            return page_s, time.perf_counter() - start_s
    finally:
        process.send_signal(signal.SIGINT)
        process.wait(LONGEST_S)


def _children_s() -> float:
    """CPU time of the processes that have ended."""
    used = os.times()
    return used.children_user + used.children_system


def main(session: Session) -> None:
    """Measure all commands and write the medians."""
    args = session.parse(runs=7)
    with tempfile.TemporaryDirectory() as folder:
        program = Path(folder) / "main.py"
        program.write_text("print('hello')\n")
        results = {}
        for words in COMMANDS:
            results[words] = measure(
                [str(program) if word == "PROGRAM" else word for word in words.split()], args.runs
            )
            print(
                f"{results[words]['wall_s']:.2f} s wall, {results[words]['cpu_s']:.2f} s CPU  "
                f"bricksrl {words}"
            )
        run = Path(folder) / "run"
        training = ["train", "Walker-v1", "--episodes", "1", "--run", str(run)]
        subprocess.run(  # noqa: S603 - our own command
            [sys.executable, "-m", "bricksrl", *training], capture_output=True, check=True
        )
        pages = {}
        for words in PAGES:
            pages[words] = first_seconds(
                [str(run) if word == "RUN" else word for word in words.split()], args.runs
            )
            print(
                f"{pages[words]['page_s']:.2f} s to the page, {pages[words]['motion_s']:.2f} s to "
                f"the first motion  bricksrl {words}"
            )
    session.write({"commands": results, "pages": pages})
