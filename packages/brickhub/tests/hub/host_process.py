"""A host in a separate process that drives a hub until it is killed."""

from __future__ import annotations

import itertools
import os
import subprocess
import sys
from collections.abc import Iterator
from contextlib import contextmanager
from dataclasses import replace
from pathlib import Path

from ble_world import LONG_RUN, World
from described import TWO_WHEELER
from radio import Bluetooth

from brickhub.hub.interface import Interface, Wait
from brickhub.hub.link.lockstep import HubLink
from brickhub.hub.program import generate
from brickhub.hub.transports.ble import BleTransport

START_S = 60.0
"""Timeout for starting Python."""


def long_run(step_ms: int) -> Interface:
    """A motor that turns for seconds."""
    return replace(LONG_RUN, settle=Wait(step_ms))


@contextmanager
def host_process(
    world: World, step_ms: int, *, steps: int | None = None, says_good_bye: bool = True
) -> Iterator[subprocess.Popen[bytes]]:
    """A process that drives the hub for a number of steps, or until it is killed."""
    source = generate.generate(TWO_WHEELER, long_run(step_ms)).source
    if source not in world.hub.library:
        world.hub.library.append(source)
    port = world.radio.lend(says_good_bye=says_good_bye)
    words = (port, world.record, step_ms, generate.END_MS, -1 if steps is None else steps)
    environment = {**os.environ, "PYTHONPATH": os.pathsep.join(sys.path)}
    process = subprocess.Popen([sys.executable, __file__, *map(str, words)], env=environment)
    try:
        yield process
    finally:
        process.kill()
        process.wait(5)


def drive(port: int, record: Path, step_ms: int, end_ms: int, steps: int) -> None:
    """Connect, download, step and read."""
    generate.END_MS = end_ms
    transport = BleTransport(backend=Bluetooth(port).backend(), record=record)
    with HubLink(transport, TWO_WHEELER, long_run(step_ms)) as link:
        for step in itertools.count():
            if step == steps:
                break
            if step % 3 == 2:
                link.read()
            link.act([3000])


if __name__ == "__main__":
    drive(int(sys.argv[1]), Path(sys.argv[2]), *map(int, sys.argv[3:]))
