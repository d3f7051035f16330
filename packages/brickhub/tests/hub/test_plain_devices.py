"""Motors without encoder, lights and buttons, through the generated program on the virtual hub."""

from __future__ import annotations

import pytest

from brickhub.errors import DescriptionError, HubProgramError
from brickhub.hub.diagnostics.preflight import check_ports
from brickhub.hub.diagnostics.survey import survey
from brickhub.hub.interface import (
    Channel,
    Command,
    DriveStraight,
    HubButton,
    Interface,
    LightBrightness,
    MotorAngle,
    RemoteButton,
    RunDuty,
    RunSpeed,
    Wait,
)
from brickhub.hub.link.lockstep import HubLink
from brickhub.hub.program.generate import validate
from brickhub.robot import (
    Direction,
    DriveBase,
    HubKind,
    Motor,
    MotorKind,
    PoweredUpSensor,
    Robot,
    SensorKind,
    UltrasonicSensor,
)
from brickhub.virtual.bench_body import BenchBody
from brickhub.virtual.virtual_transport import VirtualHub

CART = Robot(
    "cart",
    HubKind.PRIME,
    motors=(
        Motor("wheel", "A", MotorKind.TRAIN, Direction.COUNTERCLOCKWISE),
        Motor("fan", "B", MotorKind.MEDIUM_LINEAR),
    ),
    sensors=(PoweredUpSensor("lamp", "C", SensorKind.LIGHT), UltrasonicSensor("eye", "D")),
    drive_base=DriveBase("wheel", "fan", 56, 112),
)
INTERFACE = Interface(
    (RunDuty("wheel"), LightBrightness("lamp"), LightBrightness("eye", 0, 50)),
    (RemoteButton("left_plus"), HubButton("left")),
    Wait(200),
)


def linked() -> tuple[HubLink, VirtualHub]:
    hub = VirtualHub(BenchBody(CART))
    return HubLink(hub, CART, INTERFACE), hub


def test_duty_turns_a_motor_without_encoder_and_lights_show() -> None:
    link, hub = linked()
    hub.machine.panel.near.add("remote")
    with link:
        link.act([100, 60, 80])
        ahead_mdeg = hub.body.angle_mdeg("A")
        assert ahead_mdeg < -50_000, "counterclockwise, at full duty for 0.2 s"
        assert hub.machine.panel.lamps == {"C": 60, "D": 50}, "clamped to the command's range"
        assert "lamp C 60 %" in hub.machine.panel.describe()
        link.act([-100, 0, 0])
        assert hub.body.angle_mdeg("A") > ahead_mdeg
        assert hub.machine.panel.lamps == {"C": 0, "D": 0}
    assert hub.machine.servos["A"].voltage_mv is None, "the end of the program stops it"


def test_buttons_of_hub_and_remote() -> None:
    link, hub = linked()
    panel = hub.machine.panel
    panel.near.add("remote")
    with link:
        assert link.read().values == (0.0, 0.0)
        panel.hold("remote.left_plus")
        assert link.read().values == (1.0, 0.0)
        panel.release("remote.left_plus")
        panel.hold("left")
        assert link.read().values == (0.0, 1.0)


def test_missing_remote_is_told_with_what_to_do() -> None:
    link, _ = linked()
    with pytest.raises(
        HubProgramError, match="ETIMEDOUT.*switch the remote on at the start of the program"
    ):
        link.open()


def test_preflight_tells_motors_without_encoder_apart() -> None:
    hub = VirtualHub(BenchBody(CART))
    found = {finding.name: finding.detail for finding in check_ports(CART, survey(hub, CART))}
    assert (
        found["port A"] == "'wheel', motor train"
        and found["port B"] == "'fan', motor medium-linear"
    )


@pytest.mark.parametrize(
    ("part", "message"),
    [
        (
            RunSpeed("wheel", -1, 1),
            "command 'wheel' needs an encoder, and 'wheel' is a train motor; use RunDuty",
        ),
        (DriveStraight(-1, 1), "command 'straight' needs an encoder"),
        (
            MotorAngle("fan"),
            "channel 'fan_angle' needs an encoder, and 'fan' is a medium-linear motor",
        ),
        (
            HubButton("center"),
            "the hub has no such button that a program may read; choose left, right, bluetooth",
        ),
        (
            RemoteButton("up"),
            "the remote has no such button that a program may read; choose left_plus, left",
        ),
        (LightBrightness("lamp", 0, 200), "ranges from 0 to 200 %; stay within 0 to 100"),
    ],
)
def test_what_a_device_cannot_do_is_refused(part: Command | Channel, message: str) -> None:
    commands = (part,) if isinstance(part, Command) else (RunDuty("wheel"),)
    channels = (part,) if isinstance(part, Channel) else (HubButton("left"),)
    with pytest.raises(DescriptionError, match=message):
        validate(CART, Interface(commands, channels, Wait(100)))


def test_settings_of_an_encoder_are_refused_without_one() -> None:
    with pytest.raises(
        DescriptionError, match="motor 'a': a train motor has no encoder; omit range_deg"
    ):
        Motor("a", "A", MotorKind.TRAIN, range_deg=(0, 90))
