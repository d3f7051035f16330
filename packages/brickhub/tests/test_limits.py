"""Limits of what a description may say: what is just within is taken, what is just beyond is
refused with a sentence that names it."""

from __future__ import annotations

import math
from collections.abc import Callable
from dataclasses import replace
from functools import partial
from typing import Annotated, Any

import pytest
from described import ROBO_ARM, TWO_WHEELER
from limits import assert_kept
from on_a_body import ANGLES, interface

from brickhub.entry import Entry
from brickhub.errors import BricksError
from brickhub.fields import Count, Range, check_value
from brickhub.hub.diagnostics.calibration import zero_between
from brickhub.hub.interface import (
    Channel,
    Command,
    Curve,
    Distance,
    DriveSpeed,
    DriveStraight,
    DriveTurnRate,
    HubButton,
    HubLight,
    HubSound,
    Interface,
    LightBrightness,
    MotorAngle,
    Pitch,
    RunAngle,
    RunDuty,
    RunSpeed,
    SensorReading,
    TrackTarget,
    Turn,
    UntilDone,
    Wait,
    YawRate,
)
from brickhub.hub.messages import Exchange
from brickhub.hub.program.generate import validate
from brickhub.hub.program.run_program import check_time_limit
from brickhub.hub.protocol import data_frame
from brickhub.hub.trial_protocol import TrialWire
from brickhub.robot import (
    Chassis,
    DriveBase,
    HubKind,
    Motor,
    MotorKind,
    Mount,
    PoweredUpSensor,
    Robot,
    SensorKind,
    UltrasonicSensor,
)
from brickhub.seed import LARGEST_SEED, check_seed
from brickhub.virtual.bench_body import described_end_stops
from brickhub.virtual.given_readings import parse_end_stop, parse_start
from brickhub.virtual.own_devices import OwnDevice, OwnI2c, OwnMode

Make = Callable[..., Any]
EPSILON = 1e-9
SENSORS = Robot(
    "sensors",
    HubKind.PRIME,
    (Motor("left", "A"), Motor("right", "B"), Motor("weak", "C", MotorKind.TRAIN)),
    (
        UltrasonicSensor("eyes", "D"),
        PoweredUpSensor("color", "E", SensorKind.COLOR),
        PoweredUpSensor("lamp", "F", SensorKind.LIGHT),
    ),
    DriveBase("left", "right", 56, 112),
    needs_imu=True,
)


def command(*commands: Command, robot: Robot = TWO_WHEELER, settle: Any = None) -> None:
    validate(robot, Interface(commands, ANGLES, settle or Wait(50)))


def arm(command: Command) -> None:
    validate(ROBO_ARM, Interface((command,), (MotorAngle("low", 10, 70),), Wait(50)))


def channel(one: Channel, robot: Robot = SENSORS) -> None:
    validate(robot, Interface((RunDuty("left"),), (one,), Wait(50)))


def mode(**fields: Any) -> OwnMode:
    return OwnMode(**{"name": "M", "read": lambda _: (0,), **fields})


def trial(steps: int = 1, value: float = 0.0, numbers: int = 1) -> None:
    entries = [Entry(f"n{i}", -1.0, 1.0) for i in range(numbers)]
    form = TrialWire(interface(RunSpeed("left", -9, 9)), TWO_WHEELER, entries)
    form.request(1, [value] * numbers, steps)


def kept(
    value: object, low: float, high: float, *, above: bool = False, below: bool = False
) -> None:
    check_value("x", value, Annotated[float, Range(low, high, above, below)])


LIMITS: dict[str, tuple[Make, list[Any], list[Any]]] = {
    # of a robot
    "range of a motor": (lambda r: Motor("m", "A", range_deg=r), [(10, 11)], [(10, 10), (11, 10)]),
    "end stops": (lambda s: Motor("m", "A", end_stops_deg=s), [(0.0, 0.1)], [(0.1, 0.1)]),
    "teeth": (lambda g: Motor("m", "A", gears=g), [(), (1, 1), (12, 20, 36)], [(1, 0), (0, 1)]),
    "speed limit": (lambda v: Motor("m", "A", speed_limit_deg_s=v), [1, None], [0, -1]),
    "acceleration": (lambda v: Motor("m", "A", acceleration_deg_s2=v), [1, None], [0]),
    "torque": (lambda v: Motor("m", "A", torque_limit_mnm=v), [1, None], [0]),
    "height of a sensor": (
        lambda z: Mount((0.0, 0.0, z)),
        [EPSILON, 100.0],
        [0.0, -1.0, math.nan, math.inf],
    ),
    "wheel": (lambda d: DriveBase("a", "b", d, 1.0), [0.0, 56.0], [-EPSILON]),
    "axle track": (lambda d: DriveBase("a", "b", 1.0, d), [0.0, 112.0], [-EPSILON]),
    "ballast": (lambda g: Chassis(ballast_g=g), [0.0, 9.0], [-EPSILON, math.inf]),
    "caster": (
        lambda x: Chassis(caster_mm=(x, 0.0)),
        [20.0, -20.0],
        [19.999, -19.999, 0.0, math.nan],
    ),
    # of a program's commands
    "speed of an angle": (lambda v: command(RunAngle("left", -9, 9, v)), [1, 32767], [0, 32768]),
    "low duty": (lambda low: command(RunDuty("left", low, 0)), [-100.0], [-100.1]),
    "high duty": (lambda high: command(RunDuty("left", 0, high)), [100.0], [100.1]),
    "low target": (lambda low: arm(TrackTarget("low", low, 60)), [10], [9]),
    "high target": (lambda high: arm(TrackTarget("low", 20, high)), [70], [71]),
    "target of a wheel": (lambda high: command(TrackTarget("left", 0, high)), [3000], [3277]),
    "radius": (lambda r: command(Curve(-9, 9, r)), [10, -10, 32767], [9, -9, 0, 32768]),
    "low hue": (lambda low: command(HubLight(low, 9)), [0.0], [-0.1]),
    "high hue": (lambda high: command(HubLight(0, high)), [360.0], [360.1]),
    "low light": (
        lambda low: command(LightBrightness("lamp", low, 9), robot=SENSORS),
        [0.0],
        [-0.1],
    ),
    "high light": (
        lambda high: command(LightBrightness("lamp", 0, high), robot=SENSORS),
        [100.0],
        [100.1],
    ),
    "what has a light": (
        lambda name: command(LightBrightness(name), robot=SENSORS),
        ["lamp", "eyes"],
        ["color", "nothing"],
    ),
    "low tone": (lambda low: command(HubSound(low=low)), [0.0], [-1.0]),
    "duration of a tone": (lambda t: command(HubSound(duration_ms=t)), [1, 200], [0, 201]),
    "step": (lambda t: command(RunSpeed("left", -1, 1), settle=Wait(t)), [1, 60_000], [0, 60_001]),
    "step until done": (
        lambda t: command(RunAngle("left", -1, 1, 9), settle=UntilDone(t)),
        [1, 60_000],
        [0, 60_001],
    ),
    "range of a command": (
        lambda r: command(RunSpeed("left", *r)),
        [(0.0, 0.1), (-3276.7, 3276.7)],
        [(0.1, 0.1), (0.0, 3276.8), (-3276.8, 0.0), (math.nan, 1.0)],
    ),
    "name of a command": (
        lambda names: command(*(RunDuty(name) for name in names)),
        [("left", "right")],
        [("left", "left"), ("nobody",)],
    ),
    # of its channels
    "encoder": (
        lambda name: channel(MotorAngle(name)),
        ["left"],
        ["weak", "nobody"],
    ),
    "hub's IMU": (
        lambda kind: channel(Pitch(), replace(SENSORS, hub=kind, needs_imu=False)),
        [HubKind.PRIME],
        [],
    ),
    "gyroscope": (
        lambda name: channel(YawRate(sensor=name)),
        [""],
        ["eyes", "color"],
    ),
    "distance": (lambda name: channel(Distance(name)), ["eyes"], ["color", "lamp"]),
    "button": (lambda name: channel(HubButton(name)), ["left", "right"], ["center", "up"]),
    "reading": (
        lambda words: channel(SensorReading(*words[:2], 0, 100, "", *words[2:])),
        [("color", "reflection"), ("color", "hsv", "hue"), ("color", "hsv", "value")],
        [
            ("color", "smell"),
            ("color", "hsv"),
            ("color", "hsv", "red"),
            ("color", "reflection", "hue"),
            ("eyes", "distance"),
        ],
    ),
    # of what robots tell one another
    "own channel": (lambda own: Exchange(own, (7,), 1), [0, 255], [-1, 256, 7]),
    "other channel": (lambda other: Exchange(7, (1, other), 1), [0, 255], [-1, 256, 1, 7]),
    "numbers that are told": (lambda n: Exchange(0, (1,), n), [1, 8], [0, 9]),
    # of what goes over the link
    "sequence number": (lambda seq: data_frame(seq, b""), [1, 255], [0, 256]),
    "steps of a trial": (lambda n: trial(steps=n), [1, 255], [0, 256]),
    "number of a trial": (
        lambda value: trial(value=value),
        [-1.0, 1.0],
        [-1.0 - EPSILON, 1.0 + EPSILON, math.nan],
    ),
    "numbers of a trial": (lambda n: trial(numbers=n), [1, 7, 8, 64], [0, 65]),
    "time limit": (check_time_limit, [None, EPSILON, 1e9], [0.0, -1.0, math.inf, math.nan]),
    "seed": (check_seed, [None, 0, LARGEST_SEED], [-1, LARGEST_SEED + 1, 0.5, "1"]),
    # of devices of one's own
    "name of a mode": (lambda text: mode(name=text), ["M", "M" * 11], ["", "M" * 12]),
    "bits": (lambda bits: mode(bits=bits), [8, 16, 32], [0, 7, 64]),
    "values of 32 bits": (lambda n: mode(count=n, bits=32), [1, 8], [0, 9]),
    "values of 8 bits": (lambda n: mode(count=n, bits=8), [1, 32], [0, 33]),
    "modes": (lambda n: OwnDevice(1, (mode(),) * n), [1, 16], [0, 17]),
    "address": (OwnI2c, [0, 127], [-1, 128]),
    "value of 8 bits": (
        lambda value: mode(bits=8, read=lambda _: (value,)).values(0.0),
        [-128, 127],
        [-129, 128, 1.0, True],
    ),
    "count of values": (
        lambda values: mode(count=2, read=lambda _: values).values(0.0),
        [(1, 2), [3, 4]],
        [(1,), (1, 2, 3), 5],
    ),
    # of a bench
    "end stops on the bench": (
        lambda stops: described_end_stops(
            Robot("r", HubKind.PRIME, (Motor("m", "A", end_stops_deg=stops),))
        ),
        [(0.0, 1.0), (-1.0, 0.0)],
        [(0.1, 1.0), (-1.0, -0.1)],
    ),
    "end stops of an option": (
        parse_end_stop,
        ["C=0..1", "c=-1..0"],
        ["C=1..2", "C=-2..-1", "C"],
    ),
    "start of an option": (
        parse_start,
        ["A=-180", "A=179.9", "B=0"],
        ["A=180", "A=-180.1", "A=nan", "A", "AB=1"],
    ),
    "zero of a joint": (
        lambda stops: zero_between(stops, Motor("m", "A", range_deg=(10, 70))),
        [(0, 60), (-5, 95)],
        [(0, 59), (60, 0)],
    ),
    # of any value
    "whole number": (partial(check_value, "x", hint=Count), [1, 2**24], [0, 2**24 + 1, 1.0, True]),
    "closed range": (lambda x: kept(x, 0, 1), [0, 0.0, 1.0], [-EPSILON, 1.1, math.nan, "1", None]),
    "above": (lambda x: kept(x, 0, 1, above=True), [EPSILON, 1.0], [0.0]),
    "below": (lambda x: kept(x, 0, 1, below=True), [0.0, 1.0 - EPSILON], [1.0]),
}


@pytest.mark.parametrize("name", LIMITS)
def test_what_is_within_is_taken_and_what_is_beyond_is_refused(name: str) -> None:
    assert_kept(LIMITS[name], BricksError)


@pytest.mark.parametrize(
    "one",
    [DriveStraight(-9, 9), Turn(-9, 9), Curve(-9, 9, 100), DriveSpeed(-9, 9), DriveTurnRate(-9, 9)],
    ids=lambda one: one.name,
)
def test_wheels_of_a_drive_base_turn_endlessly(one: Command) -> None:
    for name in ("left", "right"):
        motors = [
            replace(motor, range_deg=(-90, 90)) if motor.name == name else motor
            for motor in TWO_WHEELER.motors
        ]
        with pytest.raises(BricksError, match=f"motor '{name}' of the drive base has a range"):
            one.check(replace(TWO_WHEELER, motors=tuple(motors)))
    one.check(TWO_WHEELER)
