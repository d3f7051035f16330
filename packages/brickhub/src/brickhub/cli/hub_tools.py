"""Tools for a hub, real or virtual: scan, program, stop, latency, check, calibrate."""

import dataclasses
import json
from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Annotated, Any

from tyro.conf import Positional

from brickhub.cli.terminal import ask, confirm, print_findings, print_line, print_note
from brickhub.errors import DescriptionError, HubNotFoundError, counted, percent
from brickhub.fields import Count
from brickhub.files import quoted, write_durably
from brickhub.hub.diagnostics import calibration as kept
from brickhub.hub.diagnostics.calibration import (
    Calibration,
    CalibrationError,
    calibrated,
    calibration_of,
    zero_between,
)
from brickhub.hub.diagnostics.preflight import advice, check_robot, measure
from brickhub.hub.diagnostics.survey import find_stops, survey
from brickhub.hub.link.lockstep import HubLink
from brickhub.hub.link.profiles import profile
from brickhub.hub.program.generate import generate
from brickhub.hub.transport import Transport
from brickhub.hub.transports.address import parse_hub
from brickhub.hub.transports.ble import FoundHub, scan
from brickhub.hub.transports.profile import Status
from brickhub.options import (
    Existing,
    Faults,
    Flag,
    JsonFlag,
    SavesNothing,
    option,
    refuse_ignored,
)
from brickhub.robot import HubKind, Robot
from brickhub.target import Target, find
from brickhub.user_files import check_there

_SCAN_S = 5.0

Hub = Annotated[
    str,
    option(metavar="HUB", help="Which hub: ble, ble:NAME, ble:ADDRESS, usb, usb:PORT, or virtual."),
]
TargetArgument = Annotated[
    Positional[str],
    option(
        metavar="ROBOT",
        help="Robot in a file: my_robot.py or my_robot.py:ROBOT. bricktwin adds its robots, such "
        "as walker, and building plans; "
        "bricksrl adds environments, such as RunAway-v0, with their robots and commands.",
    ),
    Existing(check_there),
]
Link = Annotated[
    str | None,
    option(
        metavar="LINK",
        help="Link of the virtual hub: Bluetooth as mac, linux or bad-room, or usb, usb-quick or "
        "usb-slow; linux by default, usb for an EV3.",
    ),
]
Folder = Annotated[Path | None, option(metavar="DIR")]


@dataclass(frozen=True)
class Scan(SavesNothing):
    """List the advertising Pybricks hubs: name, address, signal, kind; or those on USB.

    A hub does not advertise while it runs a program or is connected to a computer. An EV3 is
    reached over USB only.

    Examples:
      brickhub scan
      brickhub scan --seconds 10 --json
      brickhub scan --hub usb
      brickhub scan --hub virtual
    """

    hub: Annotated[str, option(metavar="HUB")] = "ble"
    """Where to scan: ble, usb, or virtual for the virtual hub, which is always present."""
    seconds: Annotated[float, option(metavar="SECONDS")] = _SCAN_S
    """Duration of the scan."""
    json: Flag = False
    """Print only a JSON list on standard output."""

    def execute(self) -> int:
        """Scan and print; exit code 1 if no hub was found."""
        if self.hub not in ("ble", "usb", "virtual"):
            raise DescriptionError(
                f"nothing can be scanned for on '{self.hub}'; choose ble, usb or virtual"
            )
        if not 0 < self.seconds <= 600:
            raise DescriptionError(
                f"seconds is {self.seconds:g}; give a number above 0, and up to 600"
            )
        if self.hub == "virtual":
            hubs = [
                FoundHub(
                    "virtual hub",
                    "virtual",
                    0,
                    HubKind.PRIME,
                )
            ]
        elif self.hub == "usb":
            from brickhub.hub.transports.usb import list_usb_hubs

            hubs = [FoundHub(hub.device, hub.address, 0, hub.kind) for hub in list_usb_hubs()]
        else:
            hubs = scan(self.seconds)
        # JSON is read by programs, for which an empty list is a result too.
        if self.json:
            print_line(json.dumps([_hub_as_dict(hub) for hub in hubs], indent=2))
        elif hubs:
            print_line(f"{'name':16}  {'address':36}  {'signal':>8}  kind")
            for hub in hubs:
                # An advertisement may name a kind of hub that is unknown here.
                kind = hub.kind.value if hub.kind else "unknown"
                signal = "cable" if self.hub == "usb" else f"{hub.rssi_dbm:>4} dBm"
                print_line(f"{hub.name:16}  {hub.address:36}  {signal:>8}  {kind}")
        elif self.hub == "usb":
            print_line(
                "no hub of LEGO is on USB; plug it in and switch it on, with Pybricks 4.1 or later"
            )
        else:
            print_line(
                "no hub with Pybricks advertises itself; switch one on, end its program, and "
                "disconnect it elsewhere; an EV3 is found with --hub usb"
            )
        return 0 if hubs else 1


def _hub_as_dict(hub: FoundHub) -> dict[str, Any]:
    kind = None if hub.kind is None else hub.kind.value
    return {**dataclasses.asdict(hub), "kind": kind}


@dataclass(frozen=True)
class Program:
    """Print the MicroPython program that runs on a robot's hub, or write it to a file.

    Examples:
      brickhub program my_robot.py
      brickhub program my_robot.py --out hub_program.py
    """

    target: TargetArgument
    out: Annotated[Path | None, option(metavar="FILE")] = None
    """The .py file to write; by default the program is printed."""

    def execute(self) -> None:
        target = find(self.target)
        if target.note:
            print_note(target.note)
        # The text loses its line ends, because `print_line` and the file each add one.
        source = generate(target.robot, target.interface).source.rstrip("\n")
        if self.out is None:
            print_line(source)
            return
        if self.out.suffix != ".py":
            raise DescriptionError(f"'{self.out}' is not a name of a program; end it in .py")
        write_durably(self.out, f"{source}\n".encode())
        print_line(f"{counted(len(source.splitlines()), 'line')}: {self.out}")


@dataclass(frozen=True)
class Stop:
    """Stop the program on a hub at once, whoever started it, and with it the motors.

    A hub that runs a program without a connected computer cannot be reached: press its button.

    Examples:
      brickhub stop
      brickhub stop --hub ble:Rover
    """

    hub: Hub = "ble"

    def execute(self) -> None:
        address = parse_hub(self.hub)
        if address.is_virtual:
            print_line("a virtual hub lives in the command that uses it; none runs here")
            return
        transport = address.transport()
        try:
            transport.open()
            # The status is kept before the stop, which changes it.
            status = transport.status
            identity = transport.identity
            transport.stop()
        except HubNotFoundError as error:
            raise HubNotFoundError(
                f"{error}; a hub whose program runs without a computer hears only its button"
            ) from None
        finally:
            transport.close()
        ran = status is not None and Status.USER_PROGRAM_RUNNING in status.flags
        name = identity.name if identity else "the hub"
        outcome = "the program was stopped" if ran else "no program ran"
        print_line(f"{name}: {outcome}, no motor is driven")


@dataclass(frozen=True)
class MeasureLatency(SavesNothing):
    """Measure the latency of the link to a robot, without moving it.

    Examples:
      brickhub latency my_robot.py
      brickhub latency my_robot.py --hub virtual --link mac --json
    """

    target: TargetArgument
    hub: Hub = "ble"
    exchanges: Annotated[Count, option(metavar="N")] = 100
    """Number of readings to time."""
    link: Link = None
    fault: Faults = ()
    json: JsonFlag = False

    def execute(self) -> None:
        target = find(self.target)
        transport = _transport(
            self.hub,
            target,
            self.link,
            self.fault,
        )
        with HubLink(transport, target.robot, target.interface) as link:
            result = measure(link, target.interface, self.exchanges)
        if self.json:
            print_line(json.dumps(dataclasses.asdict(result)))
            return
        print_line(
            f"round trip           p50 {result.p50_ms:.1f} ms, p99 {result.p99_ms:.1f} ms, of "
            f"{self.exchanges} exchanges"
        )
        if result.link_share is not None:
            print_line(f"of a step            {percent(result.link_share)} is the link")
        # A cable has no connection interval.
        if not target.robot.hub.model.has_bluetooth:
            return
        print_line(f"connection interval  {result.interval_ms:g} ms (inferred: half a round trip)")
        if not result.is_slow:
            return
        # This advice makes sense for a real link only.
        if parse_hub(self.hub).is_virtual:
            print_line(
                "faster               as this link is played; another one with --link, such as "
                "--link mac"
            )
        else:
            print_line(f"faster               {advice()}")


@dataclass(frozen=True)
class Check(SavesNothing):
    """Check a robot before training: hub, ports, battery, IMU, angles, round trip, and the
    direction of each motor.

    Test moves need confirmation. Exit code 1 if something is wrong.

    Examples:
      brickhub check my_robot.py
      brickhub check my_robot.py --hub virtual --yes
      brickhub check my_robot.py --hub ble:Arm --json
    """

    target: TargetArgument
    hub: Hub = "ble"
    link: Link = None
    fault: Faults = ()
    yes: Flag = False
    """Make the test moves without asking for permission, or whether they were right."""
    calibrations: Folder = None
    """Folder of calibrations; by default that in your settings folder."""
    json: JsonFlag = False

    def execute(self) -> int:
        target = find(self.target)
        if not parse_hub(self.hub).is_virtual:
            print_note(f"looking for the hub ({self.hub}), which can take some seconds")

        def may_move() -> bool:
            return self.yes or confirm(
                f"The {target.robot.name} needs room to move each motor a little. Move it now?"
            )

        def was_right(move: str) -> bool | None:
            return ask(f"{move}: was it this motor, and in the right direction?")

        # With --yes nobody may be there to look at the robot, so nobody is asked.
        is_right = None if self.yes else was_right
        if target.robot.hub.model.runs_programs:
            transport = _transport(
                self.hub,
                target,
                self.link,
                self.fault,
            )
            findings = check_robot(
                transport,
                target.robot,
                target.interface,
                may_move=may_move,
                is_right=is_right,
                calibrate=calibration_of(transport, self.calibrations),
                command=self._calibration(),
            )
        else:
            from brickhub.kits.kit_preflight import check_kit

            radio = _reach(
                self.hub,
                target,
                self.link,
                self.fault,
            )
            findings = check_kit(
                radio,
                target.robot,
                target.interface,
                may_move=may_move,
                is_right=is_right,
            )
        # The generator runs each check only when its line is printed.
        code = print_findings(
            findings,
            (9, 18),
            as_json=self.json,
            env=target.name,
            hub=self.hub,
        )
        if not self.json:
            print_line("not ready: see the errors above" if code else f"ready for {target.name}")
        return code

    def _calibration(self) -> str:
        """The command that calibrates this robot on this hub, as it is typed."""
        words = ["brickhub", "calibrate", self.target]
        if self.hub != "ble":
            words += ["--hub", self.hub]
        if self.calibrations is not None:
            words += ["--calibrations", str(self.calibrations)]
        return " ".join(map(quoted, words))


@dataclass(frozen=True)
class Calibrate:
    """Calibrate the zeros of a robot's motors, and save them for its hub.

    Joints with a range are turned to their stops. With `--by-hand`, the present angles of all other
    motors become their zeros.

    Examples:
      brickhub calibrate my_robot.py
      brickhub calibrate my_robot.py --by-hand
      brickhub calibrate my_robot.py --reverse left
      brickhub calibrate my_robot.py --as-described left
      brickhub calibrate my_robot.py --forget
    """

    target: TargetArgument
    hub: Hub = "ble"
    fault: Faults = ()
    by_hand: Flag = False
    """Set the zeros of motors without a range to their present angles; put legs and turntable at
    their zeros first."""
    reverse: Annotated[tuple[str, ...], option(metavar="MOTOR ...")] = ()
    """Motors that turn opposite to the description; nothing else is calibrated then. Saying it
    twice changes nothing."""
    as_described: Annotated[tuple[str, ...], option(metavar="MOTOR ...")] = ()
    """Motors that are not reversed any more; nothing else is calibrated then."""
    forget: Flag = False
    """Delete the saved calibration of the robot."""
    yes: Flag = False
    """Move without asking."""
    calibrations: Folder = None
    """Folder to write to; by default that in your settings folder."""

    def execute(self) -> None:
        self._check_modes()
        target = find(self.target)
        # These calls raise for an unknown name, before any hub is looked for.
        for name in (*self.reverse, *self.as_described):
            target.robot.motor(name)
        transport = _transport(self.hub, target, faults=self.fault)
        try:
            # A calibration belongs to a hub, whose identity is known only once it is connected.
            transport.open()
            hub = kept.hub_id(transport)
            if self.forget:
                kept.forget_calibration(hub, target.robot, self.calibrations)
                print_line(f"{target.robot.name} on {hub}: as described")
                return
            saved = kept.load_calibration(hub, target.robot, self.calibrations)
            if self.reverse or self.as_described:
                is_reversed = (saved.reversed | set(self.reverse)) - set(self.as_described)
                calibration = kept.Calibration(saved.zeros_deg, frozenset(is_reversed))
            else:
                # Motors that are not measured now keep their earlier zeros.
                zeros_deg = self._zeros_deg(transport, target.robot, saved)
                calibration = kept.Calibration(saved.zeros_deg | zeros_deg, saved.reversed)
        finally:
            transport.close()
        path = kept.save_calibration(
            hub,
            target.robot,
            calibration,
            self.calibrations,
        )
        for name, zero_deg in sorted(calibration.zeros_deg.items()):
            print_line(f"zero     {name:12}{zero_deg} deg")
        for name in sorted(calibration.reversed):
            print_line(f"reversed {name}")
        print_line(f"saved    {path}")

    def _check_modes(self) -> None:
        """Refuse options that a mode ignores. Raises DescriptionError."""
        always = ("--target", "--hub", "--fault", "--yes", "--calibrations")
        if self.forget:
            refuse_ignored(self, (*always, "--forget"), "with --forget")
        # The two options go together, because each names motors of its own.
        if self.reverse or self.as_described:
            refuse_ignored(self, (*always, "--reverse", "--as-described"), "with --reverse")
        both = sorted(set(self.reverse) & set(self.as_described))
        if both:
            raise DescriptionError(
                f"'{both[0]}' cannot be reversed and as described; leave one out"
            )

    def _zeros_deg(
        self,
        transport: Transport,
        robot: Robot,
        saved: Calibration,
    ) -> dict[str, int]:
        # The old zeros are left out, because zeros measured relative to them would be differences.
        # Directions stay.
        uncalibrated = calibrated(robot, dataclasses.replace(saved, zeros_deg={}))
        joints = [motor for motor in uncalibrated.motors if motor.range_deg is not None]
        if not joints and not self.by_hand:
            raise CalibrationError(
                f"no motor of '{robot.name}' has stops; put its motors at their zeros and add "
                "--by-hand"
            )
        measured = uncalibrated.motors if self.by_hand else joints
        for motor in measured:
            if not motor.kind.model.is_absolute:
                raise CalibrationError(
                    f"the motor '{motor.name}' counts from where it stands when a program begins, "
                    "so no zero of it can be kept; put it to its 0 before each start"
                )
        zeros_deg: dict[str, int] = {}
        if self.by_hand:
            # These angles are read before the joints move, because a person has put those motors in
            # place by hand.
            angles_deg = survey(transport, uncalibrated).angles_deg
            for motor in uncalibrated.motors:
                if motor.range_deg is None and motor.name in angles_deg:
                    zeros_deg[motor.name] = angles_deg[motor.name]
        if not joints:
            return zeros_deg
        names = ", ".join(motor.name for motor in joints)
        if not self.yes and not confirm(
            f"The joints {names} need room to turn slowly to their stops. Move them now?"
        ):
            raise CalibrationError(
                "nothing was moved and nothing calibrated; clear the way and say yes, or add --yes"
            )
        for name, stops in find_stops(transport, uncalibrated).items():
            if stops is None:
                raise CalibrationError(
                    f"motor '{name}' meets no stops; look whether it drives its joint"
                )
            zeros_deg[name] = zero_between(stops, uncalibrated.motor(name))
        return zeros_deg


def _reach(
    hub: str,
    target: Target,
    link: str | None,
    faults: Sequence[str],
) -> Any:
    """An unopened transport to a hub, or a radio to devices of LEGO's kits. ``link``: that of a
    virtual one, by name, and its faults. Raises DescriptionError if a real one is given such."""
    from brickhub.kits.radio import real_radio
    from brickhub.kits.virtual_kit import virtual_robot
    from brickhub.virtual.faults import with_faults

    address = parse_hub(hub)
    chosen = None if link is None else profile(link)
    if address.is_virtual:
        return virtual_robot(with_faults(target.make_body(), faults), link=chosen)
    if faults:
        raise DescriptionError(
            "a real robot has faults of its own; leave out --fault, or take --hub virtual"
        )
    if link is not None:
        raise DescriptionError(
            "a real hub has a link of its own; leave out --link, or take --hub virtual"
        )
    if target.robot.hub.model.runs_programs:
        return address.transport(target.robot.hub)
    return real_radio(address)


def _transport(
    hub: str,
    target: Target,
    link: str | None = None,
    faults: Sequence[str] = (),
) -> Transport:
    """An unopened transport to a hub, as `_reach`. Raises DescriptionError for a robot of LEGO's
    kits."""
    if not target.robot.hub.model.runs_programs:
        raise DescriptionError(
            f"'{target.name}' has devices of LEGO's kits, which need none of this; `check` "
            "checks them"
        )
    transport: Transport = _reach(hub, target, link, faults)
    return transport
