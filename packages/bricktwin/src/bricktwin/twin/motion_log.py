"""Motion logs of a robot that carries out commands, recorded on any hub and used to fit a twin.

A file has one JSON object per line: first a header with robot, interface and program, then the hub's answers, the first one to a
reading without a command. Times are those of the hub's clock, and so free of the link's jitter.
"""

from __future__ import annotations

import contextlib
import dataclasses
import inspect
import json
import re
from collections.abc import Iterable, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from brickhub.errors import DescriptionError, TwinError, counted
from brickhub.fields import check_fields
from brickhub.files import write_durably
from brickhub.hub.interface import Channel, Command, Interface, UntilDone, Wait
from brickhub.hub.link.lockstep import HubLink
from brickhub.robot import Robot

_FORMAT = 1
_LARGEST = 2.0**53
_REST_STEPS, _RUN_STEPS = 16, 16
_RUN_SHARE = 0.6


@dataclass(frozen=True)
class RunLog:
    """A recorded run of ``n`` commands.

    Attributes:
        robot: name of the robot.
        program_hash: hash of the program on its hub.
        commands: ``[n, n_commands]``, in the commands' units.
        gaps_ms: ``[n]``; host's time between an answer and the next command.
        times_ms: ``[n + 1]``; the hub's clock at each answer, including the one before the first command.
        channels: ``[n + 1, n_channels]``, in the channels' units.
    """

    robot: str
    interface: Interface
    program_hash: int
    commands: NDArray[np.float64]
    gaps_ms: NDArray[np.float64]
    times_ms: NDArray[np.int64]
    channels: NDArray[np.float64]


def record(link: HubLink, robot: Robot, interface: Interface, commands: Iterable[Sequence[float]]) -> RunLog:
    """Record a robot that carries out commands one by one. Raises HubError if the link failed.

    Args:
        link: open link to its hub.
    """
    first = link.read()
    rows, answers, gaps_ms = [], [first], []
    for row in commands:
        answer = link.act(row)
        idle_ms = answer.hub_time_ms - answers[-1].hub_time_ms - answer.round_trip_s * 1000
        gaps_ms.append(max(0.0, idle_ms))
        rows.append([float(value) for value in row])
        answers.append(answer)
    return RunLog(
        robot.name,
        interface,
        link.program.hash,
        np.array(rows).reshape(-1, len(interface.commands)),
        np.array(gaps_ms),
        np.array([answer.hub_time_ms for answer in answers]),
        np.array([answer.values for answer in answers], dtype=np.float64),
    )


def identification_commands(interface: Interface, steps: int, rng: np.random.Generator) -> NDArray[np.float64]:
    """Excitation commands for system identification; ``[steps, n_commands]``.

    Rest identifies sensor noise. Jerks of all strengths identify masses, friction and backlash. Runs at full speed identify the
    battery, because only there the firmware's controller cannot compensate for it. Each motion is followed by its reverse, so
    that a vehicle stays roughly in place.
    """
    shares = np.zeros((steps, len(interface.commands)))
    moving = shares[_REST_STEPS:]
    round_trip_steps = 2 * _RUN_STEPS
    run_steps = round(_RUN_SHARE * len(moving) / round_trip_steps) * round_trip_steps
    jerks = max(0, len(moving) - run_steps) // 2
    moving[: 2 * jerks : 2] = rng.uniform(-1.0, 1.0, (jerks, moving.shape[1])) ** 3
    moving[1 : 2 * jerks : 2] = -moving[: 2 * jerks : 2]
    for start in range(len(moving) - run_steps, len(moving), round_trip_steps):
        signs = rng.choice([-1.0, 1.0], moving.shape[1])
        moving[start : start + _RUN_STEPS] = signs
        moving[start + _RUN_STEPS : start + 2 * _RUN_STEPS] = -signs
    low, high = np.array([(command.low, command.high) for command in interface.commands]).reshape(-1, 2).T
    values: NDArray[np.float64] = np.round(np.where(shares > 0, shares * high, -shares * low))
    return values


def write_log(path: Path, log: RunLog) -> None:
    """Write a log to a file, replacing an existing one; its folder is created. Raises WriteError if that is impossible."""
    header = {
        "bricksrl_log": _FORMAT,
        "robot": log.robot,
        "program": f"{log.program_hash:08x}",
        "commands": [_describe(command) for command in log.interface.commands],
        "channels": [_describe(channel) for channel in log.interface.channels],
        "settle": _describe(log.interface.settle),
    }
    lines = [header, {"time_ms": int(log.times_ms[0]), "channels": log.channels[0].tolist()}]
    for command, gap_ms, time_ms, channels in zip(log.commands, log.gaps_ms, log.times_ms[1:], log.channels[1:], strict=True):
        lines.append(
            {
                "time_ms": int(time_ms),
                "gap_ms": round(float(gap_ms), 3),
                "command": command.tolist(),
                "channels": channels.tolist(),
            }
        )
    write_durably(path, "".join(json.dumps(line) + "\n" for line in lines).encode())


def read_log(path: Path) -> RunLog:
    """Read a log. Raises TwinError if the file cannot be read, or is no motion log."""
    try:
        return _parse(path.read_bytes())
    except OSError as error:
        reason = error.strerror
    except DescriptionError as error:
        reason = str(error)
    raise TwinError(f"cannot read the log {path} ({reason}); give a file that `bricktwin twin record` wrote")


def _parse(data: bytes) -> RunLog:
    """Log in the content of a file. Raises DescriptionError if it is no motion log."""
    lines: dict[int, dict[str, Any]] = {}
    for number, line in enumerate(data.splitlines(), 1):
        if line:
            with contextlib.suppress(ValueError, RecursionError):
                lines[number] = json.loads(line)
            _require(isinstance(lines.get(number), dict), f"line {number} is not a table of names and values")
    _require(len(lines) >= 2, "it has no header and no readings")
    header_number, *numbers = lines
    header = lines.pop(header_number)
    _require("bricksrl_log" in header, "it has no header")
    _require(header["bricksrl_log"] == _FORMAT, f"format {header['bricksrl_log']!s:.40} is unknown")
    robot, program = header.get("robot"), header.get("program")
    _require(isinstance(robot, str), "the header's robot is not a text")
    is_hash = isinstance(program, str) and re.fullmatch("[0-9a-fA-F]{1,8}", program) is not None
    _require(is_hash, "the header's program is not a hash")
    interface = Interface(_parts(header, "commands"), _parts(header, "channels"), _make(header.get("settle"), "settle"))
    times_ms: list[int] = []
    for number in numbers:
        time_ms: Any = lines[number].get("time_ms")
        _require(isinstance(time_ms, int) and _is_number(time_ms), f"line {number} has no whole number as time_ms")
        times_ms.append(time_ms)
    for number, time_ms, before_ms in zip(numbers[1:], times_ms[1:], times_ms, strict=False):
        _require(time_ms >= before_ms, f"time runs backwards in line {number}")
    commands = [_numbers(lines[number], "command", number, len(interface.commands)) for number in numbers[1:]]
    gaps_ms: list[float] = []
    for number in numbers[1:]:
        gap_ms: Any = lines[number].get("gap_ms")
        _require(_is_number(gap_ms) and gap_ms >= 0, f"line {number} has no gap_ms of 0 or more")
        gaps_ms.append(float(gap_ms))
    channels = [_numbers(lines[number], "channels", number, len(interface.channels)) for number in numbers]
    return RunLog(
        str(robot),
        interface,
        int(str(program), 16),
        np.array(commands, dtype=np.float64).reshape(len(commands), len(interface.commands)),
        np.array(gaps_ms, dtype=np.float64),
        np.array(times_ms, dtype=np.int64),
        np.array(channels, dtype=np.float64).reshape(len(channels), len(interface.channels)),
    )


def _require(is_met: bool, fault: str) -> None:
    if not is_met:
        raise DescriptionError(fault)


def _numbers(line: dict[str, Any], name: str, number: int, count: int) -> list[float]:
    values: Any = line.get(name)
    is_complete = isinstance(values, list) and len(values) == count and all(map(_is_number, values))
    _require(is_complete, f"line {number} has no {counted(count, 'number')} as {name}")
    return [float(value) for value in values]


def _is_number(value: object) -> bool:
    """Whether a value is a number that a float represents, to the next whole one."""
    return isinstance(value, int | float) and not isinstance(value, bool) and -_LARGEST < value < _LARGEST


def _describe(part: Command | Channel | Wait | UntilDone) -> dict[str, Any]:
    return {"kind": type(part).__name__, **dataclasses.asdict(part)}


def _parts(header: dict[str, Any], name: str) -> tuple[Any, ...]:
    parts: Any = header.get(name)
    _require(isinstance(parts, list), f"the header's {name} are not a list")
    return tuple(_make(part, name) for part in parts)


def _make(data: object, name: str) -> Any:
    """Command, channel or settling from its description. Raises DescriptionError if there is no such one."""
    if not isinstance(data, dict):
        raise DescriptionError(f"the header's {name} is not a table of names and values")
    fields = {key: tuple(value) if isinstance(value, list) else value for key, value in data.items()}
    named, kinds = fields.pop("kind", None), [Command, Channel, Wait, UntilDone]
    for kind in kinds:  # the list grows by all subclasses, including the user's
        kinds += kind.__subclasses__()
    kinds = [kind for kind in kinds if kind.__name__ == named and not inspect.isabstract(kind)]
    if not kinds:
        raise DescriptionError(f"there is no command or channel {data.get('kind')!r}")
    with contextlib.suppress(NameError):  # annotations of a user's kind may name what only its type checker imports
        check_fields(kinds[-1], fields)
    try:
        return kinds[-1](**fields)
    except TypeError:
        raise DescriptionError(f"{named} cannot be made of {', '.join(fields)}") from None
