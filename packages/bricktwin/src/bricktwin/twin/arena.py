"""Arena: several virtual robots in one world and on one clock.

Each robot's hub has a separate body, and all bodies are parts of one world. The world advances only
after every hub has run up to that time: a hub that lets time pass first runs the other hubs, so
that each motor's voltage is set before the physics step that it acts in. The simulation is
deterministic, bit for bit. It needs neither NumPy nor MuJoCo, as a tab has neither.
"""

import math
from collections.abc import Callable, Sequence
from dataclasses import dataclass
from typing import Generic, TypeVar

from brickhub.errors import TwinError
from brickhub.robot import Robot
from brickhub.virtual.body import Rng
from bricktwin.twin.body import STEPS_PER_LOAD, NoiseSources, TwinBody
from bricktwin.twin.engines.conventions import object_name
from bricktwin.twin.engines.engine import Engine
from bricktwin.twin.engines.rotations import yaw_quaternion
from bricktwin.twin.model_physics import set_physics
from bricktwin.twin.models.shared_scene import shared_scene, starts_in
from bricktwin.twin.physics import Physics
from bricktwin.twin.scene import OPEN_FLOOR, Scene
from bricktwin.twin.senses import clockwise_deg
from bricktwin.twin.settling import come_to_rest, halt, settle
from bricktwin.twin.standing import Pose

_MAX_DRAWS = 20_000
"""Start poses that are drawn before an arena counts as too narrow."""
_DRAWS_AT_ONCE = 200
"""Start poses that are drawn for one arrangement of the first robots."""
_FAR_M = 100.0
"""Where robots settle, away from the objects of their scene."""
COLORS = (
    (0.1, 0.6, 0.6),
    (0.9, 0.5, 0.1),
    (0.55, 0.35, 0.75),
    (0.85, 0.25, 0.35),
)
"""Colours by which neighbours are known."""
_MAX_MOTORS = 31
"""Number of actuator groups that MuJoCo can disable."""

Range = tuple[float, float]
B = TypeVar("B", bound="SharingBody")


@dataclass(frozen=True)
class Place:
    """Ranges of a start pose, drawn uniformly: metres, and degrees clockwise seen from above, 0
    along x."""

    x_m: Range = (0.0, 0.0)
    y_m: Range = (0.0, 0.0)
    heading_deg: Range = (0.0, 0.0)

    def draw(self, rng: Rng) -> Pose:
        """Draw a start pose."""
        # In this order: runs with a seed are repeated by it.
        x_m = rng.uniform(*self.x_m)
        y_m = rng.uniform(*self.y_m)
        heading_deg = rng.uniform(*self.heading_deg)
        return Pose(x_m, y_m, heading_deg)


@dataclass(frozen=True)
class Contestant:
    """Robot in an arena: its name, description, start pose, and identifying colour (RGB in
    0..1)."""

    name: str
    robot: Robot
    place: Place
    color: tuple[float, float, float] = (0.1, 0.6, 0.6)


@dataclass(frozen=True)
class Load:
    """Box that robots can push, with its half sizes (along x, y and z) in metres and its friction
    on the floor."""

    name: str
    half_size_m: tuple[float, float, float]
    mass_kg: float
    friction: float
    place: Place


@dataclass(frozen=True)
class Mark:
    """Box that is only seen, such as a post of a gate, with its half sizes (along x, y and z) in
    metres and its colour (RGB in 0..1). Robots drive through it."""

    name: str
    half_size_m: tuple[float, float, float]
    color: tuple[float, float, float]


@dataclass(frozen=True)
class Arena:
    """Robots, start places and scene. Raises TwinError if names are not unique, or there are too
    many motors.

    Attributes:
        marks: what else is seen; a task says where, see ``ArenaWorld.put_marks``.
        half_size_m: half size of the floor within the walls, along x and y; ``None`` for an open
            floor.
        gap_m: least distance between any two robots at the start.
        scene: whose objects lie on the floor, too.
    """

    robots: tuple[Contestant, ...]
    loads: tuple[Load, ...] = ()
    half_size_m: tuple[float, float] | None = None
    gap_m: float = 0.3
    marks: tuple[Mark, ...] = ()
    scene: Scene = OPEN_FLOOR

    def __post_init__(self) -> None:
        # They begin the names of all parts in the model.
        names = [contestant.name for contestant in self.robots]
        names += [load.name for load in self.loads]
        names += [mark.name for mark in self.marks]
        if not self.robots or len(set(names)) < len(names):
            raise TwinError(
                f"an arena of {', '.join(names) or 'nothing'}; give each robot, load and mark a "
                "name of its own"
            )
        motors = sum(len(contestant.robot.motors) for contestant in self.robots)
        if motors > _MAX_MOTORS:
            raise TwinError(
                f"the robots of an arena have more than {_MAX_MOTORS} motors; take fewer robots"
            )

    def too_narrow(self) -> TwinError:
        """The error for starts that are not found."""
        names = ", ".join(contestant.name for contestant in self.robots)
        text = f"no starts were found where {names} are {self.gap_m:g} m apart"
        return TwinError(f"{text}; give them other places, or the arena a smaller gap_m")


def side_by_side(robots: Sequence[Robot], scene: Scene = OPEN_FLOOR) -> Arena:
    """Robots that share a scene, and stand where it has room for them: side by side on an open
    floor, from right to left, and look ahead. Raises TwinError if there is no room, or the scene is
    for one robot alone."""
    scene = shared_scene(scene)
    contestants = []
    for number, (x_m, y_m, heading_deg) in enumerate(starts_in(scene, len(robots))):
        contestants.append(
            Contestant(
                f"robot{number + 1}",
                robots[number],
                Place((x_m, x_m), (y_m, y_m), (heading_deg, heading_deg)),
                COLORS[number % len(COLORS)],
            )
        )
    return Arena(tuple(contestants), gap_m=0.0, scene=scene)


class SharedWorld(Generic[B]):
    """World of an arena, with a body for each robot's hub.

    Args:
        engine: engine of the arena's one model.
        embody: makes the body of a robot, see :class:`SharingBody`.
        physics: physics of all robots.
        noises: generators of the sensors' noise, for each robot.

    Attributes:
        engine: engine of the one model.
        bodies: bodies in the order of the arena's robots.
        runners: functions that run a robot's hub up to a time in ms, in the same order; to be set
            before any time passes.
        on_time: functions that are called with each time in ms that the world has reached, such as
            for a film.
        steps: of the physics since the world was made.
    """

    def __init__(
        self,
        arena: Arena,
        engine: Engine,
        embody: "Callable[[SharedWorld[B], Contestant, Physics, NoiseSources], B]",
        physics: Physics,
        noises: Sequence[NoiseSources],
    ) -> None:
        self.arena = arena
        self.engine = engine
        self.time_ms = 0
        self.steps = 0
        self.runners: list[Callable[[int], None]] = []
        self.on_time: list[Callable[[int], None]] = []
        self._target_ms: dict[int, int] = {}
        self.bodies: list[B] = []
        for contestant, noise in zip(arena.robots, noises, strict=True):
            self.bodies.append(embody(self, contestant, physics, noise))
        # Loads are what their description says, whatever the physics of the robots.
        loads: list[int] = []
        self._loads: list[int] = []
        """Address of the first position of each load."""
        for load in arena.loads:
            loads.append(engine.index("body", load.name))
            joint = engine.index("joint", load.name)
            self._loads.append(engine.indices("jnt_qposadr")[joint])
        # So is what can be pushed in the scene.
        self._pushable: list[int] = []
        """Address of the first position of each thing of these."""
        for number in arena.scene.pushable:
            loads.append(engine.index("body", object_name(number)))
            joint = engine.index("joint", object_name(number))
            self._pushable.append(engine.indices("jnt_qposadr")[joint])
        bodies = range(len(engine.names("body")))
        scaled = [body for body in bodies if body not in loads]
        set_physics(
            engine,
            physics,
            self.bodies,
            scaled,
        )
        self._settle()

    def _settle(self) -> None:
        """Let all robots settle on the floor, far from one another, and record their stances."""
        addresses = [body.base_address for body in self.bodies] + self._loads
        first_m = _FAR_M if self.arena.scene.objects else 0.0
        for number, address in enumerate(addresses):
            self.engine.qpos[address] = first_m + 2.0 * number
        settle(self.engine, self.bodies)
        for body in self.bodies:
            body.record_stance()

    def place(self, rng: Rng) -> None:
        """Place robots and loads for the start of an episode; motors keep their angles, the clock
        is not reset. Raises TwinError if no starts are found that keep the arena's gap, or a robot
        would be inside of a wall or load."""
        starts = self._starts(rng)
        engine = self.engine
        halt(engine)
        for body, start in zip(self.bodies, starts, strict=True):
            body.put(start)
        for load, address in zip(self.arena.loads, self._loads, strict=True):
            start = load.place.draw(rng)
            pose = (
                start.x_m,
                start.y_m,
                load.half_size_m[2],
                *yaw_quaternion(-math.radians(start.heading_deg)),
            )
            for number, value in enumerate(pose, address):
                engine.qpos[number] = value
        starts_of_all = engine.nominal("qpos0")
        for address in self._pushable:
            # Where the scene has it, as all robots are to find the same.
            for number in range(address, address + 7):
                engine.qpos[number] = starts_of_all[number]
        scene = self.arena.scene
        come_to_rest(engine, self.bodies, scene if scene.objects else None)

    def _starts(self, rng: Rng) -> list[Pose]:
        """Start poses that keep the arena's gap, drawn until they do."""
        starts: list[Pose] = []
        for number in range(1, _MAX_DRAWS + 1):
            next_robot = self.arena.robots[len(starts)]
            start = next_robot.place.draw(rng)
            if all(_apart_m(start, other) >= self.arena.gap_m for other in starts):
                starts.append(start)
            if len(starts) == len(self.arena.robots):
                return starts
            if number % _DRAWS_AT_ONCE == 0:
                # The first robots may leave no room for the others.
                starts.clear()
        raise self.arena.too_narrow()

    def put_marks(self, places_m: Sequence[Sequence[float]]) -> None:
        """Put the arena's marks at these places, x and y in metres, in its order."""
        numbers = self.engine.indices("body_mocapid")
        for mark, (x_m, y_m) in zip(self.arena.marks, places_m, strict=True):
            address = 3 * numbers[self.engine.index("body", mark.name)]
            self.engine.mocap_pos[address] = x_m
            self.engine.mocap_pos[address + 1] = y_m
        self.engine.forward()

    def poses(self) -> list[Pose]:
        """True poses of the robots, then of the loads."""
        poses = [body.pose() for body in self.bodies]
        for address in self._loads:
            x_m, y_m, _, *orientation = self.engine.qpos[address : address + 7]
            poses.append(Pose(x_m, y_m, clockwise_deg(orientation)))
        return poses

    def distance_m(self, one: int, other: int) -> float:
        """True distance of two robots, by number."""
        return _apart_m(self.bodies[one].pose(), self.bodies[other].pose())

    def advance_for(
        self,
        number: int,
        time_ms: int,
    ) -> None:
        """Advance the world to ``time_ms`` for robot ``number``, after running all other hubs up to
        that time."""
        # Running another hub comes here again, for that hub: those that wait have a target.
        self._target_ms[number] = time_ms
        try:
            while self.time_ms < time_ms:
                # No further than the nearest target, at which that hub may set a voltage. One that
                # is reached holds nobody up: its hub waits for one that is ending its program.
                ahead = [target for target in self._target_ms.values() if target > self.time_ms]
                next_ms = min(ahead)
                for other, run in enumerate(self.runners):
                    if other not in self._target_ms and self.time_ms < next_ms:
                        run(next_ms)
                if self.time_ms < next_ms:
                    self._advance_to(next_ms)
        finally:
            # A hub that was interrupted waits no more: the others would wait for it for ever.
            del self._target_ms[number]

    def _advance_to(self, time_ms: int) -> None:
        remaining = time_ms * 2 // 5 - self.steps  # steps of 2.5 ms
        while remaining > 0:
            steps = min(remaining, STEPS_PER_LOAD - self.steps % STEPS_PER_LOAD)
            self.engine.step(steps)
            remaining -= steps
            self.steps += steps
            for body in self.bodies:
                body.steps = self.steps
                body.update_turns()
                if self.steps % STEPS_PER_LOAD == 0:
                    body.load_battery()
        self.time_ms = time_ms
        for call in self.on_time:
            call(time_ms)


def _apart_m(pose: Pose, other: Pose) -> float:
    """Distance of two poses."""
    return math.hypot(pose.x_m - other.x_m, pose.y_m - other.y_m)


class SharingBody(TwinBody):
    """Part of an arena's world that belongs to one robot; implements
    :class:`brickhub.virtual.body.Body`."""

    def __init__(
        self,
        world: "SharedWorld[B]",
        contestant: Contestant,
        physics: Physics,
        noise: NoiseSources,
    ) -> None:
        self._arena = world
        self._number = world.arena.robots.index(contestant)
        # Without a model of its own: it is a part of the arena's.
        TwinBody.__init__(
            self,
            contestant.robot,
            world.arena.scene,
            world.engine,
            physics,
            noise,
            f"{contestant.name}/",
        )

    def reset(self, rng: Rng) -> None:
        """Place all robots for the start of an episode."""
        self._arena.place(rng)

    def advance_to(self, time_ms: int) -> None:
        """Advance the world to this time, and all other robots with it."""
        self._arena.advance_for(self._number, time_ms)
