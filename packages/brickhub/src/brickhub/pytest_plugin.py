"""Fixture ``pybricks_hub`` of pytest: Pybricks programs on a virtual hub, in simulated time.

Every run of pytest where brickhub is installed imports this module; the virtual hub is imported by
the first test that runs one.
"""

from __future__ import annotations

import io
import sys
from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass, field
from functools import cached_property, partial
from pathlib import Path
from types import MappingProxyType
from typing import TYPE_CHECKING

import pytest

if TYPE_CHECKING:
    from brickhub.robot import Robot
    from brickhub.target import SharedWorld
    from brickhub.virtual.body import Body
    from brickhub.virtual.machine import Machine
    from brickhub.virtual.own_devices import AnyOwnDevice, OwnDeviceOf
    from brickhub.virtual.run_log import RunLog
    from brickhub.virtual.stimuli import Reading


@dataclass(frozen=True)
class ProgramRun:
    """Run of a program.

    Attributes:
        exit_code: 1 if the program raised, 124 if the time limit ended it, else 0.
        output: what it printed.
        errors: the hub's traceback, or that the program was stopped; notes of the bench.
    """

    exit_code: int
    output: str
    errors: str
    _log: RunLog = field(repr=False)

    @property
    def timed_out(self) -> bool:
        """Whether the time limit ended it: a program that never ends, or a limit that is too
        short."""
        from brickhub.hub.program.run_program import TIME_LIMIT_EXIT_CODE

        return self.exit_code == TIME_LIMIT_EXIT_CODE

    @cached_property
    def log(self) -> list[dict[str, float | str | None]]:
        """Log of the motors and sensors: a row every 10 ms by column, such as ``time_s``,
        ``A_angle_deg``, ``C_distance_mm``, as ``brickhub run --log`` writes them; ``None`` where
        there is no value yet."""
        return list(self._log.rows())


class PybricksHub:
    """Virtual hub of a test.

    Args:
        folder: where files of programs, robots and readings are named from.
        scratch: folder for programs that are given as text.
    """

    def __init__(
        self,
        folder: Path,
        scratch: Path,
    ) -> None:
        self._folder = folder
        self._scratch = scratch

    def run(
        self,
        program: str | Path,
        *,
        robot: Robot | Body | str | None = None,
        readings: Mapping[str, Reading] | Sequence[str] = (),
        end_stops: Mapping[str, tuple[float, float]] | Sequence[str] = (),
        starts: Sequence[str] = (),
        ports: Sequence[str] = (),
        own_devices: Mapping[str, AnyOwnDevice | OwnDeviceOf] = MappingProxyType({}),
        presses: Sequence[str] = (),
        stdin: str | bytes = "",
        time_limit_s: float | None = 60.0,
    ) -> ProgramRun:
        """Run a program to its end, in simulated time.

        Args:
            program: a file, named from the folder of the test, or the program's text.
            robot: ``None`` for a bench that adapts to the program; a Robot for one with its motors
                and sensors; a body; or what ``--robot`` names, such as ``walker`` or
                ``my_robot.py``.
            readings: of sensors. On the bench as on the command line, such as ``"B=red"``; of a
                Robot by name, as functions of the angles of its motors (deg, by name).
            end_stops: likewise ``"C=-90..120"``, or lowest and highest angle (deg) by name of the
                motor.
            starts: angles at which motors on the bench stand at first, such as ``"A=90"``.
            ports: motors and sensors on the bench, such as ``"A=interactive"``.
            own_devices: devices of one's own by port, on the bench or of a robot, as of
                ``brickhub.virtual.own_devices``; or functions that make one for the robot.
            presses: of buttons, such as ``"left@2.5s"``.
            stdin: what the program can read.
            time_limit_s: simulated seconds until the program is stopped; ``None`` for no limit.

        Raises:
            ProgramError: there is no such file.
            DescriptionError, TwinError: robot, readings, end stops or presses do not fit together.
        """
        from brickhub.virtual.given_readings import (
            by_port,
            parse_device,
            parse_end_stop,
            parse_reading,
            parse_start,
        )
        from brickhub.virtual.panel import parse_press
        from brickhub.virtual.run import Operation, interruptible, run_file
        from brickhub.virtual.run_log import RunLog

        log = RunLog()
        out = io.BytesIO()
        err = io.StringIO()

        def attend(machine: Machine) -> None:
            machine.log = log

        body = self._body(robot, readings, end_stops)
        # A body already has a named robot's stops, and the end stops that any body has.
        has_stops = body is not None or isinstance(end_stops, Mapping)
        texts_of_readings: Iterable[str] = () if isinstance(readings, Mapping) else readings
        texts_of_stops: Iterable[str] = () if has_stops else end_stops
        operation = Operation(
            presses=[parse_press(text) for text in presses],
            readings=[parse_reading(text, self._folder) for text in texts_of_readings],
            end_stops=by_port("end_stops", map(parse_end_stop, texts_of_stops)),
            starts=by_port("starts", map(parse_start, starts)),
            devices=by_port("ports", map(parse_device, ports)),
            own_devices=own_devices,
            attend=attend,
        )
        source = io.BytesIO(stdin) if isinstance(stdin, bytes) else io.StringIO(stdin)
        with interruptible():
            code = run_file(
                self._file(program),
                body,
                stdout=out,
                stderr=err,
                stdin=source,
                time_limit_s=time_limit_s,
                operation=operation,
            )
        return ProgramRun(
            code,
            out.getvalue().decode(errors="replace"),
            err.getvalue(),
            log,
        )

    def run_together(
        self,
        *programs: str | Path,
        robots: Sequence[str] = (),
        time_limit_s: float | None = 60.0,
    ) -> list[ProgramRun]:
        """Run several programs in one room, where the hubs hear one another.

        Args:
            programs: as of `run`.
            robots: what ``--robot`` names, for each program; they share a world. Without them each
                hub has a bench of its own.
            time_limit_s: as of `run`.

        Returns:
            What each did, in order.

        Raises:
            ProgramError, DescriptionError, TwinError: as of `run`; or robots have no bodies.
        """
        from brickhub.virtual.room import HubProgramFile, Room, on_benches_m
        from brickhub.virtual.run import Operation, interruptible
        from brickhub.virtual.run_log import RunLog

        logs = [RunLog() for _ in programs]
        outs = [io.BytesIO() for _ in programs]
        errs = [io.StringIO() for _ in programs]
        world = self._world(robots, len(programs)) if robots else None
        bodies: Sequence[Body | None] = world.bodies if world else [None] * len(programs)
        hubs = []
        for number, program in enumerate(programs):
            hubs.append(
                HubProgramFile(
                    self._file(program, f"main_{number + 1}.py"),
                    bodies[number],
                    operation=Operation(attend=partial(_keep_log, logs[number])),
                    stdout=outs[number],
                    stderr=errs[number],
                )
            )
        room = Room(
            hubs,
            stdout=sys.stdout.buffer,
            stderr=sys.stderr,
            time_limit_s=time_limit_s,
            distance_m=world.distance_m if world else on_benches_m,
        )
        if world:
            world.runners = [partial(room.run_until, number) for number in range(len(hubs))]
        with interruptible():
            codes = room.run()
        return [
            ProgramRun(code, out.getvalue().decode(errors="replace"), err.getvalue(), log)
            for code, out, err, log in zip(codes, outs, errs, logs, strict=True)
        ]

    def _body(
        self,
        robot: Robot | Body | str | None,
        readings: Mapping[str, Reading] | Sequence[str],
        end_stops: Mapping[str, tuple[float, float]] | Sequence[str],
    ) -> Body | None:
        """Body of a robot, however it is given; ``None`` for the bench that adapts to the program.
        Raises DescriptionError if the readings or end stops are not those of its kind."""
        from brickhub.errors import DescriptionError
        from brickhub.robot import BENCH, Robot
        from brickhub.target import find
        from brickhub.virtual.bench_body import BenchBody
        from brickhub.virtual.given_readings import end_stops_of

        is_described = isinstance(robot, Robot)
        for said in (readings, end_stops):
            # Something empty may be of either kind, as the defaults are.
            if said and isinstance(said, Mapping) is not is_described:
                kind = "lists of texts for the bench, such as B=red and C=-90..120"
                if is_described:
                    kind = "dicts by name for a Robot"
                raise DescriptionError(f"readings and end stops are {kind}; give such")
        if isinstance(robot, Robot):
            return BenchBody(robot, dict(readings), dict(end_stops))  # type: ignore[arg-type]
        if not isinstance(robot, str):
            return robot
        target = find(self._robot_name(robot))
        stops = end_stops_of(target.robot, end_stops)
        if target.robot is BENCH:
            return None
        return target.make_body(end_stops=stops) if stops else target.make_body()

    def _world(self, robots: Sequence[str], count: int) -> SharedWorld:
        """World of robots, one for each of so many programs. Raises DescriptionError if there are
        more or fewer, no list of names, or if robots have no bodies."""
        from brickhub.errors import DescriptionError, counted
        from brickhub.target import find

        if isinstance(robots, str) or not all(isinstance(robot, str) for robot in robots):
            raise DescriptionError(
                f"robots are {robots!r}; give a list of names, such as ['two-wheeler', 'scout']"
            )
        if len(robots) != count:
            raise DescriptionError(
                f"{counted(len(robots), 'robot')} for {count} programs; name one for each"
            )
        named = []
        for robot in robots:
            name = self._robot_name(robot)
            named.append((name, find(name)))
        _, first = named[0]
        if first.share_world is None:
            raise DescriptionError(
                "robots that share a world need bodies: install bricktwin; or name no robots"
            )
        return first.share_world(named)

    def _robot_name(self, robot: str) -> str:
        """A file beside the test, which is found wherever pytest was started; anything else is a
        name such as ``walker``."""
        file = self._folder / robot
        return str(file) if file.is_file() else robot

    def _file(self, program: str | Path, name: str = "main.py") -> Path:
        # A single line that ends like a file name is one, because no program of one line reads
        # `main.py`.
        if isinstance(program, Path) or ("\n" not in program and program.endswith(".py")):
            return self._folder / program
        path = self._scratch / name
        path.write_text(program, encoding="utf-8")
        return path


def _keep_log(log: RunLog, machine: Machine) -> None:
    """Let a machine keep its log here."""
    machine.log = log


@pytest.fixture
def pybricks_hub(request: pytest.FixtureRequest, tmp_path: Path) -> PybricksHub:
    """Virtual hub: ``run = pybricks_hub.run("main.py", readings=["B=red"])`` runs a Pybricks
    program without a hub, and has its ``exit_code``, ``output``, ``errors`` and ``log``."""
    return PybricksHub(request.path.parent, tmp_path)
