"""Virtual hub in a robot with a body: reset, stop, rest."""

from __future__ import annotations

import random

import pytest
from described import SPINNING

from brickhub.errors import HubError
from brickhub.hub.link.lockstep import HubLink
from brickhub.hub.link.states import LinkState
from brickhub.hub.transport import HubProgram
from brickhub.virtual.virtual_transport import VirtualHub
from bricktwin.robots import TWO_WHEELER
from bricktwin.twin.make_body import make_body
from bricktwin.twin.scene import Scene

ECHO = """
from usys import stdin, stdout
from uselect import poll
from pybricks.tools import wait
keys = poll()
keys.register(stdin)
stdout.buffer.write(b"hello")
while True:
    while not keys.poll(0):
        wait(1)
    stdout.buffer.write(stdin.buffer.read(1))
"""

DRIVE = """
from pybricks.pupdevices import Motor
from pybricks.parameters import Port
from pybricks.tools import wait
from usys import stdout
motor = Motor(Port.A)
motor.run(500)
wait(1000)
stdout.buffer.write(b"up")
while True:
    wait(10)
"""


def test_reset_during_program() -> None:
    virtual = VirtualHub(make_body(TWO_WHEELER, scene=Scene(wall_distance_mm=(500, 500))))
    virtual.start(HubProgram(ECHO, 0))
    virtual.read(1.0)
    virtual.reset(random.Random(0))
    assert virtual.body.distance_mm("C") == pytest.approx(500, abs=20)
    virtual.write(b"x")
    assert virtual.read(1.0) == b"x"


def test_stop_stops_motors() -> None:
    virtual = VirtualHub(make_body(TWO_WHEELER))
    virtual.start(HubProgram(DRIVE, 0))
    assert virtual.read(2.0) == b"up"
    assert virtual.machine.servos["A"].speed_deg_s() > 400
    virtual.stop()
    virtual.machine.advance(2000)
    angle_mdeg = virtual.body.angle_mdeg("A")
    virtual.machine.advance(500)
    assert virtual.body.angle_mdeg("A") == pytest.approx(angle_mdeg, abs=1000)
    with pytest.raises(HubError, match="no program runs"):
        virtual.read(0.1)
    virtual.close()
    virtual.close()


def test_rest_stops_motors_not_program() -> None:
    hub = VirtualHub(make_body(TWO_WHEELER))
    virtual = HubLink(hub, TWO_WHEELER, SPINNING)
    virtual.open()
    virtual.act([100, 100])
    assert virtual.state is LinkState.ARMED
    virtual.rest()
    assert virtual.state is LinkState.READY
    assert not any(servo.control.is_active for servo in hub.machine.servos.values())
    still = virtual.read().values[:2]
    for _ in range(5):
        hub.machine.advance(100)
        again = virtual.read().values[:2]
    assert again == pytest.approx(still, abs=5)
    virtual.act([50, 50])
    assert virtual.state is LinkState.ARMED
