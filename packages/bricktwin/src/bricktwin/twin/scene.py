"""Scene of a virtual robot: surroundings, and start pose of the robot."""

import math
from collections.abc import Mapping
from dataclasses import dataclass, field

from brickhub.errors import TwinError
from brickhub.virtual.stimuli import Reading
from bricktwin.twin.objects import Ball, Block, Mark, Object, Point, Pushable, Solid

FLOOR = (0.82, 0.82, 0.84)
"""Reflectance of red, green and blue light of the bare floor."""
_MAX_HEADING_AT_WALL_DEG = 60.0
_OBJECT = "Block(at_mm=(300, 0))"

_MOST_HELD_DEG = 45.0


@dataclass(frozen=True)
class Scene:
    """Scene of a flat floor with an optional wall ahead of the robot, and objects. Raises TwinError
    if a range is invalid.

    Attributes:
        wall_distance_mm: lowest and highest distance from the ultrasonic sensor to the wall at the
            start, drawn uniformly; ``None`` for an open floor.
        heading_deg: lowest and highest heading at the start, drawn uniformly, clockwise positive; 0
            looks straight at the wall.
        objects: what lies on the floor, walls, blocks, balls, ramps, lamps and beacons: see
            ``bricktwin.twin.objects``.
        start_mm: ranges of x and y of the robot's start position, drawn uniformly; ignored with a
            wall ahead.
        others_start: where further robots start that share the scene, x, y (mm) and heading of
            each; what can be pushed leaves its place for them. Beyond these they start beside the
            first one.
        held_deg: lowest and highest pitch, nose down positive, at which a hand holds the robot at
            the start, drawn uniformly; it lets go when a motor first gets a voltage. ``None`` for a
            robot that stands by itself.
        light_pct: ambient light of the room, as read by an ambient light sensor.
        ball: a red ball in the gripper, for robots that have one.
        readings: for a robot without a MuJoCo model: stimuli of its sensors, as functions of the
            angles of its motors (deg at the output, by motor name). The name of a sensor, such as
            ``"light"``, is its first sense, ``"light.ambient"`` another one; see
            ``virtual_hub/stimuli.py``.
        end_stops: lowest and highest angle of a motor (deg at the output, by motor name), at which
            it stalls, in place of those of the robot's description.
    """

    wall_distance_mm: tuple[float, float] | None = None
    heading_deg: tuple[float, float] = (0.0, 0.0)
    objects: tuple[Object, ...] = ()
    start_mm: tuple[tuple[float, float], tuple[float, float]] = ((0.0, 0.0), (0.0, 0.0))
    others_start: tuple[tuple[float, float, float], ...] = ()
    held_deg: tuple[float, float] | None = None
    light_pct: float = 20.0
    ball: bool = False
    # Without them in the hash, as a dict has none; scenes are keys of compiled models.
    readings: Mapping[str, Reading] = field(default_factory=dict, hash=False)
    end_stops: Mapping[str, tuple[float, float]] = field(default_factory=dict, hash=False)

    def __post_init__(self) -> None:
        _check_range(
            "heading_deg",
            self.heading_deg,
            -180.0,
            180.0,
        )
        for axis, bounds in zip("xy", self.start_mm, strict=True):
            _check_range(
                f"start_mm along {axis}",
                bounds,
                -10_000.0,
                10_000.0,
            )
        for start in self.others_start:
            is_pose = isinstance(start, tuple | list) and len(start) == 3
            if not (is_pose and all(map(_is_finite, start))):
                raise TwinError(
                    f"scene: another robot starts at {start}; give x, y (mm) and a heading (deg)"
                )
        if self.held_deg is not None:
            _check_range(
                "held_deg",
                self.held_deg,
                -_MOST_HELD_DEG,
                _MOST_HELD_DEG,
            )
        if not 0.0 <= self.light_pct <= 100.0:
            raise TwinError(f"scene: light_pct is {self.light_pct}; give 0 to 100")
        if not isinstance(self.objects, tuple | list):
            raise TwinError(
                f"scene: objects is of type {type(self.objects).__name__}; give several, as in "
                f"({_OBJECT},)"
            )
        # A list is welcome.
        object.__setattr__(self, "objects", tuple(self.objects))
        for item in self.objects:
            if not isinstance(item, Object):
                raise TwinError(
                    f"scene: {item!r:.40} is not an object; give those of bricktwin.twin.objects, "
                    f"such as {_OBJECT}"
                )
        for name, reading in self.readings.items():
            if not callable(reading):
                raise TwinError(
                    f"scene: the reading of '{name}' is {reading!r}; give a function: lambda "
                    f"angles: {reading!r}"
                )
        for name, (low, high) in self.end_stops.items():
            if not low <= 0.0 <= high:
                raise TwinError(
                    f"scene: the end stops of '{name}' are {low:g} and {high:g}; give (low, high) "
                    "around 0, where it starts"
                )
        if self.wall_distance_mm is not None:
            _check_range(
                "wall_distance_mm",
                self.wall_distance_mm,
                20.0,
                5000.0,
            )
            _check_range(
                "heading_deg before a wall",
                self.heading_deg,
                -_MAX_HEADING_AT_WALL_DEG,
                _MAX_HEADING_AT_WALL_DEG,
            )

    @property
    def marks(self) -> list[Mark]:
        """What lies on the floor, the lowest first."""
        return [item for item in self.objects if isinstance(item, Mark)]

    @property
    def solids(self) -> list[Solid]:
        """What robots and ultrasound hit; in a model, the geometry ``object_N`` is the N-th."""
        return [item for item in self.objects if isinstance(item, Solid)]

    @property
    def pushable(self) -> dict[int, Pushable]:
        """What can be pushed, by its number among the solids."""
        pushable: dict[int, Pushable] = {}
        for number, item in enumerate(self.solids):
            if isinstance(item, Ball) or (isinstance(item, Block) and item.mass_g is not None):
                pushable[number] = item
        return pushable


def _is_finite(value: object) -> bool:
    """Whether a value of a user's is a finite number."""
    return isinstance(value, int | float) and math.isfinite(value)


def _check_range(
    name: str,
    bounds: tuple[float, float],
    lowest: float,
    highest: float,
) -> None:
    """Raise TwinError unless this is a lower and an upper end within these limits."""
    try:
        low, high = map(float, bounds)
    except (TypeError, ValueError):
        # No pair of numbers.
        low = math.nan
        high = math.nan
    are_finite = math.isfinite(low) and math.isfinite(high)
    if not (are_finite and lowest <= low <= high <= highest):
        raise TwinError(
            f"scene: {name} is {bounds}; give (low, high) within {lowest:g} to {highest:g}"
        )


OPEN_FLOOR = Scene()


@dataclass(frozen=True)
class Goal:
    """Pose that a robot is to reach, drawn as its ghost.

    Attributes:
        angles_deg: goal angles of its motors, by name.
        at_mm: goal position on the floor; ``None`` for a robot that is to go nowhere.
        heading_deg: heading there, clockwise from x.
    """

    angles_deg: Mapping[str, float] = field(default_factory=dict)
    at_mm: Point | None = None
    heading_deg: float = 0.0
