"""Lessons: what a robot can learn in a tab by trying the few numbers of a structured policy."""

import contextlib
import math
from collections.abc import Callable, Sequence
from dataclasses import dataclass, field
from typing import Any

from brickhub.errors import DescriptionError
from brickhub.hub.interface import Channel, Interface, MotorAngle, Pitch, Roll, RunAngle, Wait
from brickhub.robot import Robot
from brickhub.search.bayesian_search import trial_score
from brickhub.search.oscillators import oscillators
from brickhub.search.structure import HubStructure
from bricktwin.twin.standing import Pose

STEP_MS = 250
TRIAL_STEPS = 10
"""Steps of a trial: two and a half seconds, a few strides."""
SETTLE_STEPS = 3
"""First steps of a trial, in which the legs find their places."""
_TURN_DEG = 100.0
"""Largest turn of a leg in a step: more than a loaded motor can do in that time."""
_LEG_SPEED_DEG_S = 600
_TROT_SPEED = -0.9
"""Speed of the trot by which others are judged; legs walk forwards by turning backwards."""


@dataclass
class Record:
    """What happened in a trial.

    Attributes:
        poses: before each step and after the last one.
        observed: what the program observed then, in the order of its channels.
        has_fallen: whether the robot fell over.
    """

    poses: list[Pose] = field(default_factory=list)
    observed: list[Sequence[float]] = field(default_factory=list)
    has_fallen: bool = False


@dataclass(frozen=True)
class Lesson:
    """Something to learn.

    Attributes:
        goal: what is learned, such as "walk".
        interface: commands and channels of the robot.
        structure: what acts by the numbers.
        score: how good a trial was; NaN if nobody knows.
        unit: of the score.
        reference: numbers ``[p]`` that a person would choose.
    """

    goal: str
    interface: Interface
    structure: HubStructure
    score: Callable[[Record], float]
    unit: str
    reference: tuple[float, ...]


def walk(robot: Robot) -> Lesson:
    """Walk forward on legs that turn endlessly. Raises DescriptionError if there are none."""
    legs = []
    for motor in robot.motors:
        is_free = motor.range_deg is None and motor.end_stops_deg is None
        if is_free and motor.kind.model.has_encoder:
            legs.append(motor.name)
    commands = [RunAngle(leg, -_TURN_DEG, _TURN_DEG, speed_deg_s=_LEG_SPEED_DEG_S) for leg in legs]
    channels: list[Channel] = [MotorAngle(leg) for leg in legs]
    if robot.needs_imu:
        channels += [Pitch(), Roll()]
    interface = Interface(tuple(commands), tuple(channels), Wait(STEP_MS))
    structure = oscillators(robot, interface)
    # Each pair of legs half a turn behind the pair before it.
    phases = [180.0 * (place % 2) for place in range(1, len(structure.numbers))]
    return Lesson(
        goal="walk",
        interface=interface,
        structure=structure,
        score=walking_speed,
        unit="mm/s",
        reference=(_TROT_SPEED, *phases),
    )


def walking_speed(record: Record) -> float:
    """Speed in the direction in which the robot stood at first, mm/s."""
    places_mm = [ahead_mm(record.poses[0], pose) for pose in record.poses]
    steps_mm = [after - before for before, after in zip(places_mm, places_mm[1:], strict=False)]
    return trial_score(steps_mm, SETTLE_STEPS) * 1000 / STEP_MS


def ahead_mm(start: Pose, pose: Pose) -> float:
    """How far a pose is ahead of another one."""
    heading = math.radians(start.heading_deg)
    # Headings are clockwise, but y points to the left.
    x_m = pose.x_m - start.x_m
    y_m = pose.y_m - start.y_m
    return 1000 * (x_m * math.cos(heading) - y_m * math.sin(heading))


LESSONS: dict[str, Callable[[Robot], Lesson]] = {"walk": walk}
"""Functions that make the lesson of a goal for a robot."""


def lesson_for(robot: Robot) -> Lesson | None:
    """The lesson that suits a robot, if there is one."""
    # What drives on wheels does not walk, though its motors turn endlessly too.
    if robot.drive_base is not None:
        return None
    with contextlib.suppress(DescriptionError):
        return walk(robot)
    return None


def described(lesson: Lesson) -> dict[str, Any]:
    """A lesson for the page: ``goal``, ``unit``, and ``numbers`` with their ranges."""
    numbers = []
    for entry in lesson.structure.numbers:
        numbers.append(
            {"name": entry.name, "low": entry.low, "high": entry.high, "unit": entry.unit}
        )
    return {"goal": lesson.goal, "unit": lesson.unit, "numbers": numbers}
