"""``bricktwin twin``: measure a robot, record its motion, and fit its twin to it."""

from __future__ import annotations

import platform
import sys
import threading
from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING, Annotated

from tyro.conf import Positional

from brickhub.cli.terminal import confirm, print_line, print_note
from brickhub.errors import TwinError, counted
from brickhub.fields import Count
from brickhub.files import check_writable
from brickhub.options import Existing, Flag, Seed, existing_file, option
from brickhub.target import find, whole_interface
from brickhub.user_files import check_there
from bricktwin import robots
from bricktwin.twin.physics import (
    FITTED,
    PARAMETERS,
    PHYSICS_REMEDY,
    Physics,
    read_physics,
    write_physics,
)

if TYPE_CHECKING:
    from brickhub.hub.interface import Interface
    from brickhub.hub.link.lockstep import HubLink
    from brickhub.hub.transport import Transport
    from brickhub.robot import Robot
    from bricktwin.measure.hands import Deed, Person
    from bricktwin.twin.scene import Scene
    from bricktwin.twin.system_id import FittedPhysics


_PHYSICS = existing_file("the physics in", TwinError, PHYSICS_REMEDY)


@dataclass(frozen=True)
class RecordMotion:
    """Record a robot's motion under identification commands, for `bricktwin twin fit`.

    It needs a metre of free floor: it stands still for a second, jerks, then runs at full speed,
    about ten seconds in all. Ctrl-C stops it.

    Examples:
      bricktwin twin record two-wheeler --out robot.jsonl
      bricktwin twin record two-wheeler --hub ble --out robot.jsonl
      bricktwin twin record walker --steps 200 --out walker.jsonl
      bricktwin twin record my_robot.py --out robot.jsonl
    """

    robot: Annotated[Positional[str], option(metavar="ROBOT"), Existing(check_there)]
    """Robot: two-wheeler, walker, robo-arm or bench; my_robot.ldr; my_robot.py; with bricksrl an
    environment, for its robot."""
    out: Annotated[Path, option(metavar="FILE")]
    """File to write."""
    hub: Annotated[str, option(metavar="HUB")] = "virtual"
    """How to reach the robot: virtual, ble, ble:NAME, ble:ADDRESS, usb or usb:PORT."""
    yes: Flag = False
    """Let a real robot move without asking."""
    steps: Annotated[Count, option(metavar="N")] = 160
    """Commands, at some 13 per second."""
    seed: Seed = 0
    """Seed of the commands."""
    physics: Annotated[Path | None, option(metavar="FILE"), _PHYSICS] = None
    """Physics of a virtual robot: a JSON file such as a fit of the twin writes."""

    def execute(self) -> None:
        import numpy as np

        from bricktwin.twin.motion_log import identification_commands, record, write_log

        check_writable(self.out)
        target = find(self.robot)
        robot = target.robot
        scene = target.scene
        interface = whole_interface(robot)
        commands = identification_commands(interface, self.steps, np.random.default_rng(self.seed))
        with self._link(robot, _bench_scene(scene), interface) as link:
            log = record(link, robot, interface, commands)
        write_log(self.out, log)
        seconds = (log.times_ms[-1] - log.times_ms[0]) / 1000
        print_line(
            f"{counted(len(log.commands), 'command')} in {seconds:.1f} s of {robot.name}: "
            f"{self.out}"
        )

    def _link(
        self,
        robot: Robot,
        scene: Scene | None,
        interface: Interface,
    ) -> HubLink:
        """An unopened link to the robot; asks the user before a real one may move."""
        from brickhub.hub.diagnostics.calibration import calibration_of
        from brickhub.hub.link.lockstep import HubLink
        from brickhub.virtual.virtual_transport import VirtualHub
        from bricktwin.twin.make_body import make_body

        transport, physics = _hub(self.hub, self.physics)
        if transport is None:
            body = make_body(
                robot,
                scene=scene,
                physics=physics,
                seed=self.seed,
            )
            return HubLink(VirtualHub(body), robot, interface)
        question = f"The {robot.name} needs a metre of room to move at full speed. Move it now?"
        if not (self.yes or confirm(question)):
            raise TwinError(
                f"nobody said that the {robot.name} may move; answer y in a terminal, or give --yes"
            )
        return HubLink(
            transport,
            robot,
            interface,
            calibrate=calibration_of(transport),
        )


def _hub(name: str, physics: Path | None) -> tuple[Transport | None, Physics | None]:
    """An unopened transport to a real robot, or ``None`` and the physics of a virtual one, if a
    file has them."""
    from brickhub.hub.transports.address import parse_hub

    address = parse_hub(name)
    if address.is_virtual:
        return None, None if physics is None else read_physics(physics)
    if physics is not None:
        raise TwinError("a real robot has its own physics; omit --physics")
    return address.transport(), None


@dataclass(frozen=True)
class Measure:
    """Measure a robot in two minutes, by hand: link, gyroscope, accelerometer, motors, ultrasonic
    sensor.

    It says what to do, and goes on when you press Enter. It needs a level table, a straight edge
    and a bare wall. The folder gets the log, a report beside the twin, and the physics of the twin
    fitted to the robot. Virtual robots are handled by nobody.

    Examples:
      bricktwin twin measure two-wheeler --hub ble --out measured
      bricktwin twin measure walker --out measured
    """

    robot: Annotated[Positional[str], option(metavar="ROBOT"), Existing(check_there)]
    """Robot: two-wheeler, walker, robo-arm or bench; my_robot.ldr; my_robot.py; with bricksrl an
    environment, for its robot."""
    out: Annotated[Path, option(metavar="DIR")]
    """Folder to write log.jsonl, report.html and physics.json to."""
    hub: Annotated[str, option(metavar="HUB")] = "virtual"
    """How to reach the robot: virtual, ble, ble:NAME, ble:ADDRESS, usb or usb:PORT."""
    seed: Seed = 0
    """Seed of a virtual robot's noise and hands."""
    physics: Annotated[Path | None, option(metavar="FILE"), _PHYSICS] = None
    """Physics of a virtual robot: a JSON file such as a fit of the twin writes."""

    def execute(self) -> None:
        from bricktwin.measure.report import HEAD, lines, write_report
        from bricktwin.measure.results import compare
        from bricktwin.measure.session import measure, write_log

        robot = find(self.robot).robot
        check_writable(self.out / "log.jsonl")
        transport, person = self._link_to(robot)
        about = {"hub": self.hub.partition(":")[0], "computer": platform.platform(terse=True)}
        log = measure(transport, robot, person, about)
        write_log(self.out / "log.jsonl", log)
        comparison = compare(log, robot)
        write_report(self.out / "report.html", log, comparison)
        write_physics(self.out / "physics.json", comparison.fitted())
        for name, value, twin, drawn, remark in (HEAD, *lines(comparison)):
            print_line(f"{name:36}{value:>10}{twin:>10}   {drawn:22}{remark}".rstrip())
        print_line(f"{self.out}: report.html, physics.json, log.jsonl")

    def _link_to(self, robot: Robot) -> tuple[Transport, Person]:
        """A transport to the robot, and who handles it."""
        import numpy as np

        from bricktwin.measure.hands import SimulatedPerson
        from bricktwin.measure.results import virtual

        transport, physics = _hub(self.hub, self.physics)
        if transport is not None:
            return transport, _Reader()
        hub = virtual(robot, physics or Physics(), self.seed)
        return hub, SimulatedPerson(hub, np.random.default_rng(self.seed))


class _Reader:
    """The person at the terminal, who reads what to do and presses Enter when it is done."""

    def begin(self, deed: Deed) -> None:
        print_note(f"{deed.text} Then press Enter.")
        self._answer: str | None = None
        # A thread waits for the line, because the robot is read while the person is busy.
        threading.Thread(target=self._wait, daemon=True).start()

    def is_done(self) -> bool:
        # A line has at least its end, so an empty text is the end of the input.
        if self._answer == "":
            raise TwinError(
                "nobody is there to handle the robot: standard input ended; run it in a terminal"
            )
        return self._answer is not None

    def _wait(self) -> None:
        self._answer = "" if sys.stdin is None else sys.stdin.readline()


@dataclass(frozen=True)
class FitTwin:
    """Fit the physics of a twin to a recorded motion, and print the twin's error before and after.

    Takes about two minutes for ten seconds of log. Use the result with `bricksrl train ENV
    --physics FILE`.

    Examples:
      bricktwin twin fit robot.jsonl
      bricktwin twin fit robot.jsonl --out robot.json
      bricktwin twin fit robot.jsonl --robot my_robot.py
    """

    log: Annotated[
        Positional[Path],
        option(metavar="LOG"),
        existing_file("the log", TwinError, "give a file that `bricktwin twin record` wrote"),
    ]
    """File with a recorded motion."""
    robot: Annotated[str | None, option(metavar="ROBOT"), Existing(check_there)] = None
    """Robot: as when it was recorded; by default the built-in one that the log names."""
    parameters: Annotated[tuple[str, ...], option(metavar="NAME")] = FITTED
    """Parameters to fit; leave out those that you know."""
    out: Annotated[Path | None, option(metavar="FILE")] = None
    """File for the physics; by default the log's name with the suffix .physics.json."""

    def execute(self) -> None:
        from bricktwin.twin.motion_log import read_log
        from bricktwin.twin.system_id import fit

        def report(replay: int, error: float) -> None:
            _show_progress(f"replay {replay}, error {error:.3g} ")

        log = read_log(self.log)
        if self.robot is None and log.robot not in robots.ROBOTS:
            raise TwinError(
                f"{self.log} is of the robot '{log.robot}', which is not built in; name its file, "
                "such as --robot my_robot.py"
            )
        target = find(self.robot or log.robot)
        robot = target.robot
        scene = target.scene
        out = self.out or self.log.with_suffix(".physics.json")
        # This is checked before two minutes of work, not after them.
        check_writable(out)
        result = fit(
            log,
            robot=robot,
            scene=_bench_scene(scene),
            names=self.parameters,
            on_replay=report,
        )
        _show_progress("")
        write_physics(out, result.physics)
        _print(result)
        print_line(f"physics  {out}")


def _bench_scene(scene: Scene | None) -> Scene | None:
    """What a task's scene says of a robot on the bench; a robot with a body is recorded on an open
    floor."""
    from bricktwin.twin.scene import Scene

    if scene is None or not (scene.readings or scene.end_stops):
        return None
    return Scene(readings=scene.readings, end_stops=scene.end_stops)


def _print(result: FittedPhysics) -> None:
    """Print the errors of the twin, and the parameters that are not the defaults."""
    print_line("error of the twin (root mean square)")
    for name, before in result.error_before.items():
        print_line(f"  {name:24}{before:8.3g} -> {result.error_after[name]:.3g}")
    print_line("parameters")
    default = Physics()
    for name, parameter in PARAMETERS.items():
        value = getattr(result.physics, name)
        before = getattr(default, name)
        if name in result.identified or value != before:
            unit = parameter.unit.removesuffix("1")
            line = f"  {name:24}{before:8.3g} -> {value:.3g} {unit}"
            print_line(line.rstrip())
    for name in result.unidentified:
        print_line(f"  {name:24}{getattr(default, name):8.3g}    not identifiable from this log")


_PROGRESS_COLUMNS = 40


def _show_progress(text: str) -> None:
    """Overwrite the line of progress on a terminal, also on one of Windows, which knows no escape
    sequences; clear it with an empty text."""
    if sys.stderr.isatty():
        sys.stderr.write(f"\r{'':{_PROGRESS_COLUMNS}}\r{text}")
        sys.stderr.flush()
