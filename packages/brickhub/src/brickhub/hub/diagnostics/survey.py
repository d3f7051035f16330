"""Survey of a hub: programs generated from the robot's description that report the connected
devices, for any transport.

Each runs once and prints what it found; it begins with a HELLO frame with its hash, by which a
transport identifies it.
"""

import ast
import hashlib
import io
from dataclasses import dataclass

from brickhub.errors import DescriptionError, HubError, HubProgramError, HubTimeoutError
from brickhub.hub.program.generate import hub_line, onboard_text, sorted_imports
from brickhub.hub.program.run_program import TIME_LIMIT_EXIT_CODE, describe_traceback, run_program
from brickhub.hub.protocol import Up, control_frame, hello_payload
from brickhub.hub.transport import HubProgram, Transport
from brickhub.robot import Motor, Robot
from brickhub.robot.hardware import port_name
from brickhub.robot.spec import HUB_FLAT

STALL_SPEED_DEG_S = 60
STALL_TORQUE_MNM = 250
"""Torque at which a joint is turned to its stops. It is more than a medium motor has: a raised arm
needs all of it, and at this speed the stops are not damaged."""
STALL_LIMIT_MS = 10_000
"""Time after which a motor counts as free: a whole turn takes 6 s at this speed."""
STALL_LIMIT_DEG = 400
"""Angle after which a motor counts as free: more than a whole turn."""
WHEEL_DEG = 90
"""Turn of a wheel forward, and back; small enough for a table."""
WHEEL_SPEED_DEG_S = 180
_WHEEL_LIMIT_MS = 1500
"""Limit of a turn, three times what it takes at this speed."""
_SETTLE_MS = 200
"""Pause between the end of a turn and the reading of the gyroscope."""
_SURVEY_S = 20.0


@dataclass(frozen=True)
class Survey:
    """Result of a survey.

    Attributes:
        ports: device id on each port, 0 for none.
        angles_deg: output angle of each connected motor.
        battery_mv, firmware, name: battery voltage, firmware version and name of the hub.
        imu_ready, imu_still: state of the IMU; ``None`` on a hub without one.
        pitch_deg, roll_deg: tilt of the hub; 0 on a hub without an IMU.
    """

    ports: dict[str, int]
    angles_deg: dict[str, int]
    battery_mv: int
    firmware: str
    name: str
    imu_ready: bool | None = None
    imu_still: bool | None = None
    pitch_deg: int = 0
    roll_deg: int = 0


def survey_program(robot: Robot) -> HubProgram:
    """Hub program of `survey`."""
    model = robot.hub.model
    ports = ", ".join(f'("{port}", Port.{port_name(port)})' for port in model.ports)
    imports = [
        "from pybricks import version",
        "from pybricks.iodevices import PUPDevice",
        *_imports(robot, *_ASKED[model.devices]),
    ]
    return _program(
        f"Asks what is plugged into the robot '{robot.name}', and how the hub is. Moves nothing.",
        imports,
        [f"PORTS = ({ports})", _motors(robot.motors), f"HAS_IMU = {model.has_imu}"],
        robot,
        f"ids_{model.devices}",
        "inventory",
    )


def survey(transport: Transport, robot: Robot) -> Survey:
    """Survey a hub over an open transport. Nothing moves; a running program is stopped. Raises
    HubError if the hub cannot be reached, or does not answer, HubProgramError if the program
    raised."""
    return parse_survey(run(transport, survey_program(robot), _SURVEY_S))


def parse_survey(lines: list[str]) -> Survey:
    """Survey from the lines that the program printed. Raises HubError if the lines are
    incomplete."""
    # Only literals are evaluated, so that nothing that a hub sends is ever run.
    try:
        return Survey(**ast.literal_eval(lines[-1]))
    except (IndexError, SyntaxError, TypeError, ValueError):
        raise HubError("the hub's answer is incomplete; bring it near and try again") from None


def stops_program(robot: Robot) -> HubProgram:
    """Hub program of `find_stops`."""
    constants = [
        _motors(_joints(robot)),
        f"TORQUE_MNM = {STALL_TORQUE_MNM}",
        f"SPEED_DEG_S = {STALL_SPEED_DEG_S}",
        f"LIMIT_MS = {STALL_LIMIT_MS}",
        f"LIMIT_DEG = {STALL_LIMIT_DEG}",
    ]
    imports = [*_imports(robot), "from pybricks.tools import StopWatch, wait"]
    return _program(
        f"Turns the joints of the robot '{robot.name}' to their stops.",
        imports,
        constants,
        robot,
        "find_stops",
    )


def find_stops(transport: Transport, robot: Robot) -> dict[str, tuple[int, int] | None]:
    """Turn each motor with a range to both stops, one motor at a time, and stop in the middle. This
    moves the robot.

    Returns:
        For each motor, the measured angles of its stops; ``None`` if it has none.

    Raises:
        HubError: the hub cannot be reached, or does not answer; the motors are then stopped.
        HubProgramError: the program raised.
    """
    joints = _joints(robot)
    if not joints:
        return {}
    # The limit is long enough for three moves of each joint: to both stops, and back to the middle.
    timeout_s = 5.0 + 3 * len(joints) * STALL_LIMIT_MS / 1000
    stops_deg: dict[str, tuple[int, int] | None] = {}
    for line in run(transport, stops_program(robot), timeout_s):
        match line.split(" "):
            case ["stops", name, low, high]:
                stops_deg[name] = (int(low), int(high))
            case ["free", name]:
                stops_deg[name] = None
    return stops_deg


@dataclass(frozen=True)
class WheelTurn:
    """Turn of one wheel of a drive base, forward and then back, as the sum of both.

    Attributes:
        motor: its name.
        wheel_deg: angle by which it turned, by its rotation sensor.
        heading_deg: angle by which the hub turned clockwise, by the gyroscope.
    """

    motor: str
    wheel_deg: float
    heading_deg: float


def wheels_program(robot: Robot) -> HubProgram:
    """Hub program of `turn_wheels`. Raises DescriptionError if the robot has no drive base."""
    base = robot.drive_base
    if base is None:
        raise DescriptionError(
            f"robot '{robot.name}' has no drive base, so no wheels to turn; describe it"
        )
    constants = [
        _motors((robot.motor(base.left), robot.motor(base.right))),
        f"ANGLE_DEG = {WHEEL_DEG}",
        f"SPEED_DEG_S = {WHEEL_SPEED_DEG_S}",
        f"LIMIT_MS = {_WHEEL_LIMIT_MS}",
        f"SETTLE_MS = {_SETTLE_MS}",
    ]
    imports = [*_imports(robot), "from pybricks.tools import StopWatch, wait"]
    return _program(
        f"Turns the wheels of the robot '{robot.name}'.",
        imports,
        constants,
        robot,
        "wheels",
    )


def turn_wheels(transport: Transport, robot: Robot) -> list[WheelTurn]:
    """Turn each wheel of the robot's drive base alone, forward and back, while the other one holds.
    This moves the robot.

    Raises:
        DescriptionError: the robot has no drive base.
        HubError: the hub cannot be reached, or does not answer; the motors are then stopped.
        HubProgramError: the program raised.
    """
    # The limit is long enough for each of the two wheels to turn forward and back.
    timeout_s = 5.0 + 4 * (_WHEEL_LIMIT_MS + _SETTLE_MS) / 1000
    turns = []
    for line in run(transport, wheels_program(robot), timeout_s):
        match line.split(" "):
            case ["wheel", name, wheel_deg, heading_deg]:
                turns.append(WheelTurn(name, float(wheel_deg), float(heading_deg)))
    return turns


def run(
    transport: Transport,
    program: HubProgram,
    timeout_s: float,
) -> list[str]:
    """Run a program and return the lines that it prints before the last one, ``end``; the first are
    those of its HELLO. It is stopped after the timeout.

    Raises:
        HubError: the hub cannot be reached.
        HubTimeoutError: the program took too long, or ended without that line.
        HubProgramError: the program raised.
    """
    output = io.BytesIO()
    errors = io.StringIO()
    exit_code = run_program(
        transport,
        program,
        stdout=output,
        stderr=errors,
        time_limit_s=timeout_s,
    )
    # A program that was stopped by its time limit or by the hub's button lacks its last line.
    if exit_code not in (0, TIME_LIMIT_EXIT_CODE):
        raise HubProgramError(describe_traceback(errors.getvalue(), program.source))
    text = output.getvalue().decode("utf-8", "replace")
    # The text ends with a line end. Two more are put before it, so that there are always enough
    # lines to unpack.
    *lines, end, _ = f"\n\n{text}".split("\n")
    if end != "end":
        raise HubTimeoutError(
            f"the program that looks at the hub did not end within {timeout_s:g} s; switch the "
            "hub off and on"
        )
    return lines


_ASKED: dict[str, tuple[str, ...]] = {"pupdevices": (), "ev3devices": ("TouchSensor",)}
"""Classes of devices, besides motors, by which the program asks what is on a port; by the hub's
module of devices."""


def _imports(robot: Robot, *classes: str) -> list[str]:
    devices = ", ".join(("Motor", *classes))
    return [
        "from pybricks.parameters import Direction, Port",
        f"from pybricks.{robot.hub.model.devices} import {devices}",
        "from usys import stdout",
    ]


def _joints(robot: Robot) -> tuple[Motor, ...]:
    return tuple(motor for motor in robot.motors if motor.range_deg is not None)


def _motors(motors: tuple[Motor, ...]) -> str:
    lines = []
    for motor in motors:
        # Pybricks calls it None if a motor has no gears.
        gears = list(motor.gears) or None
        direction = f"Direction.{motor.direction.name}"
        lines.append(f'    ("{motor.name}", Port.{port_name(motor.port)}, {direction}, {gears}),\n')
    return f"MOTORS = (\n{''.join(lines)})"


def _program(
    purpose: str,
    imports: list[str],
    constants: list[str],
    robot: Robot,
    *scripts: str,
) -> HubProgram:
    model = robot.hub.model
    hub_import = f"from pybricks.hubs import {model.class_name}"
    comments = [f"# {purpose}", "# Written by BricksRL from the robot's description."]
    if robot.hub_sides != HUB_FLAT:
        imports = [
            line.replace("import Direction, Port", "import Axis, Direction, Port")
            for line in imports
        ]
    head = [*comments, *sorted_imports([hub_import, *imports]), "", *constants, ""]
    # The empty line ends the line of the HELLO frame, whose bytes are no text.
    texts = [onboard_text(script).strip() for script in scripts]
    body = [hub_line(robot), "print()", *texts, ""]
    # The hash is computed without the HELLO frame, which carries it.
    digest = hashlib.sha256("\n".join([*head, *body]).encode()).digest()
    program_hash = int.from_bytes(digest[:4], "little")
    # HELLO comes before anything that may raise, because the transport learns from it which program
    # runs.
    hello_frame = control_frame(Up.HELLO, hello_payload(program_hash))
    hello = f"stdout.buffer.write({hello_frame!r})"
    return HubProgram("\n".join([*head, hello, "", *body]), program_hash)
