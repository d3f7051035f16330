"""Runs of pytest, each in a process that is forked from one with what tests import of others: it is
there at once.

The server is this file as a script, which imports none of our modules, so that each run takes those
of the tree that it is for.
"""

from __future__ import annotations

import contextlib
import importlib
import json
import os
import select
import signal
import subprocess
import sys
import time
from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import Any

IMPORTED = (
    "pytest",
    "numpy",
    "mujoco",
    "matplotlib.backends.backend_agg",
    "matplotlib.pyplot",
    "pandas",
    "pyarrow.parquet",
    "scipy.stats",
    "torch",
    "torchrl.data",
    "torchrl.envs",
)


class ForkedTests:
    """Runs of pytest with the modules and the tests of one tree."""

    def __init__(self, tree: Path, log: Path) -> None:
        paths = [*tree.glob("packages/*/src"), tree / "tests/plugins"]
        self._log = log
        self._request = {
            "folder": str(tree),
            "paths": list(map(str, paths)),
            "environment": {"PYTHONPATH": os.pathsep.join(map(str, paths))},
            "log": str(log),
        }
        self._server = subprocess.Popen(  # noqa: S603
            [sys.executable, "-P", __file__],
            env={**os.environ, "PYTHONDONTWRITEBYTECODE": "1", "OMP_NUM_THREADS": "1"},
            stdin=subprocess.PIPE,
            stdout=subprocess.PIPE,
            text=True,
        )

    def run(self, arguments: Sequence[str], quiet_s: float) -> int:
        """Run pytest; its exit code. A run that writes nothing for so long is killed."""
        assert self._server.stdin is not None
        assert self._server.stdout is not None
        self._server.stdin.write(json.dumps({**self._request, "arguments": [*arguments]}) + "\n")
        self._server.stdin.flush()
        process = int(self._server.stdout.readline())
        begin_s = time.time()
        try:
            while not select.select([self._server.stdout], [], [], 10)[0]:
                written_s = self._log.stat().st_mtime if self._log.exists() else begin_s
                if time.time() - max(begin_s, written_s) > quiet_s:
                    break
        finally:
            with contextlib.suppress(ProcessLookupError):
                os.killpg(process, signal.SIGKILL)  # also what tests have left behind
        return int(self._server.stdout.readline())

    def close(self) -> None:
        """End the server."""
        assert self._server.stdin is not None
        self._server.stdin.close()
        self._server.wait()


def serve() -> None:
    """Run what lines of JSON on the standard input ask for, one after another: ``arguments`` of
    pytest, a ``folder``, ``paths`` of modules, an ``environment``, and a ``log`` for what is
    written. Answers are the number of the process, which is the first of a group, and its exit
    code."""
    for name in IMPORTED:
        importlib.import_module(name)
    for line in sys.stdin:
        request = json.loads(line)
        process = os.fork()
        if not process:
            _run(request)
        print(process, flush=True)
        _, status = os.waitpid(process, 0)
        print(os.waitstatus_to_exitcode(status), flush=True)


def _run(request: Mapping[str, Any]) -> None:
    """Become the process that was asked for, and end it."""
    import pytest

    os.setsid()
    log = os.open(request["log"], os.O_WRONLY | os.O_CREAT | os.O_TRUNC, 0o644)
    for stream in (1, 2):
        os.dup2(log, stream)
    os.dup2(os.open(os.devnull, os.O_RDONLY), 0)
    os.chdir(request["folder"])
    os.environ.update(request["environment"])
    sys.path[:0] = request["paths"]
    sys.argv = ["pytest"]
    sys.exit(pytest.main(request["arguments"]))


if __name__ == "__main__":
    serve()
