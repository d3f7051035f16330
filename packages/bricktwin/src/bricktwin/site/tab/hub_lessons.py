"""Lessons on a real robot, which has to measure by itself how good a trial was, and has to be where
a trial can begin."""

import itertools
from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace
from typing import ClassVar

from brickhub.errors import DescriptionError
from brickhub.hub.interface import Distance, Heading, Interface, Pitch
from brickhub.hub.trial_protocol import MOST_STEPS
from brickhub.robot import Robot, UltrasonicSensor
from brickhub.robot.line_edge import edge_of
from bricktwin.site.tab.lessons import (
    Lesson,
    Record,
    follow_line,
    keep_upright,
    light_of,
    stop_before_wall,
    walk,
)

_NO_ECHO_MM = 1990.0
"""Distance from which on the sensor has seen nothing."""
_WALK_NEAREST_MM = 350.0
"""A trial of legs takes less than 250 mm; the sensor sees nothing nearer than 40 mm."""
_WALK_FARTHEST_MM = 1700.0
_WALK_WANTED_MM = 1300.0
_POSTURE_STEPS = 2
_POSTURE_SPEED = 0.4
_TURNED_DEG = 35.0
"""Turn of a robot after which it no longer looks at the wall."""
_STOP_WANTED_MM = 600.0
_STOP_TOLERANCE_MM = 90.0
_BACK_GAIN = 1.5
_AT_EDGE_PCT = 25.0
"""Difference from the edge at which a robot surely still sees it."""
_UPRIGHT_DEG = 12.0
"""Twice the largest lean of a robot in balance: a hand is not more exact."""


@dataclass(frozen=True)
class Place:
    """Where a trial may begin.

    Attributes:
        asks_each_time: whether a person is asked before each trial, not only where the robot is
            elsewhere.
        nearest_mm, farthest_mm: distances to the wall.
        wanted_mm: where a person puts it, or it drives itself.
        distance: index of the channel.
        heading: index of the heading, if it matters.
        way_back: numbers ``[p]`` by which the robot drives there by itself; none for one that
            cannot.
        another_posture: numbers by which a robot that sees nothing turns its legs a little: at rest
            on its toes it may look over or under everything.
    """

    asks_each_time: ClassVar[bool] = False
    nearest_mm: float
    farthest_mm: float
    wanted_mm: float
    distance: int
    heading: int | None = None
    way_back: tuple[float, ...] | None = None
    another_posture: tuple[float, ...] | None = None

    def asked(self, observed: Sequence[float]) -> dict[str, float]:
        """What a person is told who has to put the robot back."""
        return {"distance_mm": round(observed[self.distance]), "wanted_mm": self.wanted_mm}

    def way_from(self, observed: Sequence[float]) -> tuple[tuple[float, ...], int] | None:
        """Numbers and steps by which the robot may get here by itself, if it can."""
        is_blind = observed[self.distance] >= _NO_ECHO_MM
        if self.another_posture is not None and is_blind:
            return self.another_posture, _POSTURE_STEPS
        return None if self.way_back is None else (self.way_back, MOST_STEPS)

    def is_there(self, observed: Sequence[float], first_heading_deg: float | None) -> bool:
        """Whether a robot that observes this may begin. ``first_heading_deg``: its heading when it
        was put here last."""
        is_turned = False
        if self.heading is not None and first_heading_deg is not None:
            turned_deg = observed[self.heading] - first_heading_deg
            is_turned = abs((turned_deg + 180.0) % 360.0 - 180.0) > _TURNED_DEG
        return self.nearest_mm <= observed[self.distance] <= self.farthest_mm and not is_turned


@dataclass(frozen=True)
class AtEdge:
    """Where a trial may begin along a line: anywhere at its edge.

    Attributes:
        reflection: index of the channel.
        edge_pct: what the sensor reads there.
        heading: none that matters, as the edge tells the way.
    """

    asks_each_time: ClassVar[bool] = False
    reflection: int
    edge_pct: float
    heading: int | None = None

    def asked(self, observed: Sequence[float]) -> dict[str, float]:
        """What a person is told who has to put the robot back."""
        return {"reflection_pct": round(observed[self.reflection])}

    def way_from(self, observed: Sequence[float]) -> None:
        """A robot that has lost the edge does not know where it is."""

    def is_there(self, observed: Sequence[float], first_heading_deg: float | None) -> bool:
        """Whether a robot that observes this is at the edge."""
        return abs(observed[self.reflection] - self.edge_pct) < _AT_EDGE_PCT


@dataclass(frozen=True)
class Held:
    """Where a trial of a robot begins that cannot stand: in a hand, which lets go of it when its
    wheels turn.

    Attributes:
        pitch: index of the channel.
        heading: none that matters.
    """

    asks_each_time: ClassVar[bool] = True
    pitch: int
    heading: int | None = None

    def asked(self, observed: Sequence[float]) -> dict[str, float]:
        """What a person is told who has to hold the robot."""
        return {"pitch_deg": round(observed[self.pitch])}

    def way_from(self, observed: Sequence[float]) -> None:
        """A robot that lies on the floor does not get up."""

    def is_there(self, observed: Sequence[float], first_heading_deg: float | None) -> bool:
        """Whether a robot that observes this is upright."""
        return abs(observed[self.pitch]) < _UPRIGHT_DEG


@dataclass(frozen=True)
class HubLesson:
    """A lesson, whose score needs no more than what the robot observes, and the place of its
    trials."""

    lesson: Lesson
    place: Place | AtEdge | Held


def walk_to_wall(robot: Robot) -> HubLesson:
    """Walk towards a wall, which measures the way. Raises DescriptionError without legs or an
    ultrasonic sensor."""
    lesson = walk(robot)
    channels = [*lesson.interface.channels, Distance(_eyes(robot, "how far it walks"))]
    distance = len(channels) - 1
    heading = None
    if robot.needs_imu:
        heading = len(channels)
        channels.append(Heading())
    interface = Interface(lesson.interface.commands, tuple(channels), lesson.interface.settle)

    middles = [(entry.low + entry.high) / 2 for entry in lesson.structure.numbers[1:]]

    def speed(record: Record) -> float:
        return approach_speed([observed[distance] for observed in record.observed], lesson)

    return HubLesson(
        # The structure reads the legs' angles, which are the first channels of both.
        replace(lesson, interface=interface, score=speed),
        Place(
            _WALK_NEAREST_MM,
            _WALK_FARTHEST_MM,
            _WALK_WANTED_MM,
            distance,
            heading,
            another_posture=(_POSTURE_SPEED, *middles),
        ),
    )


def approach_speed(distances_mm: Sequence[float], lesson: Lesson) -> float:
    """Speed towards the wall, mm/s, once the robot has settled; 0 if it has lost the wall from its
    sight. It is the median of the slopes between any two readings (Sen, 1968), as an ultrasonic
    sensor now and then reads something else."""
    seen = []
    for step, distance_mm in enumerate(distances_mm):
        if step >= lesson.settle_steps and distance_mm < _NO_ECHO_MM:
            seen.append((step, distance_mm))
    if 2 * len(seen) < len(distances_mm) - lesson.settle_steps:
        return 0.0
    slopes_mm = []
    for (step, distance_mm), (later, later_mm) in itertools.combinations(seen, 2):
        slopes_mm.append((distance_mm - later_mm) / (later - step))
    slopes_mm.sort()
    # Of an even number, the lower one of those in the middle.
    median_mm = slopes_mm[(len(slopes_mm) - 1) // 2] if slopes_mm else 0.0
    return median_mm * 1000 / lesson.step_ms


def stop_at_wall(robot: Robot) -> HubLesson:
    """Drive up to a wall and stop before it. Raises DescriptionError without a drive base and an
    ultrasonic sensor."""
    lesson = stop_before_wall(robot)
    # The same policy that stops before a wall drives back from it.
    place = Place(
        _STOP_WANTED_MM - _STOP_TOLERANCE_MM,
        _STOP_WANTED_MM + _STOP_TOLERANCE_MM,
        _STOP_WANTED_MM,
        distance=0,
        way_back=(_STOP_WANTED_MM, _BACK_GAIN),
    )
    return HubLesson(lesson, place)


def follow_line_on_hub(robot: Robot) -> HubLesson:
    """Follow the edge of a line. Raises DescriptionError as the lesson does."""
    edge = edge_of(robot, light_of(robot))
    return HubLesson(follow_line(robot), AtEdge(reflection=0, edge_pct=edge.edge_pct))


def keep_upright_on_hub(robot: Robot) -> HubLesson:
    """Keep upright on two wheels. Raises DescriptionError as the lesson does."""
    lesson = keep_upright(robot)
    (pitch,) = (
        index
        for index, channel in enumerate(lesson.interface.channels)
        if isinstance(channel, Pitch)
    )
    return HubLesson(lesson, Held(pitch))


def _eyes(robot: Robot, purpose: str) -> str:
    """Name of a robot's ultrasonic sensor."""
    for sensor in robot.sensors:
        if isinstance(sensor, UltrasonicSensor):
            return sensor.name
    raise DescriptionError(
        f"robot '{robot.name}' cannot measure {purpose}; give it an ultrasonic sensor"
    )


HUB_LESSONS: dict[str, Callable[[Robot], HubLesson]] = {
    "walk": walk_to_wall,
    "stop": stop_at_wall,
    "follow": follow_line_on_hub,
    "upright": keep_upright_on_hub,
}
"""Functions that make the lesson of a goal for a real robot."""
