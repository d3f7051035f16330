"""Generated programs: complete, clean, small, deterministic."""

from __future__ import annotations

import ast
import dataclasses

import pytest
from described import REACHING, ROBO_ARM, RUN_AWAY, SPINNING, TWO_WHEELER, WALKER, WALKING

from brickhub.hub.interface import (
    Distance,
    DriveStraight,
    Interface,
    MotorAngle,
    Pitch,
    RunAngle,
    UntilDone,
    Wait,
)
from brickhub.hub.link.lockstep import HubLink
from brickhub.hub.program.compile import compile_mpy, compile_program, program_blob
from brickhub.hub.program.generate import generate
from brickhub.robot import BENCH, Direction, DriveBase, HubKind, Motor, Robot, UltrasonicSensor
from brickhub.virtual.bench_body import BenchBody
from brickhub.virtual.virtual_transport import VirtualHub

KINDS = [HubKind.PRIME, HubKind.ESSENTIAL, HubKind.TECHNIC, HubKind.CITY]

PAPER = [(TWO_WHEELER, RUN_AWAY), (TWO_WHEELER, SPINNING), (WALKER, WALKING), (ROBO_ARM, REACHING)]


def driver(kind: HubKind, interface: Interface) -> tuple[Robot, Interface]:
    """A 2Wheeler with another hub, and the task as far as it is supported."""
    has_third_port = len(kind.model.ports) > 2
    robot = Robot(
        name=f"driver-{kind.value}",
        hub=kind,
        motors=(Motor("left", "A", direction=Direction.COUNTERCLOCKWISE), Motor("right", "B")),
        sensors=(UltrasonicSensor("eyes", "C"),) if has_third_port else (),
        drive_base=DriveBase("left", "right", 56, 130),
        needs_imu=kind.model.has_imu,
    )
    channels = tuple(
        channel
        for channel in interface.channels
        if isinstance(channel, MotorAngle)
        or (has_third_port if isinstance(channel, Distance) else kind.model.has_imu)
    )
    return robot, dataclasses.replace(interface, channels=channels)


ALL = PAPER + [driver(kind, interface) for kind in KINDS for interface in (RUN_AWAY, SPINNING)]


@pytest.mark.parametrize(("robot", "interface"), ALL)
def test_generated_program_is_clean_and_fits(robot: Robot, interface: Interface) -> None:
    program = generate(robot, interface)
    blob = program_blob(compile_program(program), robot.hub)
    assert len(blob) < 4096
    assert max(map(len, program.source.splitlines())) <= 130
    with HubLink(VirtualHub(BenchBody(robot)), robot, interface) as link:
        assert len(link.read().values) == len(interface.channels)


def test_generation_is_deterministic_and_hash_distinguishes() -> None:
    programs = [generate(robot, interface) for robot, interface in ALL]
    assert programs == [generate(robot, interface) for robot, interface in ALL]
    assert len({program.hash for program in programs}) == len(ALL)
    assert all(0 <= program.hash < 2**32 for program in programs)


@pytest.mark.parametrize(("robot", "interface"), PAPER)
def test_source_contains_hash(robot: Robot, interface: Interface) -> None:
    program = generate(robot, interface)
    values = {
        node.targets[0].id: node.value.value
        for node in ast.parse(program.source).body
        if isinstance(node, ast.Assign)
        and isinstance(node.targets[0], ast.Name)
        and isinstance(node.value, ast.Constant)
    }
    assert values["PROGRAM_HASH"] == program.hash.to_bytes(4, "little")


def test_source_header() -> None:
    top = generate(TWO_WHEELER, RUN_AWAY).source.split("\n\n", maxsplit=1)[0]
    assert all(line.startswith("# ") for line in top.splitlines())
    for words in (
        "two-wheeler",
        "prime hub",
        "straight: drive -100 to 100 mm",
        "pitch, -90 to 90 deg",
        "3000 ms",
    ):
        assert words in top


def test_program_sets_up_only_used_devices() -> None:
    source = generate(TWO_WHEELER, SPINNING).source
    assert "DriveBase" not in source and "UltrasonicSensor" not in source and "Joint" not in source
    source = generate(TWO_WHEELER, RUN_AWAY).source
    assert "motor_left = Motor(Port.E, Direction.COUNTERCLOCKWISE)" in source
    assert "DriveBase(motor_left, motor_right, wheel_diameter=56, axle_track=130)" in source
    assert "Axis" not in source
    source = generate(ROBO_ARM, REACHING).source
    assert "motor_rotation = Motor(Port.B, gears=[20, 60])" in source
    assert "motor_low.control.limits(speed=500, acceleration=1000, torque=900)" in source
    assert "motor_low = Joint(motor_low, 10, 70)" in source
    assert "hub.imu" not in source


def test_tilt_is_read_once_per_answer() -> None:
    assert generate(TWO_WHEELER, SPINNING).source.count("hub.imu.tilt()") == 1


def test_motor_names_may_be_any_identifier() -> None:
    robot = Robot(
        "odd", HubKind.PRIME, motors=(Motor("class", "A"), Motor("hub", "B"), Motor("wait", "C"))
    )
    names = [motor.name for motor in robot.motors]
    interface = Interface(
        tuple(RunAngle(name, -1, 1, 100) for name in names),
        tuple(MotorAngle(name) for name in names),
        UntilDone(),
    )
    assert compile_mpy(generate(robot, interface).source)


def test_interface_without_commands() -> None:
    interface = Interface((), (Pitch(),), Wait(10))
    source = generate(BENCH, interface).source
    assert "Port" not in source
    assert compile_mpy(source)


def test_wire_integers_are_exact_for_fractional_ranges() -> None:
    interface = Interface((DriveStraight(-0.5, 12.34),), (MotorAngle("left"),), UntilDone())
    assert "whole(actions[0], -5, 123, 10)" in generate(TWO_WHEELER, interface).source
