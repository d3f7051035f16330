"""Motion logs of a robot that carries out commands, recorded on any hub and used to fit a twin.

A file has one JSON object per line: first a header with robot, interface and program, then the
hub's answers, the first one to a reading without a command. Times are those of the hub's clock, and
so free of the link's jitter.
"""

import contextlib
import dataclasses
import inspect
import json
from collections.abc import Callable, Iterable, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any, TypeVar

import numpy as np
from numpy.typing import NDArray

from brickhub.errors import DescriptionError, TwinError
from brickhub.fields import check_fields
from brickhub.files import reading, write_durably
from brickhub.hub.interface import Channel, Command, Interface, UntilDone, Wait
from brickhub.hub.link.lockstep import HubLink
from brickhub.robot import Robot

_Log = TypeVar("_Log")
_FORMAT = 1
_REST_STEPS = 16
"""Commands of rest, at the start."""
_RUN_STEPS = 16
"""Commands of a run at full speed in one direction."""
_RUN_SHARE = 0.6
"""Share of the runs among all commands that move anything."""


@dataclass(frozen=True)
class RunLog:
    """A recorded run of ``n`` commands.

    Attributes:
        robot: name of the robot.
        program_hash: hash of the program on its hub.
        commands: ``[n, n_commands]``, in the commands' units.
        gaps_ms: ``[n]``; host's time between an answer and the next command.
        times_ms: ``[n + 1]``; the hub's clock at each answer, including the one before the first
            command.
        channels: ``[n + 1, n_channels]``, in the channels' units.
    """

    robot: str
    interface: Interface
    program_hash: int
    commands: NDArray[np.float64]
    gaps_ms: NDArray[np.float64]
    times_ms: NDArray[np.int64]
    channels: NDArray[np.float64]


def record(
    link: HubLink,
    robot: Robot,
    interface: Interface,
    commands: Iterable[Sequence[float]],
) -> RunLog:
    """Record a robot that carries out commands one by one. Raises HubError if the link failed.

    Args:
        link: open link to its hub.
    """
    answers = [link.read()]
    sent = []
    gaps_ms = []
    for command in commands:
        answer = link.act(command)
        # The hub's clock between two answers covers the exchange itself and then the time that the
        # host took.
        passed_ms = answer.hub_time_ms - answers[-1].hub_time_ms
        idle_ms = passed_ms - answer.round_trip_s * 1000
        gaps_ms.append(max(0.0, idle_ms))
        sent.append([float(value) for value in command])
        answers.append(answer)
    return RunLog(
        robot=robot.name,
        interface=interface,
        program_hash=link.program.hash,
        # The shape is given, so that a log without commands still has its columns.
        commands=np.array(sent).reshape(-1, len(interface.commands)),
        gaps_ms=np.array(gaps_ms),
        times_ms=np.array([answer.hub_time_ms for answer in answers]),
        channels=np.array([answer.values for answer in answers], dtype=np.float64),
    )


def identification_commands(
    interface: Interface,
    steps: int,
    rng: np.random.Generator,
) -> NDArray[np.float64]:
    """Excitation commands for system identification; ``[steps, n_commands]``.

    Rest identifies sensor noise. Jerks of all strengths identify masses, friction and backlash.
    Runs at full speed identify the battery, because only there the firmware's controller cannot
    compensate for it. Each motion is followed by its reverse, so that a vehicle stays roughly in
    place.
    """
    width = len(interface.commands)
    # Commands are first shares of their ranges, -1 to 1.
    shares = np.zeros((steps, width))
    moving = shares[_REST_STEPS:]
    round_trip_steps = 2 * _RUN_STEPS
    round_trips = round(_RUN_SHARE * len(moving) / round_trip_steps)
    run_steps = round_trips * round_trip_steps

    # Jerks of all strengths come first, each followed by its reverse. Cubing the strengths makes
    # most of them weak.
    jerks = max(0, len(moving) - run_steps) // 2
    strengths = rng.uniform(-1.0, 1.0, (jerks, width)) ** 3
    moving[: 2 * jerks : 2] = strengths
    moving[1 : 2 * jerks : 2] = -strengths

    # Each run is followed by a run back, so that the robot stays roughly in place.
    first_run = len(moving) - run_steps
    for start in range(first_run, len(moving), round_trip_steps):
        back = start + _RUN_STEPS
        signs = rng.choice([-1.0, 1.0], width)
        moving[start:back] = signs
        moving[back : back + _RUN_STEPS] = -signs

    lows = np.array([command.low for command in interface.commands])
    highs = np.array([command.high for command in interface.commands])
    # A range need not be symmetrical, so its two sides are scaled apart.
    scaled = np.where(shares > 0, shares * highs, -shares * lows)
    values: NDArray[np.float64] = np.round(scaled)
    return values


def write_log(path: Path, log: RunLog) -> None:
    """Write a log to a file, replacing an existing one; its folder is created. Raises WriteError if
    that is impossible."""
    header = {
        "bricksrl_log": _FORMAT,
        "robot": log.robot,
        "program": f"{log.program_hash:08x}",
        "commands": [_describe(command) for command in log.interface.commands],
        "channels": [_describe(channel) for channel in log.interface.channels],
        "settle": _describe(log.interface.settle),
    }
    # The first answer is to a reading, so it has no command.
    first: dict[str, Any] = {
        "time_ms": int(log.times_ms[0]),
        "channels": log.channels[0].tolist(),
    }
    lines: list[dict[str, Any]] = [header, first]
    steps = zip(
        log.commands,
        log.gaps_ms,
        log.times_ms[1:],
        log.channels[1:],
        strict=True,
    )
    for command, gap_ms, time_ms, channels in steps:
        lines.append(
            {
                "time_ms": int(time_ms),
                "gap_ms": round(float(gap_ms), 3),
                "command": command.tolist(),
                "channels": channels.tolist(),
            }
        )
    write_lines(path, lines)


def read_log(path: Path) -> RunLog:
    """Read a log. Raises TwinError if the file cannot be read, or is no motion log."""
    return read_lines(path, _log, "bricktwin twin record")


def _log(header: dict[str, Any], lines: list[dict[str, Any]]) -> RunLog:
    """The log of a file; a file of another kind raises what its content causes."""
    if header["bricksrl_log"] != _FORMAT:
        raise DescriptionError(f"format {header['bricksrl_log']!s:.40} is unknown")
    commands = tuple(_part(part) for part in header["commands"])
    channels = tuple(_part(part) for part in header["channels"])
    times_ms = np.array([line["time_ms"] for line in lines])
    # The type is checked first, because other things than numbers have no differences.
    if times_ms.dtype != np.int64 or (np.diff(times_ms) < 0).any():
        raise DescriptionError("its times are not whole numbers that increase")
    # The first line has no command, so steps begin at the second.
    steps = lines[1:]
    return RunLog(
        robot=str(header["robot"]),
        interface=Interface(commands, channels, _part(header["settle"])),
        program_hash=int(header["program"], 16),
        commands=_table(steps, "command", len(commands)),
        gaps_ms=_table(steps, "gap_ms", 1)[:, 0],
        times_ms=times_ms,
        channels=_table(lines, "channels", len(channels)),
    )


def _table(
    lines: list[dict[str, Any]],
    name: str,
    columns: int,
) -> NDArray[np.float64]:
    """Numbers [lines, columns]."""
    values = np.array([line[name] for line in lines], dtype=np.float64)
    table = values.reshape(len(lines), columns)
    if not np.isfinite(table).all():
        raise DescriptionError(f"a number as {name} is missing")
    return table


def _describe(part: Command | Channel | Wait | UntilDone) -> dict[str, Any]:
    """A command, channel or settling, in JSON."""
    return {"kind": type(part).__name__, **dataclasses.asdict(part)}


def _part(data: dict[str, Any]) -> Any:
    """Command, channel or settling from its description. Raises DescriptionError if there is no
    such one."""
    fields: dict[str, Any] = {}
    for name, value in data.items():
        # JSON has no tuples, and frozen values have no lists.
        fields[name] = tuple(value) if isinstance(value, list) else value
    wanted = fields.pop("kind", None)
    kinds: list[Any] = [Command, Channel, Wait, UntilDone]
    # The list grows while it is read, by all subclasses including a user's.
    for kind in kinds:
        kinds += kind.__subclasses__()
    named = [kind for kind in kinds if kind.__name__ == wanted and not inspect.isabstract(kind)]
    if not named:
        raise DescriptionError(f"there is no command or channel {wanted!r}")
    # Subclasses come after their bases, so the last kind of a name is the most special one.
    kind = named[-1]
    # A user's annotations may name what only a type checker imports.
    with contextlib.suppress(NameError):
        check_fields(kind, fields)
    return kind(**fields)


def write_lines(path: Path, lines: Iterable[dict[str, Any]]) -> None:
    """Write a log, replacing an existing one; its folder is created. Raises WriteError if that is
    impossible."""
    text = "".join(json.dumps(line) + "\n" for line in lines)
    write_durably(path, text.encode())


def read_lines(
    path: Path,
    make: Callable[[dict[str, Any], list[dict[str, Any]]], _Log],
    writer: str,
) -> _Log:
    """What is made of the header and the other lines of a file. Raises TwinError if the file cannot
    be read, or is no such log.

    Args:
        make: may raise what the content of another file causes, and DescriptionError with what is
            wrong with it.
        writer: the command that writes such files.
    """
    with reading(
        "the log",
        path,
        TwinError,
        f"give a file that `{writer}` wrote",
    ):
        header, *lines = [json.loads(line) for line in path.read_bytes().splitlines() if line]
        return make(header, lines)
