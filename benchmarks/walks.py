"""Walks: the files of the packages that hold a value on its way from the command line to its
effect.

    python -m benchmarks walks

A frame holds a value that is one of its variables, or an attribute of its ``self``. The values: a
run's configuration (any object of its class), `--seed` and `--episodes` (a number that occurs
nowhere else), `--randomize` (a variable of that name that is true, and the sampler of physics that
it makes). `python -m benchmarks tables` writes the result into docs/architecture.md.
"""

from __future__ import annotations

import os
import signal
import sys
import tempfile
import threading
from collections.abc import Callable, Iterator
from contextlib import contextmanager, redirect_stderr, redirect_stdout
from io import StringIO
from pathlib import Path
from types import FrameType
from typing import Any

from benchmarks.session import Session

ROOT = Path(__file__).parent.parent
MARK = 9_876_543
INTERRUPT_S = 40.0
"""Time after which the endless run is interrupted, as by Ctrl-C."""
Holds = Callable[[str, Any], bool]
"""Whether a variable of this name and value is looked for."""


@contextmanager
def walked(holds: Holds) -> Iterator[dict[str, None]]:
    """Files, in the order of first appearance, whose frames hold a value inside this context."""
    files: dict[str, None] = {}
    places: dict[str, str | None] = {}

    def look(frame: FrameType, event: str, _: Any) -> None:
        name = frame.f_code.co_filename
        if name not in places:
            _, found, inner = name.partition(f"{os.sep}src{os.sep}")
            places[name] = inner if found and name.startswith(str(ROOT)) else None
        place = places[name]
        if event not in ("call", "return") or place is None or place in files:
            return
        variables = frame.f_locals
        own = getattr(variables.get("self"), "__dict__", {})
        if any(holds(key, value) for held in (variables, own) for key, value in held.items()):
            files[place] = None

    threading.setprofile(look)
    sys.setprofile(look)
    try:
        yield files
    finally:
        sys.setprofile(None)
        threading.setprofile(None)


def walk(holds: Holds, *words: str, is_endless: bool = False) -> list[str]:
    """The files that hold a value while a robot is trained for two episodes, evaluated and reported
    on."""
    from bricksrl.cli import main as command

    if is_endless:
        timer = threading.Timer(INTERRUPT_S, os.kill, (os.getpid(), signal.SIGINT))
        timer.daemon = True
        timer.start()
    with (
        tempfile.TemporaryDirectory() as folder,
        redirect_stdout(StringIO()),
        redirect_stderr(StringIO()) as said,
    ):
        run = (
            "train",
            "RunAway-v0",
            *words,
            "--run",
            f"{folder}/run",
            "--set",
            "prefill_episodes=1",
            "--set",
            "hidden=16",
        )
        with walked(holds) as files:
            code = command(run)
    assert code == (130 if is_endless else 0), said.getvalue()
    return list(files)


def measure() -> dict[str, list[str]]:
    """The files of each walk."""
    from bricksrl.training import TrainConfig
    from bricktwin.twin.physics import RandomPhysics

    def is_mark(_: str, value: Any) -> bool:
        return type(value) is int and value == MARK

    short = ("--episodes", "2")
    return {
        "configuration of a run": walk(lambda _, value: type(value) is TrainConfig, *short),
        "`--seed`": walk(is_mark, *short, "--seed", str(MARK)),
        "`--randomize`": walk(
            lambda name, value: (
                (name == "randomize" and value is True) or type(value) is RandomPhysics
            ),
            *short,
            "--randomize",
        ),
        "`--episodes`": walk(is_mark, "--episodes", str(MARK), is_endless=True),
    }


def main(session: Session) -> None:
    """Measure, and write the page."""
    session.parse()
    walks = measure()
    session.write({"walks": walks})
    for name, files in walks.items():
        print(f"{name}: {len(files)} files: {', '.join(files)}")
