"""Lessons: what a robot can learn in a tab by trying the few numbers of a structured policy."""

import contextlib
import math
from collections.abc import Callable, Sequence
from dataclasses import dataclass, field
from functools import partial
from typing import Any

from brickhub.errors import DescriptionError
from brickhub.hub.commands import drive_base
from brickhub.hub.interface import (
    Channel,
    Distance,
    DriveDistance,
    DriveSpeed,
    DriveTurnRate,
    Interface,
    MotorAngle,
    Pitch,
    PitchRate,
    Roll,
    RunAngle,
    RunDuty,
    SensorReading,
    Wait,
    WheelsAngle,
    WheelsSpeed,
)
from brickhub.robot import Robot, UltrasonicSensor
from brickhub.robot.line_edge import LINE_EDGES, LineEdge, edge_of
from brickhub.search.approach import approach
from brickhub.search.bayesian_search import trial_score
from brickhub.search.edge import edge_following
from brickhub.search.oscillators import NO_LEGS, oscillators
from brickhub.search.structure import HubStructure
from brickhub.search.upright import upright
from bricktwin.twin.standing import Pose

_STRIDE_STEPS = 10
"""Steps of a trial of legs: two and a half seconds, a few strides."""
_STRIDE_STEP_MS = 250
_SETTLE_STEPS = 3
"""First steps of such a trial, in which the legs find their places."""
_TURN_DEG = 100.0
"""Largest turn of a leg in a step: more than a loaded motor can do in that time."""
_LEG_SPEED_DEG_S = 600
_APPROACH_STEPS = 40
_APPROACH_STEP_MS = 100
_APPROACH_MM_S = 400
_SIGHT_MM = 1000
"""Distance beyond which a driving robot takes the wall to be no farther."""
GAP_MM = 150.0
"""Where it is to stop."""
_THIRD_MM = 200.0
"""So far off the points are a third of all."""
_TOO_NEAR = 3.0
_UPRIGHT_STEPS = 250
_UPRIGHT_STEP_MS = 20
_FAR_DEG = 360.0
"""A turn of the wheels away, the points for being near are a third of all."""
_LINE_STEPS = 80
_LINE_STEP_MS = 50
_LINE_MM_S = 250
_LINE_TURN_DEG_S = 150
_FARTHEST_MM = 10_000


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
        labels: of the numbers ``[p]``, for a person.
        steps: of a trial.
        settle_steps: first ones, which do not count.
        score: how good a trial was; NaN if nobody knows.
        unit: of the score.
        falls_late: whether a trial that ends by a fall is as good as its score says, as where late
            is better than soon; else it is no better than the worst one.
    """

    goal: str
    interface: Interface
    structure: HubStructure
    labels: tuple[str, ...]
    steps: int
    score: Callable[[Record], float]
    unit: str
    settle_steps: int = 0
    falls_late: bool = False

    @property
    def step_ms(self) -> int:
        """Time of a step."""
        return self.interface.settle.longest_ms


def walk(robot: Robot) -> Lesson:
    """Walk forward on legs that turn endlessly. Raises DescriptionError if there are none."""
    legs = []
    for motor in robot.motors:
        is_free = motor.range_deg is None and motor.end_stops_deg is None
        if is_free and motor.kind.model.has_encoder:
            legs.append(motor.name)
    # A single motor that turns all around, beside others that do not, is that of a turntable.
    if len(legs) == 1 and len(robot.motors) > 1:
        raise DescriptionError(NO_LEGS)
    commands = [RunAngle(leg, -_TURN_DEG, _TURN_DEG, speed_deg_s=_LEG_SPEED_DEG_S) for leg in legs]
    channels: list[Channel] = [MotorAngle(leg) for leg in legs]
    if robot.needs_imu:
        channels += [Pitch(), Roll()]
    interface = Interface(tuple(commands), tuple(channels), Wait(_STRIDE_STEP_MS))
    structure = oscillators(robot, interface)
    # All but the speed are phases.
    names = [entry.name.removesuffix("_phase") for entry in structure.numbers[1:]]
    lags = [f"{name.replace('_', ' ')} lags by" for name in names]
    return Lesson(
        goal="walk",
        interface=interface,
        structure=structure,
        labels=("turns of the legs", *lags),
        steps=_STRIDE_STEPS,
        score=walking_speed,
        unit="mm/s",
        settle_steps=_SETTLE_STEPS,
    )


def walking_speed(record: Record) -> float:
    """Speed in the direction in which the robot stood at first, mm/s."""
    places_mm = [ahead_mm(record.poses[0], pose) for pose in record.poses]
    steps_mm = [after - before for before, after in zip(places_mm, places_mm[1:], strict=False)]
    return trial_score(steps_mm, _SETTLE_STEPS) * 1000 / _STRIDE_STEP_MS


def ahead_mm(start: Pose, pose: Pose) -> float:
    """How far a pose is ahead of another one."""
    heading = math.radians(start.heading_deg)
    # Headings are clockwise, but y points to the left.
    x_m = pose.x_m - start.x_m
    y_m = pose.y_m - start.y_m
    return 1000 * (x_m * math.cos(heading) - y_m * math.sin(heading))


def stop_before_wall(robot: Robot) -> Lesson:
    """Drive up to a wall, and stop before it. Raises DescriptionError without a drive base and an
    ultrasonic sensor."""
    eyes = [sensor.name for sensor in robot.sensors if isinstance(sensor, UltrasonicSensor)]
    if not eyes:
        raise DescriptionError(f"robot '{robot.name}' sees no wall; give it an ultrasonic sensor")
    drive_base(robot, "stop before a wall")
    interface = Interface(
        (DriveSpeed(-_APPROACH_MM_S, _APPROACH_MM_S),),
        (Distance(eyes[0], 0.0, _SIGHT_MM),),
        Wait(_APPROACH_STEP_MS),
    )
    return Lesson(
        goal="stop",
        interface=interface,
        structure=approach(interface),
        labels=("it drives to", "its speed for each millimetre of way"),
        steps=_APPROACH_STEPS,
        score=nearness,
        unit="points",
    )


def nearness(record: Record) -> float:
    """Mean of all steps, of 100 points at `GAP_MM` before the wall and fewer elsewhere: who is
    there soon, and stays, has most."""
    points = []
    for (distance_mm,) in record.observed[1:]:
        off_mm = distance_mm - GAP_MM
        # Who is too near may have hit it.
        if off_mm < 0:
            off_mm *= -_TOO_NEAR
        # Never nothing: a search has to know which of two bad ways is the better one.
        points.append(100.0 * math.exp(-off_mm / _THIRD_MM))
    return math.fsum(points) / len(points) if points else math.nan


def keep_upright(robot: Robot) -> Lesson:
    """Keep upright on two wheels, and stay there. Raises DescriptionError without a drive base, or
    if the hub does not measure how it leans."""
    if not robot.needs_imu:
        raise DescriptionError(f"robot '{robot.name}' does not measure how it leans")
    base = drive_base(robot, "keep upright")
    interface = Interface(
        (RunDuty(base.left), RunDuty(base.right)),
        (
            Pitch(),
            PitchRate(),
            WheelsAngle(base.left, base.right),
            WheelsSpeed(base.left, base.right),
        ),
        Wait(_UPRIGHT_STEP_MS),
    )
    return Lesson(
        goal="upright",
        interface=interface,
        structure=upright(interface),
        labels=(
            "it leans by",
            "voltage for each degree",
            "it looks ahead by",
            "lean for each degree of way",
            "lean for its speed",
        ),
        steps=_UPRIGHT_STEPS,
        score=uprightness,
        unit="points",
        falls_late=True,
    )


def uprightness(record: Record) -> float:
    """Points of 100: for each step upright half of them, and the other half for being near; those
    after a fall have none."""
    points = []
    # Wheels of a real robot have turned before.
    _, _, first_deg, _ = record.observed[0] if record.observed else (0.0, 0.0, 0.0, 0.0)
    for _, _, angle_deg, _ in record.observed[1:]:
        near = math.exp(-abs(angle_deg - first_deg) / _FAR_DEG)
        points.append(100.0 * (1.0 + near) / 2.0)
    return math.fsum(points) / _UPRIGHT_STEPS if points else math.nan


def follow_line(robot: Robot) -> Lesson:
    """Follow the edge of a line, fast. Raises DescriptionError without a drive base, a color
    sensor, and a hub that runs programs."""
    name = light_of(robot)
    drive_base(robot, "follow a line")
    edge = edge_of(robot, name)
    light = SensorReading(name, "reflection", 0, 100, "%")
    interface = Interface(
        (DriveSpeed(0, _LINE_MM_S), DriveTurnRate(-_LINE_TURN_DEG_S, _LINE_TURN_DEG_S)),
        (light, DriveDistance(0, _FARTHEST_MM)),
        Wait(_LINE_STEP_MS),
    )
    return Lesson(
        goal="follow",
        interface=interface,
        structure=edge_following(interface, edge.edge_pct),
        labels=("its speed", "its turn for each percent"),
        steps=_LINE_STEPS,
        score=partial(speed_at_edge, edge=edge),
        unit="mm/s",
    )


def light_of(robot: Robot) -> str:
    """Name of the color sensor by which a robot follows a line. Raises DescriptionError without one
    whose readings there are known, and without a hub that runs programs."""
    lights = [sensor.name for sensor in robot.sensors if sensor.kind in LINE_EDGES]
    if not (lights and robot.hub.model.runs_programs):
        raise DescriptionError(
            f"robot '{robot.name}' follows no line by itself; give it a hub and a color sensor"
        )
    return lights[0]


def speed_at_edge(record: Record, edge: LineEdge) -> float:
    """Speed of a robot, mm/s: each way counts as far as its sensor was near the edge after it, from
    all of it there to nothing of it where it sees only the line, or only the floor."""
    way_mm = 0.0
    for before, after in zip(record.observed, record.observed[1:], strict=False):
        reflection_pct, distance_mm = after
        near = max(0.0, 1.0 - abs(reflection_pct - edge.edge_pct) / edge.bare_pct)
        way_mm += near * (distance_mm - before[1])
    steps = len(record.observed) - 1
    return way_mm * 1000 / (_LINE_STEP_MS * steps) if steps > 0 else math.nan


LESSONS: dict[str, Callable[[Robot], Lesson]] = {
    "walk": walk,
    "stop": stop_before_wall,
    "upright": keep_upright,
    "follow": follow_line,
}
"""Functions that make the lesson of a goal for a robot."""


def lesson_for(
    robot: Robot,
    world: str,
    *,
    is_held: bool = False,
) -> Lesson | None:
    """The lesson that suits a robot in a world of that name, if there is one. ``is_held``: whether
    a hand has to hold it there, as it stands on one axle."""
    # What drives on wheels does not walk, though its motors turn endlessly too.
    goal = "walk" if robot.drive_base is None else _DRIVING.get(world)
    if is_held:
        goal = "upright"
    if goal is not None:
        with contextlib.suppress(DescriptionError):
            return LESSONS[goal](robot)
    return None


_DRIVING = {
    "wall": "stop",
    "line-simple": "follow",
    "line-sharp": "follow",
    "line-gaps": "follow",
}
"""Goals of robots that drive, by the world."""


def described(lesson: Lesson) -> dict[str, Any]:
    """A lesson for the page: ``goal``, ``unit``, and ``numbers`` with their ranges."""
    numbers = []
    for label, entry in zip(lesson.labels, lesson.structure.numbers, strict=True):
        numbers.append({"name": label, "low": entry.low, "high": entry.high, "unit": entry.unit})
    trial_s = lesson.steps * lesson.step_ms / 1000
    return {"goal": lesson.goal, "unit": lesson.unit, "numbers": numbers, "trial_s": trial_s}
