"""Measuring session: a person handles a robot while programs on its hub report what link, sensors
and motors do; and its log.

A log has one JSON object per line: a header with the robot, then the hub's answers.
"""

from collections.abc import Sequence
from dataclasses import asdict, dataclass
from pathlib import Path
from typing import Any, ClassVar

from brickhub.errors import DescriptionError, TwinError
from brickhub.hub.interface import (
    Channel,
    Distance,
    Heading,
    Interface,
    MotorAngle,
    Pitch,
    Roll,
    RunDuty,
    Wait,
    YawRate,
)
from brickhub.hub.link.lockstep import HubLink
from brickhub.hub.transport import Transport
from brickhub.robot import Robot
from bricktwin.measure.hands import Deed, Person
from bricktwin.twin.motion_log import read_lines, write_lines

TURNED_DEG = 1260.0
"""Turn by hand: three turns show the gyroscope's scale, half a turn tells the tilt of the sensor
from that of the table."""
WALL_MM = 300.0
WALL_DEG = 30.0
_REST_S = 60.0
_TURNED_S = 8.0
_LIFTED_S = 2.0
_WALL_S = 6.0
_FREE_S = 1.2
_HELD_S = 0.6
_STEP = Wait(50)
_FORMAT = 1

REST = Deed(
    "Put the robot on a level table, its left side along a straight edge, such as a heavy box, "
    "and let go of it."
)
TURN = Deed(
    "Turn it on the table clockwise, seen from above, by three and a half turns, until its right "
    "side lies along the edge.",
    turn_deg=TURNED_DEG,
)
LIFT = Deed(
    "Take it into your hand, so that nothing touches its wheels or legs; they will run at "
    "full speed.",
    is_lifted=True,
)
LET_GO = Deed("Let go of it, and keep the robot in your hand.", is_lifted=True)
WALL = Deed(
    f"Put it before a bare, hard wall, its ultrasonic sensor {WALL_MM:g} mm from it, straight.",
    wall_mm=WALL_MM,
)
ASLANT = Deed(
    f"Turn it by {WALL_DEG:g} degrees to the left; the sensor stays {WALL_MM:g} mm from the wall.",
    wall_mm=WALL_MM,
    wall_deg=-WALL_DEG,
)


def held(motor: str) -> Deed:
    """A deed: holding what a motor turns."""
    return Deed(f"Hold fast what motor '{motor}' turns.", is_lifted=True, holds=motor)


@dataclass(frozen=True)
class _Half(Heading):
    """``hub.imu.heading()``, wrapped, which leaves more digits on the wire."""

    scale: ClassVar[int] = 100
    expression: ClassVar[str] = "((hub.imu.heading() + 180) % 360 - 180)"
    is_nominal: ClassVar[bool] = False
    accumulates: ClassVar[bool] = False


@dataclass(frozen=True)
class _Rate(YawRate):
    scale: ClassVar[int] = 100


@dataclass(frozen=True)
class _Volts(Channel):
    low: ClassVar[float] = 0.0
    high: ClassVar[float] = 12.0
    scale: ClassVar[int] = 1000
    unit: ClassVar[str] = "V"
    name: ClassVar[str] = "battery_v"
    expression: ClassVar[str] = "(hub.battery.voltage() / 1000)"

    def check(self, robot: Robot) -> None:
        """Do nothing, because each hub has a battery."""


@dataclass(frozen=True)
class Row:
    """One answer of the hub.

    Attributes:
        phase: what was going on: ``"rest"``, ``"turned"``, ``"lifted"``, ``"wall"``, ``"aslant"``,
            ``"hands"``, and for each motor ``"free NAME"``, ``"back NAME"`` and ``"held NAME"``.
        time_ms: clock of the hub's program.
        delay_ms: of the exchange, without the duration of its command.
        values: of the channels, by name.
    """

    phase: str
    time_ms: int
    delay_ms: float
    values: dict[str, float]


@dataclass(frozen=True)
class SessionLog:
    """Name of a robot, what else is known of it, and the answers of its hub."""

    robot: str
    about: dict[str, str]
    rows: tuple[Row, ...]


class _Session:
    def __init__(
        self,
        transport: Transport,
        robot: Robot,
        person: Person,
    ) -> None:
        self._transport = transport
        self._robot = robot
        self._person = person
        self.rows: list[Row] = []

    def link(
        self,
        channels: Sequence[Channel],
        motors: Sequence[str] = (),
    ) -> HubLink:
        """A link to a program with these channels, and the duties of these motors as commands."""
        self._channels = [channel.name for channel in channels]
        self._motors = motors
        commands = tuple(RunDuty(name) for name in motors)
        interface = Interface(commands, tuple(channels), _STEP)
        self._link = HubLink(self._transport, self._robot, interface)
        return self._link

    def ask(self, deed: Deed) -> None:
        """Ask for a deed, and read the robot until it is done: by these answers whole turns of the
        heading are counted."""
        self._person.begin(deed)
        while not self._person.is_done():
            self._add("hands")

    def watch(
        self,
        phase: str,
        duration_s: float,
        motor: str = "",
        duty_pct: float = 0.0,
    ) -> None:
        """Read the robot for a time, with one motor on if it is named."""
        command = None
        if motor:
            command = [duty_pct * (name == motor) for name in self._motors]
        end_s = self._link.now_s() + duration_s
        while self._link.now_s() < end_s:
            self._add(phase, command)
        if motor:
            self._link.act([0.0] * len(self._motors))

    def _add(
        self,
        phase: str,
        command: Sequence[float] | None = None,
    ) -> None:
        """Read the robot once, or after a command."""
        if command is None:
            answer = self._link.read()
            command_ms = 0
        else:
            answer = self._link.act(command)
            # The hub answers only when the command has ended.
            command_ms = _STEP.time_ms
        delay_ms = answer.round_trip_s * 1000 - command_ms
        self.rows.append(
            Row(
                phase=phase,
                time_ms=answer.hub_time_ms,
                delay_ms=round(delay_ms, 3),
                values=dict(zip(self._channels, answer.values, strict=True)),
            )
        )


def measure(
    transport: Transport,
    robot: Robot,
    person: Person,
    about: dict[str, str],
) -> SessionLog:
    """Measure a robot in about two minutes. Raises HubError if the link failed, TwinError if there
    is nothing to measure.

    Args:
        transport: unopened transport to its hub.
        person: who handles the robot.
        about: what else is to be known of robot and computer, for the log.
    """
    session = _Session(transport, robot, person)
    # The motors without a range may turn on and on. Of several ultrasonic sensors the first one is
    # measured.
    motors = [motor.name for motor in robot.motors if motor.range_deg is None]
    eyes = [sensor.name for sensor in robot.sensors if sensor.kind.model.range_mm is not None]
    if robot.needs_imu:
        with session.link((_Half(), Pitch(), Roll(), _Rate())):
            session.ask(REST)
            session.watch("rest", _REST_S)
            session.ask(TURN)
            session.watch("turned", _TURNED_S)
    for name in eyes[:1]:
        with session.link((Distance(name),)):
            session.ask(WALL)
            session.watch("wall", _WALL_S)
            session.ask(ASLANT)
            session.watch("aslant", _WALL_S)
    # The motors come last, because legs stand differently afterwards.
    if motors:
        angles = [MotorAngle(name, -180.0, 180.0) for name in motors]
        with session.link((*angles, _Volts()), motors):
            session.ask(LIFT)
            session.watch("lifted", _LIFTED_S)
            for name in motors:
                session.watch(
                    f"free {name}",
                    _FREE_S,
                    name,
                    100.0,
                )
                session.watch(
                    f"back {name}",
                    _FREE_S,
                    name,
                    -100.0,
                )
                session.ask(held(name))
                session.watch(
                    f"held {name}",
                    _HELD_S,
                    name,
                    100.0,
                )
                session.ask(LET_GO)
    if not session.rows:
        raise TwinError(
            f"'{robot.name}' has no IMU, endless motor or ultrasonic sensor to measure; see "
            "`brickhub latency` for its link"
        )
    return SessionLog(robot.name, about, tuple(session.rows))


def write_log(path: Path, log: SessionLog) -> None:
    """Write a log to a file, replacing an existing one; its folder is created. Raises WriteError if
    that is impossible."""
    header = {"bricktwin_measure": _FORMAT, "robot": log.robot, "about": log.about}
    write_lines(path, [header, *map(asdict, log.rows)])


def read_log(path: Path) -> SessionLog:
    """Read a log. Raises TwinError if the file cannot be read, or is none."""
    return read_lines(path, _log, "bricktwin twin measure")


def _log(header: dict[str, Any], lines: list[dict[str, Any]]) -> SessionLog:
    """The log of a file; a file of another kind raises what its content causes."""
    if header["bricktwin_measure"] != _FORMAT:
        raise DescriptionError(f"format {header['bricktwin_measure']!s:.40} is unknown")
    rows = []
    for row in lines:
        values = {name: float(value) for name, value in row["values"].items()}
        rows.append(
            Row(
                phase=str(row["phase"]),
                time_ms=int(row["time_ms"]),
                delay_ms=float(row["delay_ms"]),
                values=values,
            )
        )
    about = {str(name): str(value) for name, value in header["about"].items()}
    return SessionLog(str(header["robot"]), about, tuple(rows))
