"""``brickhub run``: programs on a hub, virtual or real."""

from __future__ import annotations

import io
import sys
from collections.abc import Callable, Sequence
from contextlib import ExitStack, closing
from dataclasses import dataclass, replace
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, BinaryIO, ClassVar, TextIO, cast

from tyro.conf import Positional, UseAppendAction

from brickhub.cli.terminal import Interrupted, print_note
from brickhub.errors import DescriptionError, counted
from brickhub.options import Existing, Faults, Flag, changed_options, option
from brickhub.robot.hardware import USUAL_HUB_NAME
from brickhub.user_files import check_there

if TYPE_CHECKING:
    from brickhub.target import Target
    from brickhub.virtual.body import Body
    from brickhub.virtual.machine import Machine
    from brickhub.virtual.panel import Panel
    from brickhub.virtual.room import Room
    from brickhub.virtual.run import Operation


@dataclass(frozen=True)
class Run:
    """Run a Pybricks program on a hub, virtual or real, and print its output and traceback; exit
    code 1 if it raises, 124 at the time limit.

    Files that it imports from its folder are included; those that it writes, as `motor.log.save`
    does, are saved beside it. The program can read standard input. Ctrl-C stops it and its motors.
    A program that imports LEGO's package `legoeducation` runs on this computer, and drives virtual
    devices of LEGO's kits.

    Without --robot, the virtual hub adapts to the program: its kind is the one that the program
    imports, and each port has the device that the program expects there.

    Examples:
      brickhub run main.py
      brickhub run main.py --reading B=red --reading C=200mm --press left@2.5s
      brickhub run main.py --realtime --panel
      brickhub run main.py --robot my_robot.py --time-limit-s 60
      brickhub run main.py --log run.csv
      brickhub run left.py right.py
      brickhub run main.py --hub ble
    """

    file: Annotated[Positional[Path], option(metavar="FILE")]
    """Pybricks program."""
    others: Annotated[Positional[tuple[Path, ...]], option(metavar="FILE")] = ()
    """More programs, if there are any: each on a hub of its own in the same room, where hubs hear
    one another. They have no standard input."""
    robot: Annotated[
        UseAppendAction[tuple[str, ...]], option(metavar="ROBOT"), Existing(check_there)
    ] = ()
    """Virtual robot: my_robot.py, or a name that bricktwin or bricksrl adds, such as walker or
    RunAway-v0."""
    hub: Annotated[str, option(metavar="HUB")] = "virtual"
    """Which hub: virtual, in simulated time, or ble, ble:NAME, ble:ADDRESS, usb, usb:PORT."""
    time_limit_s: Annotated[float | None, option(metavar="SECONDS")] = None
    """Stop the program after this time, with exit code 124."""
    press: Annotated[UseAppendAction[tuple[str, ...]], option(metavar="BUTTON@TIME")] = ()
    """Button press on the virtual hub: left@2.5s, center@4s+1s (held for 1 s), remote.left_plus@3s.
    May be repeated."""
    reading: Annotated[UseAppendAction[tuple[str, ...]], option(metavar="PORT=VALUE")] = ()
    """Reading of a sensor on the bench: B=red, B=40%, B=200mm, B=3N, B=10,-5deg, or B=@FILE with
    lines "seconds, value"."""
    end_stop: Annotated[UseAppendAction[tuple[str, ...]], option(metavar="PORT=LOW..HIGH")] = ()
    """End stops (deg) of a motor, at which it stalls: C=-90..120."""
    start: Annotated[UseAppendAction[tuple[str, ...]], option(metavar="PORT=ANGLE")] = ()
    """Angle (deg) at which a motor on the bench stands at first, as an absolute motor tells it:
    A=90."""
    port: Annotated[UseAppendAction[tuple[str, ...]], option(metavar="PORT=DEVICE")] = ()
    """Which motor or sensor is on a port of the bench: A=interactive, B=spike-large, C=ColorSensor,
    D=nothing, E=my_device.py:GAUGE for a device of your own. On others there is what the program
    asks for, medium motors of SPIKE."""
    storage: Annotated[Path | None, option(metavar="FILE")] = None
    """File in which the virtual hub keeps what programs store, for the next run."""
    hub_name: Annotated[str, option(metavar="NAME")] = USUAL_HUB_NAME
    """What the virtual hub is called."""
    fault: Faults = ()
    log: Annotated[Path | None, option(metavar="FILE")] = None
    """CSV file of what each motor and sensor of the virtual hub did: every 10 ms the motors' angle,
    speed, load and voltage, and what the program last read from each sensor."""
    realtime: Flag = False
    """Run a virtual hub in real time. The keys left, right, space (center) and b (bluetooth) press
    its buttons."""
    firmware: Annotated[str, option(metavar="VERSION")] = "4.1"
    """Version of Pybricks' firmware that the virtual hub plays: 4.1 or 4.0."""
    panel: Flag = False
    """Print each change of the virtual hub's light, display and loudspeaker on standard error."""

    # Options that several programs have together.
    of_a_room: ClassVar[tuple[str, ...]] = (
        "--file",
        "--others",
        "--robot",
        "--time-limit-s",
        "--realtime",
        "--firmware",
    )

    def execute(self) -> int:
        from brickhub.virtual.run import interruptible

        try:
            with interruptible():
                return self._run()
        except KeyboardInterrupt:
            saved = "there was nothing to save" if self.log is None else f"its log is in {self.log}"
            raise Interrupted(f"the program was stopped; {saved}") from None

    def _run(self) -> int:
        from brickhub.hub.program.run_program import imports, load_program
        from brickhub.hub.transports.address import parse_hub
        from brickhub.kits.radio import LEGO_PACKAGE

        # Both lines may raise, and must do so before a film begins.
        address = parse_hub(self.hub)
        program = load_program(self.file)
        is_for_kit = imports(program, LEGO_PACKAGE)
        # A program may be given bytes of any kind, so the binary stream is used.
        stdin = sys.stdin
        if isinstance(stdin, io.TextIOWrapper):
            stdin.reconfigure(errors="surrogateescape")
        if self.others:
            return self._run_in_a_room()
        if len(self.robot) > 1:
            raise DescriptionError(
                f"--robot is named {len(self.robot)} times for one program; name it once"
            )
        if address.is_virtual:
            return self._run_virtually(is_for_kit=is_for_kit)
        for name in changed_options(self):
            if name not in ("--file", "--hub", "--time-limit-s"):
                raise DescriptionError(
                    f"a real hub has its own robot, buttons and time; leave out --hub, or {name}"
                )
        from brickhub.hub.program.imported_hub import imported_hub
        from brickhub.hub.program.lego_languages import language_of
        from brickhub.hub.program.run_program import run_program

        language = language_of(program)
        if language is not None:
            raise DescriptionError(
                f"{self.file} is for {language.name}, which a hub with Pybricks does not run; "
                "without --hub each of its lines is named"
            )
        if is_for_kit:
            raise DescriptionError(
                "LEGO's devices run no programs; run it on this computer: python " + str(self.file)
            )
        transport_to_hub = address.transport(imported_hub(program))
        with ExitStack() as stack, closing(transport_to_hub) as transport:
            out = self._without_files(sys.stdout.buffer, stack)
            return run_program(
                transport,
                program,
                stdout=out,
                stderr=sys.stderr,
                stdin=stdin,
                time_limit_s=self.time_limit_s,
            )

    def _run_in_a_room(self) -> int:
        """Run several programs, each on a virtual hub of its own; the first exit code that is not
        0."""
        from brickhub.virtual.room import HubProgramFile, Room
        from brickhub.virtual.run import Operation

        for name in changed_options(self):
            if name not in self.of_a_room:
                raise DescriptionError(f"several hubs have no {name}; run one program, or omit it")
        paths = (self.file, *self.others)
        if self.robot and len(self.robot) != len(paths):
            raise DescriptionError(
                f"there are {len(paths)} programs and {counted(len(self.robot), 'robot')}; name a "
                "robot for each program, in their order, or none"
            )
        operation = Operation(realtime=self.realtime, firmware=self.firmware)
        with ExitStack() as stack:
            bodies = self.bodies(stack)
            out, err = self.streams(stack)
            operation = replace(operation, attend=self.attend_in_room())
            programs = [
                HubProgramFile(path, body, operation)
                for path, body in zip(paths, bodies, strict=True)
            ]
            room = Room(
                programs,
                stdout=out,
                stderr=err,
                time_limit_s=self.time_limit_s,
                distance_m=self.distance_m,
            )
            self.settle_in(room)
            codes = room.run()
        return next((code for code in codes if code), 0)

    def bodies(self, stack: ExitStack) -> Sequence[Body | None]:
        """Bodies of the robots of several programs; ``None`` for a bench. ``stack`` closes what
        they need. Raises DescriptionError for a robot, as nothing here has a body."""
        if self.robot:
            raise DescriptionError(
                "robots that share a world need bodies: use bricktwin run; or omit --robot"
            )
        return [None] * (1 + len(self.others))

    def distance_m(self, one: int, other: int) -> float:
        """Distance of two hubs of several, by number."""
        from brickhub.virtual.room import on_benches_m

        return on_benches_m(one, other)

    def attend_in_room(self) -> Callable[[Machine], None] | None:
        """Function that gets each of several virtual hubs before its program begins."""
        return None

    def settle_in(self, room: Room) -> None:
        """Called with the room before its programs run."""

    def _run_virtually(self, *, is_for_kit: bool) -> int:
        from brickhub.kits.kit_run import run_kit_file
        from brickhub.virtual.run import run_file

        stdin = sys.stdin
        source = None if stdin is None or stdin.isatty() else stdin
        with ExitStack() as stack:
            out, err = self.streams(stack)
            body = self.body(stack)
            operation = self._operation(stack, body)
            if is_for_kit:
                return run_kit_file(
                    self.file,
                    body,
                    stderr=err,
                    time_limit_s=self.time_limit_s,
                    operation=operation,
                )
            return run_file(
                self.file,
                body,
                stdout=self._without_files(out, stack),
                stderr=err,
                stdin=source,
                time_limit_s=self.time_limit_s,
                operation=operation,
            )

    def _without_files(
        self,
        out: BinaryIO,
        stack: ExitStack,
    ) -> BinaryIO:
        """A stream for the program's output, which saves the files in it beside the program and
        writes all else to ``out``."""
        from brickhub.hub.program.program_files import ProgramFiles

        files = ProgramFiles(out, self.file.absolute().parent, print_note)
        stack.callback(files.close)
        return cast("BinaryIO", files)

    def body(self, stack: ExitStack) -> Body | None:
        """Body of the virtual robot; ``None`` for the bench that adapts to the program. ``stack``
        closes what it needs."""
        if not self.robot:
            return self.faulty(None)
        from brickhub.robot import BENCH

        target = self.target(self.robot[0])
        if target.robot is BENCH:
            return self.faulty(None)
        return self.faulty(target.make_body(**self.stops_of(target)))

    def stops_of(self, target: Target) -> dict[str, dict[str, tuple[float, float]]]:
        """Arguments of `make_body` with the end stops that are given, by name of the motor, deg of
        the output."""
        from brickhub.virtual.given_readings import end_stops_of

        stops = end_stops_of(target.robot, self.end_stop)
        return {"end_stops": stops} if stops else {}

    def target(self, name: str) -> Target:
        """The robot of that name; says what a person should know of it."""
        from brickhub.target import find

        target = find(name)
        if target.note:
            print_note(target.note)
        return target

    def faulty(self, body: Body | None) -> Body | None:
        """The body with the faults of ``--fault``."""
        from brickhub.virtual.faults import parse_fault, with_faults

        if any(parse_fault(text).kind == "link" for text in self.fault):
            raise DescriptionError(
                "a program of one's own runs without a link; leave out --fault link, or practise "
                "with `check`"
            )
        if body is None and self.fault:
            raise DescriptionError(
                "faults are those of a robot; name one with --robot, or say what is on a port "
                "with --port"
            )
        return None if body is None else with_faults(body, self.fault)

    def streams(self, stack: ExitStack) -> tuple[BinaryIO, TextIO]:
        """Streams for what the program prints, and for its traceback; ``stack`` closes what they
        need."""
        return sys.stdout.buffer, sys.stderr

    def attend(self, stack: ExitStack) -> Callable[[Machine], None] | None:
        """Function that is given the machine before the program starts; ``stack`` closes what it
        needs."""
        return None

    def _operation(
        self,
        stack: ExitStack,
        body: Body | None,
    ) -> Operation:
        """The deeds of a person, and the end stops if there is no body that has them."""
        from brickhub.cli.key_listener import can_listen, keys_heard
        from brickhub.user_devices import is_own_device, load_own_device
        from brickhub.virtual.given_readings import (
            by_port,
            parse_device,
            parse_end_stop,
            parse_reading,
            parse_start,
            port_of,
        )
        from brickhub.virtual.panel import parse_press
        from brickhub.virtual.run import Operation

        listens = self.realtime and can_listen()

        def watch(panel: Panel) -> None:
            def press(key: str) -> None:
                button = _KEYS.get(key)
                # Not every hub has every button.
                if button in panel.buttons:
                    panel.tap(button)

            if listens:
                panel.is_watched = True
                stack.enter_context(keys_heard(press))
            if self.panel:
                panel.on_change = _print_panel

        devices = by_port("--port", ((port_of(text), text) for text in self.port)).values()
        own = [text for text in devices if is_own_device(text)]
        # A body already has its stops (see `stops_of`).
        stops = self.end_stop if body is None else ()
        return Operation(
            presses=[parse_press(text) for text in self.press],
            readings=[parse_reading(text) for text in self.reading],
            end_stops=by_port("--end-stop", map(parse_end_stop, stops)),
            starts=by_port("--start", map(parse_start, self.start)),
            devices=dict(parse_device(text) for text in devices if text not in own),
            own_devices=dict(map(load_own_device, own)),
            hub_name=self.hub_name,
            storage=self.storage,
            realtime=self.realtime,
            firmware=self.firmware,
            watch=watch,
            attend=self._logged(stack),
        )

    def _logged(self, stack: ExitStack) -> Callable[[Machine], None] | None:
        """`attend`, with the log of the run, which is written however the run ends."""
        path = self.log
        attend = self.attend(stack)
        if path is None:
            return attend
        from brickhub.files import check_writable, write_durably
        from brickhub.virtual.run_log import RunLog

        # This is checked before the run, which may take long and whose log would then be lost.
        check_writable(path)

        def begin(machine: Machine) -> None:
            machine.log = log = RunLog()
            stack.callback(lambda: write_durably(path, log.csv().encode()))
            if attend is not None:
                attend(machine)

        return begin


def _print_panel(panel: Panel) -> None:
    print_note(f"{panel.now_s:9.3f} s  {panel.describe()}")


_KEYS = {
    "left": "left",
    "right": "right",
    " ": "center",
    "c-m": "center",
    "b": "bluetooth",
}
"""Buttons of a hub by the names of keys; ``c-m`` is Enter."""
