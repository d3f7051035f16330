"""Steps that are stopped while they are under way."""

from __future__ import annotations

import threading
import time
from collections.abc import Callable, Iterator
from contextlib import contextmanager

from ble_world import BOUND_S, World

from brickhub.hub.interface import Interface, MotorAngle, RunAngle, Wait
from brickhub.hub.link.lockstep import HubLink
from brickhub.hub.transports.profile import PybricksCommand

SLOW_STEP = Interface((RunAngle("left", -3000, 3000, 400),), (MotorAngle("left"),), Wait(2000))
"""A step that is still under way when somebody stops the robot."""


class Act(threading.Thread):
    """A step in a thread, and its result."""

    def __init__(self, link: HubLink) -> None:
        super().__init__(daemon=True)
        self.link, self.error = link, None
        self.start()

    def run(self) -> None:
        try:
            self.link.act([3000])
        except Exception as error:  # noqa: BLE001  the test looks at it
            self.error = error


@contextmanager
def held(world: World) -> Iterator[Callable[[], None]]:
    """Hold connection events except on explicit calls, for independence of machine speed."""
    air = world.radio.link
    world.radio.call(lambda: setattr(air, "is_held", True))
    try:
        yield lambda: world.radio.call(air.connection_event)
    finally:
        world.radio.call(lambda: setattr(air, "is_held", False))
        world.radio.call(air.connection_event)


def eventually(world: World, opcode: int, command: PybricksCommand | None = None) -> None:
    """Wait until a packet or command is ready for the next connection event."""
    start_s = time.monotonic()
    while not world.radio.link.waits(opcode, command):
        assert time.monotonic() - start_s < BOUND_S, (opcode, command)
        time.sleep(0.002)


def patient_link(world: World, interface: Interface) -> HubLink:
    """A link with a long watchdog, so that silence does not stop the motors."""
    transport = world.transport(timeout_s=10.0, answer_timeout_s=10.0)
    link = HubLink(transport, world.robot, interface, timeout_s=10.0, watchdog_s=60.0)
    world.hub.library.append(link.program.source)
    link.open()
    return link
