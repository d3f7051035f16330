"""Preflight check of a robot with a hub: ports, battery, latency, sensors, motors against the
description."""

import functools
import re
import sys
from collections.abc import Callable, Iterator, Sequence
from dataclasses import dataclass

from brickhub.errors import HubError, an, percent
from brickhub.finding import Finding, Outcome
from brickhub.hub.diagnostics.survey import Survey, WheelTurn, survey, turn_wheels
from brickhub.hub.interface import Command, Distance, Interface
from brickhub.hub.link.lockstep import HubLink
from brickhub.hub.link.robot_link import RobotLink
from brickhub.hub.link.timing import percentile
from brickhub.hub.transport import Transport
from brickhub.hub.transports.connection import HubIdentity
from brickhub.hub.transports.profile import NEWEST_PROFILE
from brickhub.robot import AnyHub, Motor, MotorKind, Robot, SensorKind

SLOW_INTERVAL_MS = 20.0
"""Connection interval above which a shorter one is possible."""
_INTERVAL_UNIT_MS = 1.25
"""Bluetooth's intervals are multiples of it."""
_INTERVALS_PER_ROUND_TRIP = 2
"""A command waits for the next connection event, and its answer for the one after that."""

_ADVICE = {
    "linux": (
        "as root, write 6 into /sys/kernel/debug/bluetooth/hci0/conn_min_interval and 12 into "
        "conn_max_interval beside it, or "
        "MinConnectionInterval=6 and MaxConnectionInterval=12 below [LE] in "
        "/etc/bluetooth/main.conf, and connect again"
    ),
    "darwin": (
        "macOS chooses the interval itself, usually 15 ms: disconnect other Bluetooth "
        "devices and bring the hub near"
    ),
    "win32": (
        "Windows 11 gives 15 ms or less to a program that asks for it, which Python cannot yet: "
        "disconnect other Bluetooth "
        "devices, bring the hub near, or use a computer with Linux or macOS"
    ),
}
TEST_MOVE = 30.0
"""Degrees or millimetres of a test move."""
_LEAST_SHARE = 0.5
"""Share of a test move that a motor has to complete."""
_RANGE_MARGIN_DEG = 8.0
"""Tolerance for a joint that yields beyond its range."""
_TEST_MOVE_S = 1.2
"""Time for a test move; a step may end before it."""

_ENCODERS = {kind.model.device_id for kind in MotorKind if kind.model.has_encoder}
"""Device ids of motors with an encoder: a program for one also drives the others."""


def _device_names() -> dict[int, str]:
    names: dict[int, str] = {}
    for motor_kind in MotorKind:
        # Of kinds that no hub can tell apart, the first one gives the name.
        names.setdefault(motor_kind.model.device_id, f"motor {motor_kind.value}")
    for kind in SensorKind:
        # People read "color distance sensor" and not "ColorDistanceSensor".
        words = re.sub("(?<!^)([A-Z])", r" \1", kind.value)
        names[kind.model.device_id] = words.lower()
    names[0] = "nothing"
    return names


_NAMES = _device_names()
"""Readable names of devices, by their ids."""


@dataclass(frozen=True)
class Latency:
    """Measured latency of a link.

    Attributes:
        exchanges: number of consecutive sensor readings.
        p50_ms, p99_ms: percentiles of their round trips.
        interval_ms: connection interval inferred from the median.
        link_share: link's share of a step of the environment; ``None`` if a step has no fixed time.
    """

    exchanges: int
    p50_ms: float
    p99_ms: float
    interval_ms: float
    link_share: float | None

    @property
    def is_slow(self) -> bool:
        """True if a shorter interval is possible."""
        return self.interval_ms > SLOW_INTERVAL_MS


def measure(
    link: RobotLink,
    interface: Interface,
    exchanges: int = 100,
) -> Latency:
    """Time ``exchanges`` sensor readings over an open link; nothing moves. Raises HubError if the
    link failed."""
    # The first reading follows a pause and is slower, so it does not count.
    link.read()
    round_trips_s = [link.read().round_trip_s for _ in range(exchanges)]
    return latency(round_trips_s, interface)


def latency(round_trips_s: list[float], interface: Interface) -> Latency:
    """Latency statistics of the round trips ``[n]`` of readings, n > 0."""
    p50_ms = percentile(round_trips_s, 50) * 1000
    p99_ms = percentile(round_trips_s, 99) * 1000
    # The median ignores single exchanges that the computer delays, or that are lost and repeated.
    interval_units = round(p50_ms / _INTERVALS_PER_ROUND_TRIP / _INTERVAL_UNIT_MS)
    step_ms = interface.settle.fixed_ms
    return Latency(
        exchanges=len(round_trips_s),
        p50_ms=p50_ms,
        p99_ms=p99_ms,
        interval_ms=interval_units * _INTERVAL_UNIT_MS,
        link_share=None if step_ms is None else p50_ms / (step_ms + p50_ms),
    )


def advice(platform: str = sys.platform) -> str:
    """Advice for a shorter connection interval on this operating system."""
    return _ADVICE.get(
        platform, "look for the connection interval in the settings of this system's Bluetooth"
    )


def check_robot(
    transport: Transport,
    robot: Robot,
    interface: Interface,
    *,
    may_move: Callable[[], bool],
    is_right: Callable[[str], bool | None] | None = None,
    calibrate: Callable[[Robot], Robot] | None = None,
    command: str = "brickhub calibrate ROBOT",
) -> Iterator[Finding]:
    """Check everything that a task needs of a robot. Opens the transport, and closes it at the end.
    Raises HubError if the hub cannot be reached.

    Args:
        transport: transport to the hub.
        robot, interface: expected robot and interface.
        may_move: asked before the first test move.
        is_right: asked after each test move, e.g. "left turned by 30 degrees"; it answers ``None``
            where nobody says anything. ``None`` if nobody watches.
        calibrate: as for :class:`HubLink`.
        command: the command that calibrates this robot on this hub, for advice that works as it is
            printed.
    """
    # A person is asked only once, for all moves.
    may_move = functools.cache(may_move)
    try:
        transport.open()
        # The calibration belongs to the hub, which is known only from here on.
        calibrated = robot if calibrate is None else calibrate(robot)
        identity = getattr(transport, "identity", None)
        yield from check_hub(identity, robot)
        result = survey(transport, calibrated)
        port_findings = list(check_ports(robot, result))
        yield from port_findings
        yield check_battery(robot.hub, result.battery_mv)
        yield from check_imu(robot, result)
        if any(finding.outcome is Outcome.ERROR for finding in port_findings):
            yield Finding(
                "program",
                Outcome.SKIPPED,
                "the environment's program does not start before all is plugged in",
            )
            return
        # A failure from here on becomes one more finding, because the findings before it are
        # already printed.
        try:
            with HubLink(
                transport,
                robot,
                interface,
                calibrate=calibrate,
            ) as link:
                yield Finding("program", Outcome.OK, f"runs (hash {link.program.hash:08x})")
                values = link.read().values
                yield from check_angles(robot, interface, values)
                yield from check_distances(interface, values)
                is_virtual = getattr(transport, "identity", None) is None
                yield check_latency(
                    measure(link, interface),
                    is_virtual=is_virtual,
                    has_radio=robot.hub.model.has_bluetooth,
                )

                def advise(motors: Sequence[str]) -> str:
                    return _reversing(
                        command,
                        robot,
                        calibrated,
                        motors,
                    )

                yield from check_moves(
                    link,
                    robot,
                    interface,
                    may_move,
                    is_right,
                    advise,
                )
            # This comes after the link is closed, because a hub runs one program at a time.
            has_wheels = calibrated.drive_base is not None
            if has_wheels and robot.hub.model.has_imu and may_move():
                turns = turn_wheels(transport, calibrated)
                yield from check_wheels(robot, turns, advise)
        except HubError as error:
            yield Finding("program", Outcome.ERROR, str(error))
    finally:
        transport.close()


def judged(
    name: str,
    detail: str,
    *problems: tuple[bool, Outcome, str],
) -> Finding:
    """Finding of a check: the first problem that there is, with its outcome and what it adds to the
    detail; else OK."""
    for is_there, outcome, remedy in problems:
        if is_there:
            return Finding(name, outcome, detail + remedy)
    return Finding(name, Outcome.OK, detail)


def check_hub(identity: HubIdentity | None, robot: Robot) -> Iterator[Finding]:
    """Kind and versions of a connected hub; empty for one without an identity, such as the virtual
    hub."""
    if identity is None:
        return
    kind = identity.kind
    firmware = identity.firmware
    version = ".".join(map(str, identity.profile_version))
    if kind is not robot.hub:
        detail = (
            f"it is {an(kind.value)} hub, '{robot.name}' has {an(robot.hub.value)} hub; take "
            "that one, or describe your robot"
        )
        yield Finding("hub", Outcome.ERROR, detail)
    else:
        yield Finding("hub", Outcome.OK, f"'{identity.name}', {kind.value}, {identity.address}")
    is_old = firmware.partition(".")[0] in ("2", "3")
    is_newer = identity.profile_version > NEWEST_PROFILE
    yield judged(
        "firmware",
        f"Pybricks {firmware}, profile {version}",
        (
            is_old,
            Outcome.WARNING,
            "; BricksRL was written for version 4, update it on code.pybricks.com",
        ),
        (
            is_newer,
            Outcome.WARNING,
            ", which is newer than this brickhub; update it if something fails",
        ),
    )


def device_name(number: int) -> str:
    """Readable name of a device id."""
    return _NAMES.get(number, f"device {number}")


def check_ports(robot: Robot, result: Survey) -> Iterator[Finding]:
    """Port check: expected against connected device."""
    expected = {device.port: device for device in (*robot.motors, *robot.sensors)}
    for port in robot.hub.model.ports:
        found_id = result.ports.get(port, 0)
        device = expected.get(port)
        found_name = device_name(found_id)
        name = f"port {port}"
        if device is None:
            detail = "nothing is expected"
            if found_id:
                detail += f", {found_name} is there, which does no harm"
            yield Finding(name, Outcome.OK, detail)
            continue
        expected_id = device.kind.model.device_id
        label = f"'{device.name}', {device_name(expected_id)}"
        if found_id == expected_id:
            yield Finding(name, Outcome.OK, label)
        elif {expected_id, found_id} <= _ENCODERS:
            detail = (
                f"{label} is expected, {found_name} is there; it works, but the virtual "
                "robot has the other one's strength"
            )
            yield Finding(name, Outcome.WARNING, detail)
        else:
            # A sensor that is plugged in where another one of its kind belongs is not the one that
            # is missing.
            its_ports = {
                device.port
                for device in expected.values()
                if device.kind.model.device_id == expected_id
            }
            wrong_ports = [
                other_port
                for other_port, other_id in result.ports.items()
                if other_id == expected_id and other_port not in its_ports
            ]
            remedy = f"plug it into port {port} until it clicks"
            if wrong_ports:
                remedy = f"move it from port {wrong_ports[0]} to {port}"
            detail = f"{label} is expected, {found_name} is there; {remedy}"
            yield Finding(name, Outcome.ERROR, detail)


def check_battery(hub: AnyHub, battery_mv: int) -> Finding:
    """Battery check: enough voltage for the motors."""
    # By the firmware's limits (battery.c), a hub warns below the first voltage, and soon switches
    # off below the second.
    cells = (5400, 4800, "put fresh batteries in")
    lithium = (6800, 6000, "charge it")
    low_mv, critical_mv, remedy = lithium if hub.model.is_rechargeable else cells
    return judged(
        "battery",
        f"{battery_mv / 1000:.2f} V",
        (battery_mv < critical_mv, Outcome.ERROR, f", it is empty; {remedy}"),
        (battery_mv < low_mv, Outcome.WARNING, f", it is low and the motors are weak; {remedy}"),
    )


def check_imu(robot: Robot, result: Survey) -> Iterator[Finding]:
    """IMU check, for robots that need it: gyroscope and accelerometer are ready."""
    if not robot.needs_imu:
        return
    tilt = f"pitch {result.pitch_deg}, roll {result.roll_deg} deg"
    if result.imu_ready is None:
        no_answer = (
            "the hub did not say anything about its IMU; update its firmware on code.pybricks.com"
        )
        yield Finding("imu", Outcome.ERROR, no_answer)
    elif not result.imu_ready:
        yield Finding(
            "imu",
            Outcome.WARNING,
            f"{tilt}, not ready; leave the robot still for some seconds and check again",
        )
    else:
        motion = "" if result.imu_still else ", moving"
        yield Finding("imu", Outcome.OK, f"ready, {tilt}{motion}")


def check_angles(
    robot: Robot,
    interface: Interface,
    values: Sequence[float],
) -> Iterator[Finding]:
    """Angle check: joints are within their ranges in the reading ``values [n_channels]``."""
    for name, index in interface.angle_indices.items():
        range_deg = robot.motor(name).range_deg
        if range_deg is None:
            continue
        low, high = range_deg
        angle_deg = values[index]
        is_within = low - _RANGE_MARGIN_DEG <= angle_deg <= high + _RANGE_MARGIN_DEG
        is_beyond = not is_within
        remedy = "; put the joint within its range, or find its zero with `brickhub calibrate`"
        detail = f"{angle_deg:.0f} deg, range {low} to {high}"
        yield judged(f"angle {name}", detail, (is_beyond, Outcome.ERROR, remedy))


def check_distances(interface: Interface, values: Sequence[float]) -> Iterator[Finding]:
    """Check the distances in the reading ``values [n_channels]``. A sensor that sees nothing may be
    dead."""
    for channel, value in zip(interface.channels, values, strict=True):
        if isinstance(channel, Distance):
            doubt = ""
            if value >= channel.FARTHEST_MM:
                doubt = (
                    ", nothing in sight; hold a hand before it and check again: the number has "
                    "to change"
                )
            yield Finding(f"reading {channel.name}", Outcome.OK, f"{value:.0f} mm{doubt}")


def check_latency(
    latency: Latency,
    *,
    is_virtual: bool = False,
    has_radio: bool = True,
) -> Finding:
    """Latency check: the connection interval is short. That of a virtual hub is as its link says,
    which is no problem, and a cable has none."""
    share = "" if latency.link_share is None else f", {percent(latency.link_share)} of a step"
    interval = f", connection interval {latency.interval_ms:g} ms" if has_radio else ""
    detail = f"{latency.p50_ms:.0f} ms, p99 {latency.p99_ms:.0f} ms{interval}{share}"
    if not has_radio:
        return Finding("round trip", Outcome.OK, detail)
    if is_virtual:
        played = f"{detail}, as played; another link is played with --link, such as --link mac"
        return Finding("round trip", Outcome.OK, played if latency.is_slow else detail)
    return judged("round trip", detail, (latency.is_slow, Outcome.WARNING, f"; {advice()}"))


def small_move(
    command: Command,
    range_deg: tuple[int, int] | None,
    angle_deg: float | None,
) -> float:
    """A small value of a command; for a joint with a known angle, towards the middle of its
    range."""
    sign = 1.0
    # A move towards a stop would be blocked, so the other direction is taken past the middle.
    if range_deg is not None and angle_deg is not None and angle_deg > sum(range_deg) / 2:
        sign = -1.0
    preferred = min(max(sign * TEST_MOVE, command.low), command.high)
    opposite = min(max(-sign * TEST_MOVE, command.low), command.high)
    # A command may allow one sign only, and then the other direction is the only one.
    return preferred if abs(preferred) >= abs(opposite) else opposite


def check_moves(
    link: RobotLink,
    robot: Robot,
    interface: Interface,
    may_move: Callable[[], bool],
    is_right: Callable[[str], bool | None] | None,
    advise: Callable[[Sequence[str]], str] | None = None,
) -> Iterator[Finding]:
    """Check of each command by a small move, if a person allows it. ``advise``: what to do about
    motors that turn wrongly."""
    if not may_move():
        yield Finding("directions", Outcome.SKIPPED, "nothing was moved, because nobody said yes")
        return
    for index in range(len(interface.commands)):
        yield _check_move(
            link,
            robot,
            interface,
            index,
            is_right,
            advise,
        )


def _check_move(
    link: RobotLink,
    robot: Robot,
    interface: Interface,
    index: int,
    is_right: Callable[[str], bool | None] | None,
    advise: Callable[[Sequence[str]], str] | None,
) -> Finding:
    """Send a small value for one command and 0 for the others, and compare the motion of its
    motors."""
    command = interface.commands[index]
    actions = [0.0] * len(interface.commands)
    before = link.read().values
    motors = [robot.motor(name) for name in command.motors(robot)]
    # Nothing here can tell whether there was a light or a sound.
    if not motors:
        actions[index] = command.high
        link.act(actions)
        return Finding(command.name, Outcome.OK, f"{command.high:g} {command.unit}, look or listen")
    angles_before = [_angle(interface, before, motor) for motor in motors]
    value = small_move(command, motors[0].range_deg, angles_before[0])
    name = f"motor {command.name}" if len(motors) == 1 else command.name
    actions[index] = value
    link.act(actions)
    after = before
    end_s = link.now_s() + _TEST_MOVE_S
    # A step may end before its move does. Reading meanwhile keeps the program alive.
    while link.now_s() < end_s:
        after = link.read().values
    if not command.ends:
        link.act([0.0] * len(interface.commands))
    # Sensors are asked first, then the person who watched.
    turns_deg = command.turns_deg(robot, value)
    for motor, angle_before, turn_deg in zip(
        motors,
        angles_before,
        turns_deg,
        strict=True,
    ):
        angle_after = _angle(interface, after, motor)
        if angle_before is None or angle_after is None:
            continue
        turned = (angle_after - angle_before + 180.0) % 360.0 - 180.0
        # A wrapped angle does not tell whole turns, so those are added that bring it nearest to the
        # command.
        if command.ends:
            turned += 360.0 * round((turn_deg - turned) / 360.0)
        # Multiplying both sides by the expected turn makes the sign count; where no turn is
        # expected, any is right.
        if turned * turn_deg < _LEAST_SHARE * turn_deg**2:
            what = (
                f"'{motor.name}' (port {motor.port}) turned by {turned:.0f} deg after "
                f"{value:g} {command.unit}"
            )
            return Finding(name, Outcome.ERROR, f"{what}; it is blocked, or its cable is loose")
    motion = f"moved by {value:g} {command.unit}"
    answer = None if is_right is None else is_right(f"{name} {motion}")
    if answer is None:
        return Finding(name, Outcome.OK, f"{motion}, nobody watched")
    if answer:
        return Finding(name, Outcome.OK, motion)
    # A person who says no has seen a cable in a wrong port, or a wrong direction.
    ports = " and ".join(motor.port for motor in motors)
    which = f"if it was another motor, swap the cables (port {ports})"
    if advise is not None and len(motors) == 1:
        which += f"; if it was the wrong way, {advise([motors[0].name])}"
    elif advise is not None:
        each = ", ".join(f"'{motor.name}': {advise([motor.name])}" for motor in motors)
        which += f"; for each motor, and only one, that turned the wrong way: {each}"
    return Finding(
        name,
        Outcome.ERROR,
        f"{motion}, and you say that it was another motor or the wrong way; {which}",
    )


_TURNED_SHARE = 0.8
"""Share of the expected turn of the hub below which a wheel slips."""
_STILL_SHARE = 0.15
"""Share below which it did not turn at all, which is slip too if the other wheel turned it."""


def check_wheels(
    robot: Robot,
    turns: Sequence[WheelTurn],
    advise: Callable[[Sequence[str]], str],
) -> Iterator[Finding]:
    """Check of each wheel of a drive base by the gyroscope: forward, the left one turns the robot
    clockwise, the right one counterclockwise, by the distance that it rolls over the axle track."""
    base = robot.drive_base
    if base is None:
        return
    # These are the wheels that turned, each with the turn of the hub (deg, clockwise) that should
    # follow.
    rolled: list[tuple[WheelTurn, float]] = []
    for turn in turns:
        # The other wheel stands still, so the robot turns about it, on a circle with the axle track
        # as its radius.
        sign = 1.0 if turn.motor == base.left else -1.0
        expected_deg = sign * turn.wheel_deg * base.wheel_diameter_mm / (2 * base.axle_track_mm)
        # A wheel that hardly turned has a finding of its own.
        if abs(expected_deg) >= 1.0:
            rolled.append((turn, expected_deg))
    is_on_floor = any(abs(turn.heading_deg / deg) >= _STILL_SHARE for turn, deg in rolled)
    for turn, expected_deg in rolled:
        share = turn.heading_deg / expected_deg
        name = f"wheel {turn.motor}"
        motion = f"turned the robot by {turn.heading_deg:.0f} of {expected_deg:.0f} deg"
        if abs(share) < _STILL_SHARE and not is_on_floor:
            stayed = (
                "the robot stayed as it was, by its gyroscope: on the bench, or its wheels "
                "in the air"
            )
            yield Finding(name, Outcome.SKIPPED, stayed)
        elif share <= -_STILL_SHARE:
            port = robot.motor(turn.motor).port
            remedy = f"it turns the wrong way (port {port}): {advise([turn.motor])}"
            yield Finding(name, Outcome.ERROR, f"{motion}, by its gyroscope; {remedy}")
        elif share < _TURNED_SHARE:
            slips = (
                "it slips, or is not as large as described; clean the tyre, look whether it "
                "sits tight on its axle"
            )
            yield Finding(name, Outcome.WARNING, f"{motion}, by its gyroscope; {slips}")
        else:
            yield Finding(name, Outcome.OK, f"{motion}, by its gyroscope")


def _reversing(
    command: str,
    robot: Robot,
    calibrated: Robot,
    names: Sequence[str],
) -> str:
    """Advice for motors that turn the wrong way, in words that can be followed as they are."""
    # A motor that is reversed by its calibration and turns wrongly would be right as described, so
    # the advice is another one.
    reversed_already = []
    as_described = []
    for name in names:
        described = robot.motor(name).direction
        if described is calibrated.motor(name).direction:
            as_described.append(name)
        else:
            reversed_already.append(name)
    steps = []
    if as_described:
        steps.append(f"`{command} --reverse {' '.join(as_described)}`")
    if reversed_already:
        steps.append(f"`{command} --as-described {' '.join(reversed_already)}`")
    return " and ".join(steps)


def _angle(
    interface: Interface,
    values: Sequence[float],
    motor: Motor,
) -> float | None:
    """Angle of a motor, if it is observed."""
    index = interface.angle_indices.get(motor.name)
    return None if index is None else values[index]
