"""A command that is killed while its processes train."""

from __future__ import annotations

import subprocess
import sys
import time
from pathlib import Path


def assert_runs_end_with(arguments: list[str], folder: Path, module: str = "bricksrl") -> None:
    """Start a module's command, kill it when it has two runs in ``folder``, and check that these do
    not go on."""
    command = [sys.executable, "-m", module, *arguments]
    with subprocess.Popen(command, stdout=subprocess.DEVNULL) as process:
        try:
            while len(metrics := list(folder.rglob("seed-*/metrics.csv"))) < 2:
                assert process.poll() is None
                time.sleep(0.1)
        finally:
            process.kill()
    time.sleep(2.0)
    before = [path.read_bytes() for path in metrics]
    time.sleep(4.0)  # several episodes
    assert [path.read_bytes() for path in metrics] == before
