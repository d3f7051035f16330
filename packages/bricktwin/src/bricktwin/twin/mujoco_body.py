"""Body simulated by MuJoCo: voltages in, angles and sensor readings out, with the physics of the
twin."""

import copy
import dataclasses
import functools
import itertools
import math
from collections.abc import Callable, Sequence
from pathlib import Path

import mujoco
import numpy as np

from brickhub.errors import TwinError
from brickhub.robot import Robot, Sense, UltrasonicSensor
from brickhub.virtual.body import Rng
from brickhub.virtual.stimuli import Sensed
from bricktwin.plans import ldraw_library
from bricktwin.twin.bindings import bind_motors, bind_root, bind_sensors
from bricktwin.twin.models.kept_models import robot_model
from bricktwin.twin.models.mjcf import TIMESTEP_S, yaw_quaternion
from bricktwin.twin.models.motors import motor_constants
from bricktwin.twin.models.mounts import INFRARED_MM
from bricktwin.twin.models.turning import TurningParts
from bricktwin.twin.physics import Physics, RandomPhysics
from bricktwin.twin.scene import Scene
from bricktwin.twin.senses import FixedBase, FloatingBase, SummedNoise, Turns, Vector
from bricktwin.twin.stance import refuse_overlap, standing_pose

_NEAREST_MM = UltrasonicSensor.NEAREST_MM
_FARTHEST_MM = UltrasonicSensor.FARTHEST_MM
_SETTLING_STEPS = 400
"""Most steps, a second, in which a robot comes to rest."""
_FAR_M = 100.0
_GRAVITY_MM_S2 = 9810.0
_STEPS_PER_UPDATE = 20
"""Steps between two updates of the turns: few enough that no robot turns by half a turn."""
STEPS_PER_LOAD = 2
"""Steps between two loads of the battery: the 5 ms of the firmware's control loop."""
_LOADS_PER_AVERAGE = 128
"""Loads in the slow average of the battery's voltage (Pybricks' ``battery.c``)."""
_AT_REST = 5e-3
"""Speed of each joint below which a robot is at rest, m/s and rad/s."""
_HELD_KG_M2 = 1e3
"""Inertia of a shaft that a motor holds: nothing on a robot moves it within a second."""


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


@functools.lru_cache(maxsize=8)
def _compiled(
    robot: Robot,
    scene: Scene,
    _looks: Path | None,
) -> mujoco.MjModel:
    """Compiled model, cached because a new body is made often and a copy takes a tenth of the time.
    Copy it before use."""
    return robot_model(robot, scene)


class MujocoBody:
    """Robot in MuJoCo; implements :class:`brickhub.virtual.body.Body`. Raises TwinError if there is
    no model of this robot, or it cannot be placed in this scene.

    The simulation is deterministic, bit for bit, given the arguments and the calls.

    Args:
        robot: description of the robot.
        scene: surroundings of the robot.
        physics: parameters, or a sampler of them for each reset.
        seed: seed of the sensors' noise and of the first start.

    Attributes:
        model, data: MuJoCo's model and data, e.g. for a renderer.
        tyres: geometries of the drive base's tyres, left and right, if it has such.
        chassis: index of the first body; ``moves``: whether it moves freely.
        base_address: of the first position of its joint.
        shaft_dofs: degrees of freedom of the motors' joints.
        physics: the present parameters; ``link``: those of the link.
        steps: of the physics since the body was made.
    """

    def __init__(
        self,
        robot: Robot,
        scene: Scene,
        physics: Physics | RandomPhysics,
        seed: int,
    ) -> None:
        self.robot = robot
        self.scene = scene
        self._nominal = _compiled(robot, scene, ldraw_library.folder())
        self.model = copy.copy(self._nominal)
        self.data = mujoco.MjData(self.model)
        self._random_physics = physics if isinstance(physics, RandomPhysics) else None
        self._bind()
        self._apply(Physics() if isinstance(physics, RandomPhysics) else physics)

        # A seed for each purpose: how often a sensor is read must not move the start.
        noise_seed, start_seed, heading_seed = np.random.SeedSequence(seed).spawn(3)
        self._noise = np.random.default_rng(noise_seed)
        self._heading_noise = SummedNoise(np.random.default_rng(heading_seed))
        self.steps = 0
        self._steps_since_update = 0
        self._turns = Turns()
        self._heading_at_start_deg = 0.0

        # All starts are tried before the first one, so that no later episode fails.
        self._settle()
        self._check_starts()
        self.reset(np.random.default_rng(start_seed))
        # The hub's gyroscope counts from where the robot stands when the hub is switched on.
        self._heading_at_start_deg = self._turns.heading_deg
        self._turns.rotation_rad[:] = 0.0

    def actuator(self, port: str) -> int:
        """Index of a motor's actuator in the model."""
        index, _ = self._motors.terminals[port]
        return index

    def is_stopped(self, port: str) -> bool:
        """Whether the joint of a motor has end stops."""
        joint = self.model.actuator_trnid[self.actuator(port), 0]
        return bool(self.model.jnt_limited[joint])

    def _bind(self, prefix: str = "") -> None:
        """Look up all names and arrays once; ``prefix`` begins the names of this robot in an
        arena."""
        model = self.model
        data = self.data
        root = bind_root(model, prefix)
        self._motors = bind_motors(model, data, self.robot, prefix)
        self._sensors = bind_sensors(
            model,
            data,
            self.robot,
            self.scene,
            root,
            prefix,
        )
        self.chassis = root.body
        self.moves = root.is_free
        self.base_address = root.address
        self._feet = root.feet
        self.tyres = self._motors.tyres
        self.shaft_dofs = self._motors.dofs
        imu = f"{prefix}imu"
        self._base: FloatingBase | FixedBase
        if self.moves:
            self._base = FloatingBase(
                model,
                data,
                root.address,
                root.dof,
                imu,
            )
        else:
            self._base = FixedBase(model, data, imu)
        self._turning = TurningParts(model)
        self._backlash = _backlash_joints(model)
        # A pushable block has a free joint, after the robot's joints.
        self._block_addresses: list[int] = []
        for number in self.scene.pushable:
            joint = model.joint(f"object_{number}")
            self._block_addresses.append(int(joint.qposadr[0]))
        # Kept, as each access through MuJoCo's bindings takes time.
        self._qpos = data.qpos
        self._qvel = data.qvel
        self._options = model.opt

    # ---------------------------------------------------------------- physics and start

    def _use(self, physics: Physics) -> None:
        """Set the parameters that are not the model's."""
        self.physics = physics
        self.link = physics.link
        self._up = _up(physics)
        self.battery_mv = round(physics.battery_v * 1000)
        self._terminal_v = physics.battery_v
        self._average_v = physics.battery_v
        self._encoder_step_mdeg = round(physics.encoder_resolution_deg * 1000)
        self._acceleration_bias_mm_s2: Vector = np.array(
            [
                physics.acceleration_bias_x_mm_s2,
                physics.acceleration_bias_y_mm_s2,
                physics.acceleration_bias_z_mm_s2,
            ]
        )
        self._gyro_scale = 1.0 + physics.gyro_scale_error_pct / 100.0
        # The cosine of the largest angle: what reflects has a larger one.
        self._least_echo = math.cos(math.radians(physics.echo_angle_deg))

    def _apply(self, physics: Physics) -> None:
        """Set all parameters, those of the model too."""
        model = self.model
        self._use(physics)
        set_physics(
            model,
            self._nominal,
            physics,
            [self],
            range(model.nbody),
        )
        # With less play than before, a joint may be beyond its limit, which would throw it back.
        for joint in self._backlash:
            play = model.jnt_range[joint, 1]
            address = model.jnt_qposadr[joint]
            angle = self._qpos[address]
            self._qpos[address] = min(max(angle, -play), play)

    def coast(self) -> None:
        """Let all motors coast."""
        for port in self._motors.terminals:
            self.set_voltage(port, None)

    def _settle(self) -> None:
        """Open all circuits; let a robot on wheels settle on the floor and record its stance."""
        self.coast()
        # What stands on feet derives its stance from its legs, at each start.
        if self._feet is not None or not self.moves:
            return
        if self.scene.objects:
            # Away from objects at the start position.
            self._qpos[0] = _FAR_M
        settle(self.model, self.data, [self])
        self.record_stance()
        # The stance is kept, but a motor begins at 0, in the middle of its play.
        shaft_addresses = [address for address, _ in self._motors.shafts.values()]
        play_addresses = self.model.jnt_qposadr[self._backlash]
        self._qpos[play_addresses] = 0.0
        self._qpos[shaft_addresses] = 0.0

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
        self._qvel[:] = 0.0
        self._reset_blocks(rng)
        if self.moves:
            self._place(rng.uniform)
        come_to_rest(
            self.model,
            self.data,
            [self],
            self.scene,
        )

    def _check_starts(self) -> None:
        """Raise TwinError if the robot would be inside of an obstacle at an end of the ranges of
        its start."""
        has_obstacles = self.scene.objects or self.scene.wall_distance_mm is not None
        if self.moves and has_obstacles:
            # Four ranges at most: heading, x, y and the distance of the wall.
            for ends in itertools.product((False, True), repeat=4):
                self._place(_choice_of(ends))
                mujoco.mj_forward(self.model, self.data)
                refuse_overlap(self.model, self.data, self.scene)

    def _reset_blocks(self, rng: Rng) -> None:
        """Put pushable blocks, and what a hand has moved, back to their start positions."""
        model = self.model
        is_moved_by_hand = model.body_mocapid >= 0
        self.data.mocap_pos[:] = model.body_pos[is_moved_by_hand]
        blocks = self.scene.pushable.values()
        for address, block in zip(self._block_addresses, blocks, strict=True):
            pose = slice(address, address + 7)
            self._qpos[pose] = model.qpos0[pose]
            # What has one place draws nothing.
            if not any(block.spread_mm):
                continue
            shifts_m = []
            for spread_mm in block.spread_mm:
                spread_m = spread_mm / 1000
                shifts_m.append(rng.uniform(-spread_m, spread_m))
            self._qpos[address : address + 2] += shifts_m

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
        if self.scene.wall_distance_mm is not None:
            self.face_wall(draw(*self.scene.wall_distance_mm), heading_deg)

    def face_wall(
        self,
        distance_mm: float,
        heading_deg: float,
    ) -> None:
        """Put the robot on the floor with its first ultrasonic sensor at this distance from the
        scene's wall."""
        self.put(Pose(0.0, 0.0, heading_deg))
        middle_m = self.model.body("wall").pos[0]
        half_thickness_m = self.model.geom("wall").size[0]
        face_m = middle_m - half_thickness_m
        # A floating base reads its orientation from the positions, which `put` has set: no physics
        # has to run before the sensor's place is known.
        position_m, _ = next(iter(self._sensors.sonars.values()))
        sonar_m = self._base.in_world(position_m)
        self._qpos[0] = face_m - distance_mm / 1000 - sonar_m[0]
        self._qpos[1] = -sonar_m[1]

    def put(self, start: Pose) -> None:
        """Put the standing robot on the floor."""
        standing, height_m = self._stand()
        # A heading is clockwise, a rotation about the vertical counter-clockwise.
        yaw = -math.radians(start.heading_deg)
        turn = np.array(yaw_quaternion(yaw))
        quaternion = np.empty(4)
        mujoco.mju_mulQuat(quaternion, turn, standing)
        self._qpos[self.base_address : self.base_address + 7] = (
            start.x_m,
            start.y_m,
            height_m,
            *quaternion,
        )

    def record_stance(self) -> None:
        """Record the stance of a robot on wheels, after it has settled on the floor."""
        pose = self._qpos[self.base_address : self.base_address + 7]
        _, _, height_m, *quaternion = pose.tolist()
        self._standing = np.array(quaternion), height_m

    def _stand(self) -> tuple[Vector, float]:
        """Orientation and height of the standing robot: constant on wheels, derived from the
        present leg angles on legs."""
        if self._feet is None:
            return self._standing
        model = self.model
        data = self.data
        mujoco.mj_kinematics(model, data)
        mujoco.mj_comPos(model, data)
        chassis = self.chassis
        frame = data.xmat[chassis].reshape(3, 3)
        origin_m = data.xpos[chassis]
        # Feet and centre of mass of the whole robot, from the chassis as it lies now.
        points_m = self._feet.points_m(data) - origin_m  # [n, 3]
        centre_m = data.subtree_com[chassis] - origin_m
        quaternion, height_m = standing_pose(points_m @ frame, centre_m @ frame)
        return quaternion, height_m + self._feet.radius_m

    def pose(self) -> Pose:
        """True pose of the robot: for metrics, not for agents."""
        self.update_turns()
        x_m, y_m, _ = self._base.position().tolist()
        return Pose(x_m, y_m, self._turns.heading_deg)

    def update_visuals(self) -> None:
        """Update the drawn geometry to the joint positions, for renderers; physics steps do not."""
        mujoco.mj_kinematics(self.model, self.data)
        self._turning.turn(self.model, self.data)
        mujoco.mj_camlight(self.model, self.data)

    # ---------------------------------------------------------------- time

    def advance_to(self, time_ms: int) -> None:
        """Integrate whole steps up to this simulated time."""
        remaining = time_ms * 2 // 5 - self.steps  # steps of 2.5 ms
        while remaining > 0:
            # Up to the next load of the battery in one call, as each call takes time of its own.
            steps = STEPS_PER_LOAD - self.steps % STEPS_PER_LOAD
            steps = steps if steps < remaining else remaining
            mujoco.mj_step(self.model, self.data, steps)
            remaining -= steps
            self.steps += steps
            self._steps_since_update += steps
            if self._steps_since_update >= _STEPS_PER_UPDATE:
                self.update_turns()
            if self.steps % STEPS_PER_LOAD == 0:
                self.load_battery()

    def update_turns(self) -> None:
        """Add the turn since the last call; to be called before the robot has turned by half a
        turn."""
        self._steps_since_update = 0
        self._turns.update(self._base.orientation())

    # ---------------------------------------------------------------- motors

    def load_battery(self) -> None:
        """Load the battery with the motors' present currents, and average its voltage as the
        firmware does, every 5 ms.

        A bridge gives a motor a share of the battery's voltage, and takes that share of the motor's
        current from it. The firmware chooses the share by its slow average (Pybricks'
        ``battery.c``).
        """
        motors = self._motors
        voltages = motors.voltages_v
        torques = motors.torques_nm
        power_w = 0.0
        for motor, amperes_per_nm in motors.amperes:
            power_w += voltages[motor] * torques[motor] * amperes_per_nm
        # The current follows from the voltage of the last time: this time's depends on it.
        before_v = self._terminal_v
        physics = self.physics
        terminal_v = physics.battery_v - physics.battery_ohm * power_w / before_v
        self._terminal_v = terminal_v
        # A bridge keeps its share until the firmware's next command.
        change = terminal_v / before_v
        for motor, _ in motors.amperes:
            voltages[motor] *= change
        self._average_v += (terminal_v - self._average_v) / _LOADS_PER_AVERAGE
        self.battery_mv = int(self._average_v * 1000.0 + 0.5)

    def angle_mdeg(self, port: str) -> int:
        """Angle of a motor's shaft in whole steps of its rotation sensor, clockwise positive."""
        motors = self._motors
        address, mdeg_per_rad = motors.shafts[port]
        step = self._encoder_step_mdeg
        return math.floor(motors.positions[address] * mdeg_per_rad / step + 0.5) * step

    def set_voltage(
        self,
        port: str,
        voltage_mv: int | None,
    ) -> None:
        """Apply a voltage, at most the battery's; 0 shorts the motor (brake), ``None`` opens the
        circuit (coast)."""
        motors = self._motors
        actuator, circuit = motors.terminals[port]
        # A motor whose circuit is open has no torque, not even that of a brake: its actuator is
        # disabled.
        is_open = bool(self._options.disableactuator & circuit)
        if (voltage_mv is None) is not is_open:
            self._options.disableactuator ^= circuit
        if voltage_mv is not None:
            # Comparisons, as `min` and `max` take longer, and each control loop comes here.
            share = voltage_mv / self.battery_mv
            if share > 1.0:
                share = 1.0
            elif share < -1.0:
                share = -1.0
            motors.voltages_v[actuator] = share * self._terminal_v

    # ---------------------------------------------------------------- sensors

    def distance_mm(self, port: str) -> int:
        """Distance to the nearest obstacle or robot that throws one of five rays in a cone of 24
        degrees back, with noise, bias and failures; 40..2000.

        What is hard is a mirror of sound and throws back what meets it nearly at right angles; what
        is soft scatters sound, and is seen late.
        """
        physics = self.physics
        # A sensor that never fails draws nothing for it.
        dropout_share = physics.distance_dropout_share
        if dropout_share and self._noise.random() < dropout_share:
            return _FARTHEST_MM
        nearest_mm = self._nearest_echo_mm(port)
        if nearest_mm >= _FARTHEST_MM:
            return _FARTHEST_MM
        deviation_mm = physics.distance_noise_mm + physics.distance_noise_ratio * nearest_mm
        noise_mm = deviation_mm * self._noise.standard_normal()
        reading_mm = round(nearest_mm + physics.distance_bias_mm + noise_mm)
        return min(max(reading_mm, _NEAREST_MM), _FARTHEST_MM)

    def _nearest_echo_mm(self, port: str) -> float:
        """Distance of an ultrasonic sensor to the nearest surface that it can hear; infinite if
        there is none."""
        sensors = self._sensors
        position_m, rays = sensors.sonars[port]
        origin_m = self._base.in_world(position_m) + self._base.position()
        nearest_mm = math.inf
        geom = np.empty(1, np.int32)
        normal = np.empty(3)
        for ray in rays:
            direction = self._base.in_world(ray)
            distance_m = mujoco.mj_ray(
                self.model,
                self.data,
                origin_m,
                direction,
                sensors.echoing_groups,
                True,
                sensors.silent_body,
                geom,
                normal,
            )
            # MuJoCo answers with -1 where a ray hits nothing.
            if distance_m < 0.0:
                continue
            distance_mm = distance_m * 1000.0
            if geom[0] in sensors.soft_geoms:
                is_heard = distance_mm < self.physics.soft_range_mm
            else:
                is_heard = -(direction @ normal) >= self._least_echo
            if is_heard:
                nearest_mm = min(nearest_mm, distance_mm)
        return nearest_mm

    def sensed(
        self,
        port: str,
        sense: Sense,
    ) -> Sensed:
        """Present stimulus of a sensor, from the world around it; reflected light has noise."""
        if sense is Sense.TILT:
            return self.tilt_deg()
        if sense is Sense.FORCE:
            return float(self._sensors.forces[port][0])
        if sense is Sense.COUNT:
            # Nothing passes a sensor here that counts what passes.
            return 0.0
        sensors = self._sensors
        position_m, axes = sensors.frames[port]
        eye_m = self._base.in_world(position_m) + self._base.position()
        # A column is no contiguous vector, which MuJoCo needs.
        gaze = self._base.in_world(axes[:, 0].copy())
        if sense is Sense.DISTANCE:
            full_mm = INFRARED_MM[sensors.kinds[port]]
            share = sensors.world.distance_mm(eye_m, gaze) / full_mm
            return 100.0 * min(share, 1.0)
        if sense is Sense.AMBIENT:
            return sensors.world.ambient(eye_m, gaze)
        hue, saturation, value = sensors.world.surface(eye_m, gaze)
        noise_pct = self.physics.color_noise_pct * self._noise.standard_normal()
        reading_pct = min(max(value + noise_pct, 0.0), 100.0)
        return hue, saturation, reading_pct

    def tilt_deg(self) -> tuple[float, float]:
        """Pitch (nose down positive) and roll (right side down positive) from the direction of "up"
        in the hub's frame.

        As in the firmware, this is the fused orientation, which accelerations do not disturb, but
        the accelerometer's bias does.
        """
        bias = self._acceleration_bias_mm_s2 / _GRAVITY_MM_S2
        up = self._base.up(self._up) + bias
        up_x, up_y, up_z = up.tolist()
        across = math.hypot(up_y, up_z)
        pitch_deg = math.degrees(math.atan2(-up_x, across))
        roll_deg = math.degrees(math.atan2(up_y, up_z))
        noise_deg = self.physics.tilt_noise_deg * self._noise.standard_normal(2)
        pitch_noise_deg, roll_noise_deg = noise_deg.tolist()
        return pitch_deg + pitch_noise_deg, roll_deg + roll_noise_deg

    def angular_velocity_deg_s(self) -> tuple[float, float, float]:
        """Gyroscope in the frame of the hub, with noise, scale error and drift; counter-clockwise
        about each axis is positive."""
        scale = self._gyro_scale
        noise_deg_s = self.physics.gyro_noise_deg_s
        drift_deg_s = self.physics.gyro_drift_deg_min / 60.0
        rates = self._base.angular_velocity().tolist()
        noise = self._noise.standard_normal(3).tolist()
        # NumPy is slow for three values.
        x, y, z = (
            math.degrees(rate) * scale + (noise_deg_s * deviation - drift_deg_s)
            for rate, deviation in zip(rates, noise, strict=True)
        )
        return x, y, z

    def acceleration_mm_s2(self) -> tuple[float, float, float]:
        """Accelerometer in the frame of the hub, with noise and bias; at rest (0, 0, +9810)."""
        noise = self.physics.acceleration_noise_mm_s2 * self._noise.standard_normal(3)
        error = noise + self._acceleration_bias_mm_s2
        reading = self._base.specific_force() * 1000.0 + error
        x, y, z = reading.tolist()
        return x, y, z

    def heading_deg(self) -> float:
        """Rotation about the vertical since the start, as summed up from the gyroscope, clockwise
        positive, not wrapped."""
        self.update_turns()
        now_s = self.steps * TIMESTEP_S
        noise_deg = self._heading_noise.deg(now_s, self.physics.gyro_noise_deg_s)
        error_deg = noise_deg + self._drift_deg()
        turned_deg = self._turns.heading_deg - self._heading_at_start_deg
        return turned_deg * self._gyro_scale + error_deg

    def rotation_deg(self) -> tuple[float, float, float]:
        """Angular velocity in the frame of the hub, summed up since the start, without noise."""
        self.update_turns()
        true_deg = np.degrees(self._base.in_hub(self._turns.rotation_rad))
        rotation_deg = true_deg * self._gyro_scale - self._drift_deg()
        x, y, z = rotation_deg.tolist()
        return x, y, z

    def _drift_deg(self) -> float:
        """What the gyroscope has drifted since the start, clockwise."""
        return self.physics.gyro_drift_deg_min / 60.0 * self.steps * TIMESTEP_S


SIDE_LOAD_OFFSET_M = (0.0, 0.048, 0.0)
"""Position of the side load relative to the chassis' centre of mass: 6 modules of LEGO to the left,
in the hub's axes."""


def settle(
    model: mujoco.MjModel,
    data: mujoco.MjData,
    robots: Sequence[MujocoBody],
) -> None:
    """Let robots come to rest where they are put, with their motors held: play is taken up, feet
    find the floor."""
    # Addresses of x and y of each robot that can move: settling must not shift it.
    places: list[slice] = []
    shafts: list[int] = []
    for robot in robots:
        start = robot.base_address
        end = start + 2 if robot.moves else start
        places.append(slice(start, end))
        shafts += robot.shaft_dofs
    starts_m = [data.qpos[place].copy() for place in places]

    # A person who puts a robot down does not turn its motors.
    armature = model.dof_armature.copy()
    model.dof_armature[shafts] = _HELD_KG_M2
    for _ in range(_SETTLING_STEPS // _STEPS_PER_UPDATE):
        mujoco.mj_step(model, data, _STEPS_PER_UPDATE)
        if np.abs(data.qvel).max() < _AT_REST:
            break
    model.dof_armature[:] = armature

    for place, start_m in zip(places, starts_m, strict=True):
        data.qpos[place] = start_m
    # What the solver remembers of before would make an episode depend on the last one.
    data.qvel[:] = 0.0
    data.qacc_warmstart[:] = 0.0
    mujoco.mj_forward(model, data)


def come_to_rest(
    model: mujoco.MjModel,
    data: mujoco.MjData,
    robots: Sequence[MujocoBody],
    scene: Scene | None = None,
) -> None:
    """Let robots that were put somewhere come to rest. Raises TwinError if one is inside of an
    obstacle of the ``scene``, or of an arena."""
    data.qacc_warmstart[:] = 0.0
    mujoco.mj_forward(model, data)
    refuse_overlap(model, data, scene)
    settle(model, data, robots)
    for robot in robots:
        robot.update_turns()


def _backlash_joints(model: mujoco.MjModel) -> list[int]:
    """Joints between a motor's shaft and what it drives."""
    return [joint for joint in range(model.njnt) if "backlash_" in model.joint(joint).name]


def set_physics(
    model: mujoco.MjModel,
    nominal: mujoco.MjModel,
    physics: Physics,
    robots: Sequence[MujocoBody],
    bodies: Sequence[int],
) -> None:
    """Set a model's parameters. Raises TwinError if there is a side load, and a robot without a
    chassis that moves.

    Args:
        nominal: the same model as compiled.
        bodies: bodies whose masses are scaled.
    """
    # Always from the nominal values: a second call must not multiply what the first one did. A
    # slope is a floor that stays level under a gravity that is aslant.
    downwards = nominal.opt.gravity[2]
    model.opt.gravity[:] = downwards * _up(physics)
    model.geom_friction[:] = nominal.geom_friction * physics.friction_scale
    model.pair_friction[:] = nominal.pair_friction * physics.friction_scale
    model.body_mass[bodies] = nominal.body_mass[bodies] * physics.mass_scale
    model.body_inertia[bodies] = nominal.body_inertia[bodies] * physics.mass_scale
    play = math.radians(physics.backlash_deg)
    model.jnt_range[_backlash_joints(model)] = (-play, play)
    for robot in robots:
        # Half of the difference for each wheel, so that their mean stays; robots without wheels
        # have no tyres.
        for tyre, share in zip(robot.tyres, (0.5, -0.5), strict=False):
            size = 1.0 + share * physics.wheel_difference_pct / 100.0
            model.geom_size[tyre] = nominal.geom_size[tyre] * size
            model.geom_rbound[tyre] = nominal.geom_rbound[tyre] * size
            model.geom_aabb[tyre] = nominal.geom_aabb[tyre] * size
        for motor, scale in zip(robot.robot.motors, physics.motor_scales, strict=False):
            actuator = robot.actuator(motor.port)
            joint = model.actuator_trnid[actuator, 0]
            dof = model.jnt_dofadr[joint]
            # The joint has the friction of a gear train too, which is not the motor's.
            gear = abs(nominal.actuator_gear[actuator, 0])
            friction_nm = motor_constants(motor.kind).friction_nm * gear
            added_nm = (physics.motor_friction_scale - 1.0) * friction_nm
            model.dof_frictionloss[dof] = nominal.dof_frictionloss[dof] + added_nm
            # A faster motor has less back-EMF per speed, and the same torque at a standstill.
            drag = nominal.actuator_biasprm[actuator, 2]
            model.actuator_biasprm[actuator, 2] = drag / scale
        if robot.moves:
            _add_side_load(
                model,
                nominal,
                robot.chassis,
                physics.side_load_g / 1000,
            )
        elif physics.side_load_g:
            raise TwinError(
                "physics: side_load_g is for robots that move; leave it at 0 for one that stands "
                "on a fixed base"
            )
    # MuJoCo derives constants of the model from the masses, in data that nobody uses.
    mujoco.mj_setConst(model, mujoco.MjData(model))


def _up(physics: Physics) -> np.ndarray[tuple[int], np.dtype[np.float64]]:
    """Upward direction [3] in the axes of the floor, which rises along x."""
    slope = math.radians(physics.slope_deg)
    return np.array([math.sin(slope), 0.0, math.cos(slope)])


def _add_side_load(
    model: mujoco.MjModel,
    nominal: mujoco.MjModel,
    body: int,
    load_kg: float,
) -> None:
    """Add a point mass at the side of a chassis: mass, centre of mass and inertia change (parallel
    axis theorem)."""
    model.body_ipos[body] = nominal.body_ipos[body]
    model.body_iquat[body] = nominal.body_iquat[body]
    if load_kg == 0.0:
        return
    mass_kg = float(model.body_mass[body])
    offset_m = np.array(SIDE_LOAD_OFFSET_M)
    frame = np.empty(9)
    mujoco.mju_quat2Mat(frame, nominal.body_iquat[body])
    axes = frame.reshape(3, 3)
    # Steiner's theorem for two masses: about their common centre, they count as one mass (the
    # reduced one) at their distance.
    reduced_kg = mass_kg * load_kg / (mass_kg + load_kg)
    principal = np.diag(model.body_inertia[body])
    inertia = axes @ principal @ axes.T  # in the body's axes
    square = offset_m @ offset_m
    spread = square * np.eye(3) - np.outer(offset_m, offset_m)
    inertia += reduced_kg * spread
    # MuJoCo wants principal moments, and a rotation to their axes.
    moments, columns = np.linalg.eigh(inertia)
    columns[:, 0] *= np.linalg.det(columns)  # a rotation, not a mirror image
    mujoco.mju_mat2Quat(model.body_iquat[body], columns.ravel())
    model.body_inertia[body] = moments
    shift_m = offset_m * load_kg / (mass_kg + load_kg)
    model.body_ipos[body] = nominal.body_ipos[body] + shift_m
    model.body_mass[body] = mass_kg + load_kg
