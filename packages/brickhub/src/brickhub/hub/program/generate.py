"""Generator of the MicroPython program for a robot and an interface, which are first checked
against each other.

A program consists of a header comment, the constants of the wire, the robot's devices,
``start_moves`` and ``read_channels``, and the loop from ``onboard/loop.py``, which is the same for
every robot.
"""

import hashlib
from collections import Counter
from collections.abc import Sequence
from importlib import resources
from typing import NamedTuple

from brickhub.entry import Entry
from brickhub.errors import DescriptionError, ProgramError
from brickhub.fields import check_fields
from brickhub.hub import protocol
from brickhub.hub.commands import WIRE_MAX, Command
from brickhub.hub.interface import Channel, Interface, Pitch, Roll
from brickhub.hub.transport import HubProgram, Pipe
from brickhub.hub.trial_protocol import SHARE_MAX, TRIAL_END, TrialWire
from brickhub.robot import Direction, Motor, Robot, Sensor
from brickhub.robot.hardware import port_name
from brickhub.robot.spec import HUB_FLAT

WATCHDOG_MS = 400
"""Default silence after which the hub stops its motors; a WATCHDOG frame changes it."""
END_MS = 10_000
"""Further silence after which the program ends, so that the hub advertises again."""
LONGEST_TRIAL_MS = 10_000
"""Time after which a trial ends in any case: nobody has to tell the hub so."""
TILT_DEG = 35.0
"""Default pitch or roll that ends a trial."""
_MAX_SETTLE_MS = 60_000
"""Longest step, shorter than the 65.5 s after which the hub's clock wraps on the wire."""


class Goals(NamedTuple):
    """Numbers of an observation that the hub draws itself, where nobody gives it a goal.

    Attributes:
        ranges: lowest and highest value of each; whole numbers are drawn between two ``int``.
        steps: steps after which they are drawn anew.
    """

    ranges: tuple[tuple[float, float], ...]
    steps: int


class Place(NamedTuple):
    """A place that a hub finds by dead reckoning, as nobody tells it where that is. Both poses are
    in mm along x and y, and in degrees clockwise from x.

    Attributes:
        start: where the robot is put.
        place: where it is to go.
        wheels: names of the left and the right motor of its drive base.
        deg_per_mm, track_mm: of that.
    """

    start: tuple[float, float, float]
    place: tuple[float, float, float]
    wheels: tuple[str, str]
    deg_per_mm: float
    track_mm: float


def validate(robot: Robot, interface: Interface) -> None:
    """Check that the robot has every device that the interface names and that all ranges fit the
    wire. Raises ProgramError if this kind of hub is not supported, DescriptionError if robot and
    interface do not match."""
    robot.check_complete()
    model = robot.hub.model
    if not model.runs_programs:
        raise ProgramError(
            f"robot '{robot.name}': a {robot.hub.value} runs no programs; programs for it run on "
            "this computer"
        )
    if model.stdin_bytes == 0:
        raise ProgramError(
            f"robot '{robot.name}': a {robot.hub.value} hub has neither standard input nor "
            "floating point numbers nor ustruct, "
            "and is not supported; choose a prime, essential, technic or city hub"
        )
    if len(interface.commands) > protocol.MAX_ACTIONS:
        raise DescriptionError(
            f"{len(interface.commands)} commands do not fit one write of 20 bytes; use at most "
            f"{protocol.MAX_ACTIONS}"
        )
    if not interface.channels:
        raise DescriptionError(
            "the interface has no channels; name at least one, so that the hub has something "
            "to answer"
        )
    # A command and a channel may share a name, because an angle can be both set and read.
    for numbers in (interface.commands, interface.channels):
        counts = Counter(number.name for number in numbers)
        for number in numbers:
            if counts[number.name] > 1:
                raise number.error(f" is named {counts[number.name]} times; name each once")
            low = number.low
            high = number.high
            largest = WIRE_MAX / number.scale
            # The comparison is written such that it refuses NaN too.
            if not -largest <= low < high <= largest:
                raise number.error(
                    f" ranges from {low} to {high}; give low < high within +-{largest:g}"
                )
            number.check(robot)
    _check_encoders(robot, interface)
    movers = dict[str, Command]()
    for command in interface.commands:
        for motor in command.motors(robot):
            other = movers.setdefault(motor, command)
            if other is command:
                continue
            # Two arguments of one call do not contradict each other.
            is_same_call = command.call is not None and command.call == other.call
            if not is_same_call:
                raise DescriptionError(
                    f"motor '{motor}' is moved by the commands '{other.name}' and "
                    f"'{command.name}'; use one"
                )
        if interface.settle.fixed_ms is None and not command.ends:
            raise DescriptionError(
                f"the command '{command.name}' goes on until the next step; let the step Wait, "
                "not UntilDone"
            )
    check_fields(type(interface.settle), vars(interface.settle))
    time_ms = interface.settle.longest_ms
    if not 0 < time_ms <= _MAX_SETTLE_MS:
        raise DescriptionError(
            f"the step settles after {time_ms} ms; give 1 to {_MAX_SETTLE_MS} ms"
        )


def _check_encoders(robot: Robot, interface: Interface) -> None:
    # A channel of a motor needs its encoder, which a command may do without.
    parts: list[Channel | Command] = [*interface.channels]
    parts += [command for command in interface.commands if command.needs_encoder]
    for part in parts:
        names = part.devices(robot)
        for motor in robot.motors:
            if motor.name in names and not motor.kind.model.has_encoder:
                raise part.error(
                    f" needs an encoder, and '{motor.name}' is a {motor.kind.value} motor; "
                    "use RunDuty"
                )


def generate(
    robot: Robot,
    interface: Interface,
    pipe: Pipe = Pipe.STDIN,
) -> HubProgram:
    """Generate the program with which ``robot`` takes the commands and reports the channels of
    ``interface``.

    The hash is that of the text with a hash of zeros.

    Raises:
        DescriptionError: robot and interface do not match.
        ProgramError: the robot's hub cannot run such a program.
    """
    validate(robot, interface)
    loop_imports, loop = _onboard("loop")
    input_imports, input_part = _input(pipe)
    parts = [
        _constants(robot, interface, pipe),
        *_joint_part(robot, interface),
        # The input comes first, because the host may write as soon as the program runs.
        input_part,
        _devices(robot, interface),
        _start_moves(robot, interface),
        _read_channels(robot, interface),
        _onboard("moves")[1],
        _onboard("frames")[1],
        loop,
    ]
    imports = _robot_imports(robot, interface) + input_imports + loop_imports
    return _with_hash(_joined(_header(robot, interface), imports, parts), pipe)


def _with_hash(text: str, pipe: Pipe) -> HubProgram:
    """The program of a text, which says the text's hash."""
    # It therefore cannot be the hash of its own text.
    program_hash = hashlib.sha256(text.encode()).digest()[:4]
    source = text.replace(_hash_line(bytes(4)), _hash_line(program_hash), 1)
    return HubProgram(source, int.from_bytes(program_hash, "little"), pipe)


def generate_alone(
    robot: Robot,
    interface: Interface,
    observed: Sequence[int],
    policy: str,
    origin: str,
    age_ms: int,
    goals: Goals | None = None,
    world: str = "",
    place: Place | None = None,
) -> HubProgram:
    """Generate a program with which ``robot`` acts by itself, without a host, until the center
    button is pressed.

    Args:
        observed: indices of the channels that the policy observes, in its order.
        policy: MicroPython that defines ``act(observed)``: actions in -1..1 for the observed
            numbers, in their units; the goals come last.
        origin: what the policy is, for the header.
        age_ms: age of an observation when its commands start, as over the link that the policy
            learned with.
        goals: what the hub draws itself; by default nothing.
        world: name of the world that the policy is for, which the header says.
        place: what it reckons, of which the policy observes last its commands, in their units, and
            where the place is: see ``onboard/reckoning.py``.

    Raises:
        DescriptionError: robot and interface do not match.
        ProgramError: the robot's hub cannot run such a program.
    """
    validate(robot, interface)
    policy_imports, policy = _parted(policy)
    alone_imports, alone = _onboard("alone")
    goal_imports, goal_part = _goals(goals)
    place_imports, place_part = _reckoning(place)
    added = " + goals()" if goals else ""
    if place is not None:
        added += f" + [{_last_commands(interface)}] + seen_place()"
    constants = [
        *_step_constants(interface),
        _counting(interface, observed),
        f"AGE_MS = {age_ms}  # age of an observation when its commands start",
        "# Middle and half of each command's range, times its scale.",
        f"SPANS = {_spans(interface)}",
    ]
    parts = [
        "\n".join(constants) + "\n",
        *_joint_part(robot, interface),
        _devices(robot, interface),
        _start_moves(robot, interface),
        *goal_part,
        *place_part,
        _observe(interface, observed, added),
        policy,
        _onboard("moves")[1],
        _onboard("relative")[1],
        alone,
    ]
    end = f"It acts by itself, by {origin}, until the center button is pressed."
    # What names the program, and the robot that a page puts on its stage for it.
    robot_line = f"# Robot: {robot.name} {world}".rstrip()
    title = f"# {origin[:1].upper()}{origin[1:]}\n{robot_line}\n"
    header = title + _header(robot, interface, end)
    imports = _robot_imports(robot, interface) + policy_imports + alone_imports + goal_imports
    imports = list(dict.fromkeys(imports + place_imports))
    return HubProgram(_joined(header, imports, parts), 0, says_hello=False)


def generate_trials(
    robot: Robot,
    interface: Interface,
    numbers: Sequence[Entry],
    policy: str,
    *,
    tilt_deg: float = TILT_DEG,
    pipe: Pipe = Pipe.STDIN,
) -> HubProgram:
    """Generate a program with which ``robot`` tries a structured policy by itself, one trial at a
    time, by numbers that the host sends: see `brickhub.hub.trial_protocol`.

    Args:
        numbers: the policy's numbers ``[p]``, with their ranges.
        policy: MicroPython that defines ``act_by(observed, numbers)``: actions in -1..1 for all
            channels, in their units.
        tilt_deg: pitch or roll that ends a trial, if the interface has them.

    Raises:
        DescriptionError: robot and interface do not match, or there are no numbers or too many.
        ProgramError: the robot's hub cannot run such a program.
    """
    validate(robot, interface)
    wire = TrialWire(interface, robot, numbers)
    policy_imports, policy = _parted(policy)
    trials_imports, trials = _onboard("trials")
    input_imports, input_part = _input(pipe)
    ranges = [((one.low + one.high) / 2, (one.high - one.low) / 2 / SHARE_MAX) for one in numbers]
    limits = []
    for index, channel in enumerate(interface.channels):
        if isinstance(channel, Pitch | Roll):
            limits.append((index, tilt_deg))
    constants = [
        *_wire_constants(wire.answer_format, wire.down_frame_bytes, pipe),
        f"END_HEAD = bytes([MAGIC, 0, {TRIAL_END}])",
        f'PIECE_FORMAT = "{wire.piece_format}"  # of a piece of a trial\'s numbers',
        f"PIECES = {wire.pieces}",
        "RANGES = (  # middle, and half for the unit on the wire, of each number",
        *(f"    ({middle:.7g}, {half:.7g})," for middle, half in ranges),
        ")",
        "",
        *_step_constants(interface),
        "# Middle and half of each command's range, times its scale.",
        f"SPANS = {_spans(interface)}",
        _counting(interface, range(len(interface.channels))),
        f"LIMITS = {tuple(limits)}  # index of a tilt, and where it ends a trial",
        f"LONGEST_MS = {LONGEST_TRIAL_MS}  # of a trial",
        f"END_MS = {END_MS}  # silence between trials that ends the program",
    ]
    parts = [
        "\n".join(constants) + "\n",
        *_joint_part(robot, interface),
        input_part,
        _devices(robot, interface),
        _start_moves(robot, interface),
        _observe(interface, range(len(interface.channels))),
        _packed(robot, interface),
        policy,
        _onboard("moves")[1],
        _onboard("frames")[1],
        _onboard("relative")[1],
        trials,
    ]
    end = "It makes trials by itself, by numbers that it is told."
    imports = _robot_imports(robot, interface) + policy_imports + input_imports + trials_imports
    return _with_hash(_joined(_header(robot, interface, end), imports, parts), pipe)


def _input(pipe: Pipe) -> tuple[list[str], str]:
    """Import lines and body of what talks to the host."""
    return _onboard({Pipe.STDIN: "stdio", Pipe.APP_DATA: "app_data"}[pipe])


def _counting(interface: Interface, observed: Sequence[int]) -> str:
    """Line with the places of what counts on, among what a policy observes, which takes it from its
    own start."""
    channels = interface.channels
    places = [place for place, index in enumerate(observed) if channels[index].accumulates]
    return f"COUNTING = {tuple(places)}  # places of what counts from the start of the acting"


def _spans(interface: Interface) -> tuple[tuple[float, float], ...]:
    """Of each command: middle and half of its range, on the wire, to which actions are scaled."""
    spans = []
    for command in interface.commands:
        middle = (command.low + command.high) / 2
        half = (command.high - command.low) / 2
        spans.append((middle * command.scale, half * command.scale))
    return tuple(spans)


def _joined(
    header: str,
    imports: list[str],
    parts: list[str],
) -> str:
    """Text of a program."""
    head = "\n".join([header, *sorted_imports(imports), ""])
    return "\n\n".join([head, *parts])


def _joint_part(robot: Robot, interface: Interface) -> list[str]:
    # A City hub has 20 KB for the whole program, so this is included only where it is needed.
    return [_onboard("joint")[1]] if _joints(robot, interface) else []


def _onboard(name: str) -> tuple[list[str], str]:
    """Import lines and body of the hub's part of a file in ``onboard``."""
    return _parted(onboard_text(name))


def _parted(text: str) -> tuple[list[str], str]:
    """Import lines and the rest of a program."""
    lines = text.splitlines()
    imports = [line for line in lines if line.startswith(("import ", "from "))]
    rest = [line for line in lines if line not in imports]
    body = "\n".join(rest).strip()
    return imports, body + "\n"


def onboard_text(name: str) -> str:
    """The hub's part of a file in ``onboard``."""
    file = resources.files(f"{__package__}.onboard").joinpath(f"{name}.py")
    text = file.read_text(encoding="utf-8")
    # What stands before this line is for readers and tools on this computer.
    return text.split("# --- the hub's part ---\n", 1)[1]


def sorted_imports(lines: list[str]) -> list[str]:
    """Import lines in the order of their modules."""
    return sorted(lines, key=lambda line: (line.split()[1], line))


def _hash_line(program_hash: bytes) -> str:
    return f"PROGRAM_HASH = {program_hash!r}"


def _header(
    robot: Robot,
    interface: Interface,
    end: str = "",
) -> str:
    settle = interface.settle
    if settle.fixed_ms is None:
        answer = (
            f"It answers when all moves have ended, or after {settle.longest_ms} ms, when it stops "
            "those that have not."
        )
    else:
        answer = f"It answers {settle.fixed_ms} ms after the commands started."
    lines = [
        (
            f'Program of the robot "{robot.name}" for the {robot.hub.value} hub, written by '
            "BricksRL from the robot's description."
        ),
        "Do not edit: it is written anew whenever the description changes.",
    ]
    lines.append("Commands, in the order of the action:")
    lines += [
        f"  {command.name}: {command.description.format(command)}" for command in interface.commands
    ]
    lines.append("Channels, in the order of the observation:")
    lines += [
        f"  {channel.name}, {channel.low:g} to {channel.high:g} {channel.unit}"
        for channel in interface.channels
    ]
    lines.append(end or answer)
    return "".join(f"# {line}\n" for line in lines)


def _robot_imports(robot: Robot, interface: Interface) -> list[str]:
    motors = _motors(robot, interface)
    sensors = _sensors(robot, interface)
    names = {("pybricks.hubs", robot.hub.model.class_name)}
    for device in (*motors, *sensors):
        kind = device.kind.model
        names.add((f"pybricks.{kind.module}", kind.class_name))
    for number in (*interface.commands, *interface.channels):
        names.update(number.imports)
    if motors or sensors:
        names.add(("pybricks.parameters", "Port"))
    if any(motor.direction is Direction.COUNTERCLOCKWISE for motor in motors):
        names.add(("pybricks.parameters", "Direction"))
    if robot.hub_sides != HUB_FLAT:
        names.add(("pybricks.parameters", "Axis"))
    # Imports are sorted, so that a program always has the same text and thereby the same hash.
    names_of_modules: dict[str, list[str]] = {}
    for module, name in sorted(names):
        names_of_modules.setdefault(module, []).append(name)
    return [
        f"from {module} import {', '.join(its_names)}"
        for module, its_names in names_of_modules.items()
    ]


def _step_constants(interface: Interface) -> list[str]:
    settle = interface.settle
    return [
        f"UNTIL_DONE = {settle.fixed_ms is None}  # a step ends when all moves have ended",
        f"SETTLE_MS = {settle.longest_ms}  # and after this time in any case",
    ]


def _wire_constants(
    answer_format: str,
    down_frame_bytes: int,
    pipe: Pipe,
) -> list[str]:
    sizes = []
    for kind in protocol.Down:
        frame_bytes = protocol.CONTROL_OVERHEAD + protocol.DOWN_PAYLOAD_BYTES[kind]
        sizes.append(f"{kind.name}: {frame_bytes}")
    app_data_lines = []
    if pipe is Pipe.APP_DATA:
        app_data_lines.append(f"SLOT_BYTES = {protocol.APP_DATA_BYTES}  # of AppData")
    return [
        (
            "# The wire, from the same definitions as on the host's side. Kinds of frames "
            "are ASCII letters."
        ),
        f"MAGIC = 0x{protocol.MAGIC:02X}",
        f"CRC_POLYNOMIAL = 0x{protocol.CRC_POLYNOMIAL:X}",
        *(f"{kind.name} = {kind.value}  # '{chr(kind.value)}'" for kind in protocol.Down),
        *(f"{reason.name} = {reason.value}" for reason in protocol.ByeReason),
        f'ANSWER_FORMAT = "{answer_format}"',
        f"COMMAND_BYTES = {down_frame_bytes}  # length of a data frame from the host",
        f"CONTROL_BYTES = {{{', '.join(sizes)}}}",
        f"PIECE_BYTES = {protocol.NOTIFICATION_BYTES}  # what fits one notification",
        f"HELLO_HEAD = bytes([MAGIC, 0, {protocol.Up.HELLO.value}, {protocol.PROTOCOL_VERSION}])",
        f"BYE_HEAD = bytes([MAGIC, 0, {protocol.Up.BYE.value}])",
        *app_data_lines,
        _hash_line(bytes(4)),
    ]


def _constants(
    robot: Robot,
    interface: Interface,
    pipe: Pipe,
) -> str:
    wire = protocol.WireFormat(interface, robot)
    until_done = interface.settle.fixed_ms is None
    latest = "at the latest" if until_done else "in any case"
    lines = [
        *_wire_constants(wire.answer_format, wire.down_frame_bytes, pipe),
        f'ACTION_FORMAT = "{wire.action_format}"',
        "",
        f"UNTIL_DONE = {until_done}  # answer when all moves have ended",
        f"SETTLE_MS = {interface.settle.longest_ms}  # answer after this time {latest}",
        f"WATCHDOG_MS = {WATCHDOG_MS}  # silence that stops the motors",
        f"END_MS = {END_MS}  # further silence that ends the program",
    ]
    return "\n".join(lines) + "\n"


def _motors(robot: Robot, interface: Interface) -> list[Motor]:
    """Motors that the interface commands or reads, in the robot's order."""
    names = _device_names(robot, interface)
    return [motor for motor in robot.motors if motor.name in names]


def _sensors(robot: Robot, interface: Interface) -> list[Sensor]:
    """Sensors and lights of the interface, without duplicates, in the order of its channels and
    commands."""
    sensors = {sensor.name: sensor for sensor in robot.sensors}
    names = _device_names(robot, interface)
    return [sensors[name] for name in names if name in sensors]


def _device_names(robot: Robot, interface: Interface) -> list[str]:
    """Names of the motors and sensors of the interface, each once, those of its channels first."""
    # A dictionary keeps the order in which names are first mentioned.
    names: dict[str, None] = {}
    for part in (*interface.channels, *interface.commands):
        for name in part.devices(robot):
            names[name] = None
    return list(names)


def _joints(robot: Robot, interface: Interface) -> set[str]:
    """Names of the motors with a range that are commanded by an angle."""
    turned_by_angle: set[str] = set()
    for command in interface.commands:
        if command.is_turn_by:
            turned_by_angle.update(command.motors(robot))
    with_range = {motor.name for motor in robot.motors if motor.range_deg is not None}
    return turned_by_angle & with_range


# No turn is needed, because Pybricks' axes are those of a robot: x forward, y left, z up.
_AXES = {
    "ahead": "Axis.X",
    "back": "-Axis.X",
    "left": "Axis.Y",
    "right": "-Axis.Y",
    "up": "Axis.Z",
    "down": "-Axis.Z",
}


def hub_line(robot: Robot) -> str:
    """Statement that makes the hub, as it is mounted; needs ``Axis`` of ``pybricks.parameters``
    unless it lies flat."""
    top, front = (_AXES[side] for side in robot.hub_sides)
    sides = "" if robot.hub_sides == HUB_FLAT else f"top_side={top}, front_side={front}"
    return f"hub = {robot.hub.model.class_name}({sides})"


def _devices(robot: Robot, interface: Interface) -> str:
    joints = _joints(robot, interface)
    lines = [hub_line(robot)]
    for motor in _motors(robot, interface):
        lines += _motor_lines(motor, motor.name in joints)
    # Setups come after the motors, because a drive base is made of them. Equal setups, as of
    # several commands for one drive base, are written once.
    setups = dict.fromkeys(command.setup(robot) for command in interface.commands)
    setups |= dict.fromkeys(channel.setup(robot) for channel in interface.channels)
    for setup in setups:
        lines += setup
    for sensor in _sensors(robot, interface):
        class_name = sensor.kind.model.class_name
        lines.append(f"sensor_{sensor.name} = {class_name}(Port.{port_name(sensor.port)})")
    # A dictionary holds each mover once, because the two wheels of a drive base have a single one
    # that stops and ends a step.
    movers: dict[str, None] = {}
    for command in interface.commands:
        if command.mover is not None:
            movers[command.mover] = None
    lines += ["", f"MOVERS = [{', '.join(movers)}]"]
    return "\n".join(lines) + "\n"


def _motor_lines(motor: Motor, is_joint: bool) -> list[str]:
    variable = f"motor_{motor.name}"
    arguments = [f"Port.{port_name(motor.port)}"]
    if motor.direction is Direction.COUNTERCLOCKWISE:
        arguments.append("Direction.COUNTERCLOCKWISE")
    # Gears convert the angles of an encoder, so a DCMotor takes none.
    if motor.gears and motor.kind.model.has_encoder:
        arguments.append(f"gears={list(motor.gears)}")
    lines = [f"{variable} = {motor.kind.model.class_name}({', '.join(arguments)})"]
    if motor.zero_deg:
        lines.append(f"{variable}.reset_angle({_from_zero(motor, f'{variable}.angle()')})")
    limits = {
        "speed": motor.speed_limit_deg_s,
        "acceleration": motor.acceleration_deg_s2,
        "torque": motor.torque_limit_mnm,
    }
    # Limits that are not given keep the firmware's defaults.
    limit_arguments = [f"{name}={value}" for name, value in limits.items() if value is not None]
    if limit_arguments:
        lines.append(f"{variable}.control.limits({', '.join(limit_arguments)})")
    # The Joint wraps the motor last, because it has only the methods that commands and channels
    # need.
    if is_joint and motor.range_deg is not None:
        low_deg, high_deg = motor.range_deg
        lines.append(f"{variable} = Joint({variable}, {low_deg}, {high_deg})")
    return lines


def _from_zero(motor: Motor, angle: str) -> str:
    """Expression of the angle relative to the calibrated zero, shifted by whole turns to be near
    the range."""
    # A hub reports whole degrees, so turns of a fractional length cannot be added to them.
    if not motor.turn_deg.is_integer():
        return f"{angle} - {motor.zero_deg}"
    # When it is switched on, a hub knows an angle only within one turn of the shaft. Of the
    # possible angles, the one within half a turn of the middle of the range is taken.
    turn_deg = int(motor.turn_deg)
    middle_deg = sum(motor.range_deg or (0, 0)) // 2
    lowest_deg = middle_deg - turn_deg // 2
    return f"({angle} - {motor.zero_deg + lowest_deg}) % {turn_deg} + {lowest_deg}"


def _start_moves(robot: Robot, interface: Interface) -> str:
    lines = [
        "def start_moves(actions):",
        '    """Start the commands, clamped to their ranges, without waiting for their ends."""',
    ]
    # Commands are grouped by their call on the hub, each with its first command and the expressions
    # of all of them.
    first_commands: dict[str, Command] = {}
    amounts_of_calls: dict[str, dict[str, str]] = {}
    for index, command in enumerate(interface.commands):
        # The hub clamps to the range itself, whatever the host sends.
        low = round(command.low * command.scale)
        high = round(command.high * command.scale)
        divisor = command.scale if command.is_whole else 1
        amount = f"whole(actions[{index}], {low}, {high}, {divisor})"
        call = command.call or command.name
        first_commands.setdefault(call, command)
        amounts_of_calls.setdefault(call, {})[command.name] = amount
    for call, command in first_commands.items():
        lines.append("    " + command.start(robot, amounts_of_calls[call]))
    return "\n".join(lines) + "\n"


def _statements(channels: Sequence[Channel]) -> list[str]:
    """Statements that read what the channels need, each once."""
    # A call that returns several numbers is made only once, so that they also belong together.
    statements = dict.fromkeys(channel.statement for channel in channels)
    return [f"    {statement}" for statement in statements if statement is not None]


def _goals(goals: Goals | None) -> tuple[list[str], list[str]]:
    """Import lines and parts of a program that draws goals."""
    if goals is None:
        return [], []
    imports, body = _onboard("goals")
    constants = (
        f"GOALS = {tuple(goals.ranges)}  # lowest and highest value; whole numbers if both are\n"
        f"GOAL_STEPS = {goals.steps}  # steps after which they are drawn anew\n"
    )
    return imports, [constants, body]


def _reckoning(place: Place | None) -> tuple[list[str], list[str]]:
    """Import lines and parts of a program that reckons a place."""
    if place is None:
        return [], []
    imports, body = _onboard("reckoning")
    left, right = place.wheels
    lines = [
        "# Where the robot is put, and where it is to go: mm along x and y, degrees clockwise.",
        start_line(place.start),
        f"PLACE = {place.place}",
        f"DEG_PER_MM = {place.deg_per_mm:.6g}",
        f"TRACK_MM = {place.track_mm:g}",
        "",
        "",
        "def wheels():",
        f"    return motor_{left}.angle(), motor_{right}.angle()",
    ]
    return imports, ["\n".join(lines) + "\n", body]


def start_line(start: tuple[float, float, float]) -> str:
    """Line of a program that says where the robot is put."""
    x_mm, y_mm, heading_deg = start
    return f"START = ({x_mm:.1f}, {y_mm:.1f}, {heading_deg:.1f})"


def _last_commands(interface: Interface) -> str:
    """Expressions of the last commands, in their units."""
    parts = [
        f"COMMANDED[{index}] / {command.scale}" for index, command in enumerate(interface.commands)
    ]
    return ", ".join(parts)


def _observe(
    interface: Interface,
    observed: Sequence[int],
    added: str = "",
) -> str:
    channels = [interface.channels[index] for index in observed]
    lines = [
        "def observe():",
        '    """What the policy observes, each number in its unit."""',
        *_statements(channels),
        "    return [",
        *(f"        {channel.expression}," for channel in channels),
        f"    ]{added}",
    ]
    return "\n".join(lines) + "\n"


def _wire(channel: Channel, robot: Robot) -> str:
    """Function that makes a channel's wire value: no robot ever counts beyond 32 bits."""
    return "round" if channel.is_wide(robot) else "wire"


def _packed(robot: Robot, interface: Interface) -> str:
    lines = [
        "def packed(time_ms, observed):",
        '    """An answer: the clock, and what was observed, each number times its scale."""',
        "    return ustruct.pack(",
        "        ANSWER_FORMAT,",
        "        time_ms,",
        *(
            f"        {_wire(channel, robot)}(observed[{index}] * {channel.scale}),"
            for index, channel in enumerate(interface.channels)
        ),
        "    )",
    ]
    return "\n".join(lines) + "\n"


def _read_channels(robot: Robot, interface: Interface) -> str:
    lines = [
        "def read_channels(time_ms):",
        '    """The answer\'s numbers: the clock, and each channel in its unit times its scale."""',
        *_statements(interface.channels),
        "    return ustruct.pack(",
        "        ANSWER_FORMAT,",
        "        time_ms,",
        *(
            f"        {_wire(channel, robot)}({channel.expression} * {channel.scale}),"
            for channel in interface.channels
        ),
        "    )",
    ]
    return "\n".join(lines) + "\n"
