"""The real command in a process."""

from __future__ import annotations

import os
import re
import subprocess
import sys
from collections.abc import Callable, Iterator
from pathlib import Path

import pytest
from forked import CAN_FORK, ForkServer

from bricksrl.cli import main

Bricksrl = Callable[..., "subprocess.CompletedProcess[str]"]
EXECUTABLE = str(Path(sys.executable).with_name("bricksrl"))


@pytest.fixture(scope="session")
def bricksrl(tmp_path_factory: pytest.TempPathFactory, request: pytest.FixtureRequest) -> Bricksrl:
    """Run ``bricksrl`` in a folder of the session: in a process of its own, from scratch where a
    test sets its environment."""
    folder = tmp_path_factory.mktemp("cli")

    def run(
        *arguments: str, timeout_s: float = 120.0, **environment: str
    ) -> subprocess.CompletedProcess[str]:
        whole = {**os.environ, "MUJOCO_GL": "disable", **environment}
        if CAN_FORK and not environment:
            server: ForkServer = request.getfixturevalue("forked")
            return server.run(arguments, folder, whole, timeout_s)
        command = [EXECUTABLE, *arguments]
        return subprocess.run(
            command,
            cwd=folder,
            env=whole,
            capture_output=True,
            text=True,
            timeout=timeout_s,
            check=False,
        )

    return run


@pytest.fixture
def fails(capfd: pytest.CaptureFixture[str]) -> Callable[..., None]:
    """Expect exit code 2 and one error line that contains ``says``."""

    def run(*arguments: str, says: str) -> None:
        try:
            code: int | str | None = main(arguments)
        except SystemExit as end:
            code = end.code
        written = capfd.readouterr()
        assert (code, written.out) == (2, "")
        assert re.fullmatch(r"error: [^\n]+\n", written.err), written.err
        assert says in written.err

    return run


@pytest.fixture
def start(
    tmp_path_factory: pytest.TempPathFactory, request: pytest.FixtureRequest
) -> Iterator[Callable[..., subprocess.Popen[str]]]:
    """Start ``bricksrl`` in the background until the end of the test."""
    folder = tmp_path_factory.mktemp("cli-started")
    started: list[subprocess.Popen[str]] = []

    def popen(*arguments: str) -> subprocess.Popen[str]:
        environment, pipe = {**os.environ, "MUJOCO_GL": "disable"}, subprocess.PIPE
        if CAN_FORK:
            server: ForkServer = request.getfixturevalue("forked")
            started.append(
                server.start(
                    arguments, (None, pipe, pipe), folder=str(folder), environment=environment
                )
            )
        else:
            command = [EXECUTABLE, *arguments]
            started.append(
                subprocess.Popen(
                    command, cwd=folder, env=environment, stdout=pipe, stderr=pipe, text=True
                )
            )
        return started[-1]

    yield popen
    for process in started:
        if process.poll() is None:
            process.terminate()  # first, so that it ends what it has started itself
            try:
                process.communicate(timeout=20)
            except subprocess.TimeoutExpired:
                process.kill()
        process.communicate()


@pytest.fixture(scope="session")
def trained(
    bricksrl: Bricksrl, tmp_path_factory: pytest.TempPathFactory
) -> tuple[Path, subprocess.CompletedProcess[str]]:
    """Folder and output of a short run."""
    run_dir = tmp_path_factory.mktemp("runs") / "short"
    command = ["train", "RunAway-v0", "--episodes", "4", "--seed", "3", "--run", str(run_dir)]
    tiny = ["--set", "hidden=8", "--set", "batch_size=8", "--set", "updates_per_step=0.1"]
    return run_dir, bricksrl(*command, *tiny)
