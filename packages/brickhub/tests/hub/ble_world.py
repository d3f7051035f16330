"""Hub, radio and links for Bluetooth tests."""

from __future__ import annotations

import time
from collections.abc import Callable
from pathlib import Path
from typing import Any

import pytest
from described import TWO_WHEELER
from played_hub import PlayedHub
from radio import Fault, Radio

from brickhub.errors import HubError
from brickhub.hub.interface import Interface, MotorAngle, RunAngle, Wait
from brickhub.hub.link.lockstep import HubLink
from brickhub.hub.transports.ble import BleTransport
from brickhub.robot import Robot

NAME = "Pybricks Hub"
LONG_RUN = Interface(
    commands=(RunAngle("left", -3000, 3000, 400),),
    channels=(MotorAngle("left"), MotorAngle("right")),
    settle=Wait(10),
)
"""A motor that turns for seconds after the answer."""
BOUND_S = 3.0
"""Upper bound of every call."""


class World:
    """Hub, radio and links."""

    def __init__(self, folder: Path, robot: Robot = TWO_WHEELER, interval_ms: float = 2.0) -> None:
        self.radio = Radio()
        self.robot = robot
        self.hub = PlayedHub(self.radio, robot, NAME)
        self.record = folder / "programs.json"
        self._open: list[BleTransport] = []
        self.set_interval(interval_ms)

    def set_interval(self, interval_ms: float) -> None:
        self.radio.call(lambda: setattr(self.radio.link, "interval_ms", interval_ms))

    def transport(self, **options: Any) -> BleTransport:
        settings: dict[str, Any] = {
            "name": NAME,
            "timeout_s": 2.0,
            "answer_timeout_s": 0.6,
            "record": self.record,
        }
        transport = BleTransport(backend=self.radio.backend(), **(settings | options))
        self._open.append(transport)
        return transport

    def link(self, interface: Interface = LONG_RUN, **options: Any) -> HubLink:
        link = HubLink(self.transport(**options), self.robot, interface, timeout_s=1.0)
        self.hub.library.append(link.program.source)
        return link

    def fault(self, rule: Fault | None) -> None:
        self.radio.call(lambda: setattr(self.radio.link, "fault", rule or (lambda opcode, data: 1)))

    def close(self) -> None:
        self.fault(None)
        for transport in self._open:
            transport.close()
        self.hub.close()
        self.radio.close()


def bounded(
    call: Callable[[], object], error: type[HubError], bound_s: float = BOUND_S
) -> HubError:
    """The error of a call, within the time bound."""
    start_s = time.monotonic()
    with pytest.raises(error) as caught:
        call()
    assert time.monotonic() - start_s < bound_s
    assert "\n" not in str(caught.value) and ";" in str(caught.value), (
        "one line: what happened; what to do"
    )
    return caught.value
