"""Standing robot: where a robot is in its scene, and how it is put down at the start of an
episode."""

import dataclasses
import itertools
import math
from collections.abc import Callable, Sequence

from brickhub.robot import Robot
from brickhub.virtual.body import Rng
from bricktwin.twin.bindings import bind_motors, bind_root, bind_sensors
from bricktwin.twin.engines.conventions import object_name
from bricktwin.twin.engines.engine import Engine
from bricktwin.twin.engines.rotations import (
    Quaternion,
    minus,
    product,
    rotated_back,
    vector,
    yaw_quaternion,
)
from bricktwin.twin.model_physics import backlash_joints, set_physics
from bricktwin.twin.physics import Physics, RandomPhysics
from bricktwin.twin.scene import Scene
from bricktwin.twin.senses import FixedBase, FloatingBase, Turns
from bricktwin.twin.settling import come_to_rest, halt, settle
from bricktwin.twin.stance import refuse_overlap, standing_pose

_FAR_M = 100.0


@dataclasses.dataclass(frozen=True)
class Pose:
    """Pose of a robot.

    Attributes:
        x_m, y_m: position of the chassis' origin on the floor (2Wheeler: the middle of its axle;
        RoboArm: always 0).
        heading_deg: clockwise positive seen from above, 0 along x, not wrapped.
    """

    x_m: float
    y_m: float
    heading_deg: float


def _choice_of(is_upper: Sequence[bool]) -> Callable[[float, float], float]:
    """Function that chooses an end of each range that it is asked for: of the first one the end
    that the first flag names, and so on."""
    flags = iter(is_upper)

    def choose(low: float, high: float) -> float:
        return high if next(flags) else low

    return choose


class StandingRobot:
    """Robot in a model, which can be put down.

    Args:
        robot: description of the robot.
        scene: surroundings of the robot.
        engine: model of both; in an arena that of all its robots.
        prefix: begins the names of this robot in an arena.

    Attributes:
        motors: where its motors are in the model.
        chassis: index of the first body; ``moves``: whether it moves freely.
        base_address: of the first position of its joint.
        is_held: whether a hand holds it now.
        physics: the present parameters.
    """

    def __init__(
        self,
        robot: Robot,
        scene: Scene,
        engine: Engine,
        physics: Physics,
        prefix: str,
    ) -> None:
        self.robot = robot
        self.scene = scene
        self.engine = engine
        root = bind_root(engine, prefix)
        self.motors = bind_motors(engine, robot, prefix)
        self._sensors = bind_sensors(
            engine,
            robot,
            scene,
            root,
            prefix,
        )
        self.chassis = root.body
        self.moves = root.is_free
        self.base_address = root.address
        self._base_dof = root.dof
        self._feet = root.feet
        imu = f"{prefix}imu"
        self._base: FloatingBase | FixedBase
        if self.moves:
            self._base = FloatingBase(
                engine,
                root.address,
                root.dof,
                imu,
            )
        else:
            self._base = FixedBase(engine, imu)
        self._turns = Turns()
        # A pushable block has a free joint, after the robot's joints.
        addresses = engine.indices("jnt_qposadr")
        self._block_addresses: list[int] = []
        for number in scene.pushable:
            joint = engine.index("joint", object_name(number))
            self._block_addresses.append(addresses[joint])
        self.is_held = False
        self._use(physics)

    def _use(self, physics: Physics) -> None:
        """Set the parameters that are not the model's."""
        self.physics = physics

    def _apply(self, physics: Physics) -> None:
        """Set all parameters, those of the model too."""
        self._use(physics)
        engine = self.engine
        set_physics(
            engine,
            physics,
            [self],
            range(len(engine.names("body"))),
        )
        # With less play than before, a joint may be beyond its limit, which would throw it back.
        ranges = engine.parameters("jnt_range")
        addresses = engine.indices("jnt_qposadr")
        for joint in backlash_joints(engine):
            play = ranges[2 * joint + 1]
            address = addresses[joint]
            engine.qpos[address] = min(max(engine.qpos[address], -play), play)

    # ---------------------------------------------------------------- the start of an episode

    def begin(
        self,
        physics: Physics | RandomPhysics,
        rng: Rng,
    ) -> None:
        """Settle, try all starts, and put the robot down for the first time. ``rng``: generator of
        the first start. Raises TwinError if the robot cannot stand at each of its starts."""
        self._random_physics = physics if isinstance(physics, RandomPhysics) else None
        self.is_held = self._falls_by_itself
        self._apply(self.physics)
        # All starts are tried before the first one, so that no later episode fails.
        self._settle()
        self._check_starts()
        self.reset(rng)

    def _settle(self) -> None:
        """Let a robot on wheels settle on the floor and record its stance."""
        # What stands on feet derives its stance from its legs, at each start.
        if self._feet is not None or not self.moves:
            return
        engine = self.engine
        if self.scene.objects:
            # Away from objects at the start position.
            engine.qpos[0] = _FAR_M
        settle(engine, [self])
        self.record_stance()
        # The stance is kept, but a motor begins at 0, in the middle of its play.
        addresses = engine.indices("jnt_qposadr")
        for joint in backlash_joints(engine):
            engine.qpos[addresses[joint]] = 0.0
        for address, _ in self.motors.shafts.values():
            engine.qpos[address] = 0.0

    def reset(self, rng: Rng) -> None:
        """Put the robot down at the start of an episode and let it come to rest; motors keep their
        angles, clock and program continue. ``rng``: generator of the start pose, and of the physics
        if random."""
        if self._random_physics is not None:
            drawn = self._random_physics.sample(rng)
            if not self.moves:
                # A load on a base that is fixed changes nothing, and is refused.
                drawn = dataclasses.replace(drawn, side_load_g=0.0)
            self._apply(drawn)
        halt(self.engine)
        self.is_held = self._falls_by_itself
        self._reset_blocks(rng)
        if self.moves:
            self._place(rng.uniform)
        come_to_rest(self.engine, [self], self.scene)

    def _check_starts(self) -> None:
        """Raise TwinError if the robot would be inside of an obstacle at an end of the ranges of
        its start."""
        has_obstacles = self.scene.objects or self.scene.wall_distance_mm is not None
        if self.moves and has_obstacles:
            # Four ranges at most: heading, x, y and the distance of the wall.
            for ends in itertools.product((False, True), repeat=4):
                self._place(_choice_of(ends))
                self.engine.forward()
                refuse_overlap(self.engine, self.scene)

    def _reset_blocks(self, rng: Rng) -> None:
        """Put pushable blocks, and what a hand has moved, back to their start positions."""
        engine = self.engine
        places_m = engine.nominal("body_pos")
        for body, number in enumerate(engine.indices("body_mocapid")):
            # -1: not moved by a hand.
            if number >= 0:
                for axis in range(3):
                    engine.mocap_pos[3 * number + axis] = places_m[3 * body + axis]
        starts = engine.nominal("qpos0")
        blocks = self.scene.pushable.values()
        for address, block in zip(self._block_addresses, blocks, strict=True):
            for number in range(address, address + 7):
                engine.qpos[number] = starts[number]
            # What has one place draws nothing.
            if not any(block.spread_mm):
                continue
            for axis, spread_mm in enumerate(block.spread_mm):
                spread_m = spread_mm / 1000
                engine.qpos[address + axis] += rng.uniform(-spread_m, spread_m)

    def _place(self, draw: Callable[[float, float], float]) -> None:
        """Place the robot on the floor, in front of the wall if there is one; ``draw`` chooses from
        a range."""
        heading_deg = draw(*self.scene.heading_deg)
        start_m = []
        for low, high in self.scene.start_mm:
            # Most scenes have one place, for which nothing is drawn.
            place_mm = low if low == high else draw(low, high)
            start_m.append(place_mm / 1000)
        x_m, y_m = start_m
        self.put(Pose(x_m, y_m, heading_deg))
        if self.is_held and self.scene.held_deg is not None:
            self._lean(math.radians(draw(*self.scene.held_deg)))
        if self.scene.wall_distance_mm is not None:
            self.face_wall(draw(*self.scene.wall_distance_mm), heading_deg)

    @property
    def _falls_by_itself(self) -> bool:
        return self.moves and self.scene.held_deg is not None

    def hold(self, orientation: Quaternion) -> None:
        """Turn the robot back to an orientation, at rest, as a hand does that holds it."""
        engine = self.engine
        for number, value in enumerate(orientation, self.base_address + 3):
            engine.qpos[number] = value
        for number in range(self._base_dof + 3, self._base_dof + 6):
            engine.qvel[number] = 0.0

    def _lean(self, pitch: float) -> None:
        """Turn the robot that was put down nose down, by so many radians, about its axle: it stays
        as high as it is."""
        first = self.base_address + 3
        w, x, y, z = self.engine.qpos[first : first + 4]
        # About the axis to the left, in its own frame.
        lean = (math.cos(pitch / 2), 0.0, math.sin(pitch / 2), 0.0)
        self.hold(product((w, x, y, z), lean))

    # ---------------------------------------------------------------- where it is

    def face_wall(
        self,
        distance_mm: float,
        heading_deg: float,
    ) -> None:
        """Put the robot on the floor with its first ultrasonic sensor at this distance from the
        scene's wall."""
        engine = self.engine
        self.put(Pose(0.0, 0.0, heading_deg))
        middle_m = engine.nominal("body_pos")[3 * engine.index("body", "wall")]
        half_thickness_m = engine.nominal("geom_size")[3 * engine.index("geom", "wall")]
        face_m = middle_m - half_thickness_m
        # A floating base reads its orientation from the positions, which `put` has set: no physics
        # has to run before the sensor's place is known.
        sonar = next(iter(self._sensors.ranges_mm))
        position_m, _ = self._sensors.gazes[sonar]
        x_m, y_m, _ = self._base.in_world(position_m)
        engine.qpos[0] = face_m - distance_mm / 1000 - x_m
        engine.qpos[1] = -y_m

    def put(self, start: Pose) -> None:
        """Put the standing robot on the floor."""
        standing, height_m = self._stand()
        # A heading is clockwise, a rotation about the vertical counter-clockwise.
        turn = yaw_quaternion(-math.radians(start.heading_deg))
        pose = (
            start.x_m,
            start.y_m,
            height_m,
            *product(turn, standing),
        )
        for number, value in enumerate(pose, self.base_address):
            self.engine.qpos[number] = value

    def record_stance(self) -> None:
        """Record the stance of a robot on wheels, after it has settled on the floor."""
        _, _, height_m, w, x, y, z = self.engine.qpos[self.base_address : self.base_address + 7]
        self._standing = (w, x, y, z), height_m

    def _stand(self) -> tuple[Quaternion, float]:
        """Orientation and height of the standing robot: constant on wheels, derived from the
        present leg angles on legs."""
        if self._feet is None:
            return self._standing
        engine = self.engine
        engine.kinematics()
        first = 3 * self.chassis
        origin_m = vector(engine.derived("xpos")[first : first + 3])
        centre_m = vector(engine.derived("subtree_com")[first : first + 3])
        first = 4 * self.chassis
        frame = tuple(engine.derived("xquat")[first : first + 4])
        # Feet and centre of mass of the whole robot, from the chassis as it lies now.
        points = self._feet.points_m()
        largest_m = max(radius_m for _, radius_m in points)
        points_m = []
        for point_m, radius_m in points:
            x_m, y_m, z_m = rotated_back(minus(point_m, origin_m), frame)
            # Corners and smaller balls are as low as balls of the largest radius higher up.
            raised_m = z_m + (largest_m - radius_m)
            points_m.append((x_m, y_m, raised_m))
        centre_m = rotated_back(minus(centre_m, origin_m), frame)
        quaternion, height_m = standing_pose(points_m, centre_m)
        return quaternion, height_m + largest_m

    def pose(self) -> Pose:
        """True pose of the robot: for metrics, not for agents."""
        self.update_turns()
        x_m, y_m, _ = self._base.position()
        return Pose(x_m, y_m, self._turns.heading_deg)

    def update_turns(self) -> None:
        """Add the turn since the last call; to be called before the robot has turned by half a
        turn."""
        self._turns.update(self._base.orientation())
