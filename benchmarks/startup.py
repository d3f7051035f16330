"""Start-up time of commands: from the start of a new process to its end.

    python -m benchmarks startup

Each command runs several times in its own process; medians of wall time and of CPU time, which is
independent of other load. The program prints one word. `hub check` without a hub ends when it has
found none. Takes about a minute.
"""

from __future__ import annotations

import os
import statistics
import subprocess
import sys
import tempfile
import time
from pathlib import Path
from typing import Any

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
    session.write({"commands": results})
