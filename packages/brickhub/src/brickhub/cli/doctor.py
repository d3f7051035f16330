"""``brickhub doctor``: check of this computer for everything that a hub needs."""

import platform
import threading
from collections.abc import Callable, Mapping
from dataclasses import dataclass
from importlib import metadata
from typing import Annotated, ClassVar

from brickhub.cli.terminal import print_findings
from brickhub.errors import BluetoothUnavailableError, DescriptionError
from brickhub.finding import Finding, Outcome
from brickhub.options import JsonFlag, option

_SCAN_S = 1.0
_MAX_TIMEOUT_S = 3600.0
_WITHOUT_ROBOT = "the virtual hub needs none of it"

Answer = tuple[Outcome, str]


def run_check(
    name: str,
    check: Callable[[], Answer],
    timeout_s: float,
) -> Finding:
    """Finding of a check, also if it raises or exceeds the timeout; it is then left running in its
    thread."""
    answers: list[Answer] = []

    def run() -> None:
        try:
            answers.append(check())
        except BaseException as error:  # noqa: BLE001  a broken package may raise anything
            message = f"{type(error).__name__}: {' '.join(str(error).split())}"
            answers.append((Outcome.ERROR, f"{message}; install this package again"))

    # A thread can be left behind: a system's service for Bluetooth may never answer.
    thread = threading.Thread(target=run, daemon=True)
    thread.start()
    thread.join(timeout_s)
    if not answers:
        detail = f"no answer within {timeout_s:g} s; look at it by itself"
        return Finding(name, Outcome.WARNING, detail)
    outcome, detail = answers[0]
    return Finding(name, outcome, detail)


def check_python() -> Answer:
    """Version of Python, and this computer; an older one than we need cannot import this."""
    return Outcome.OK, f"{platform.python_version()}, {platform.system()} {platform.machine()}"


def check_packages(
    distributions: tuple[str, ...] = ("brickhub",),
    named: tuple[str, ...] = ("brickhub", "bleak", "mpy-cross-v6"),
) -> Answer:
    """Check the packages that distributions require, and their versions. ``named``: those whose
    versions are told."""
    from packaging.requirements import Requirement

    requirements: list[str] = []
    for name in distributions:
        requirements += metadata.requires(name) or []
    installed = set()
    faults = []
    for text in requirements:
        requirement = Requirement(text)
        # This requirement belongs to an extra, or to another system or version of Python.
        marker = requirement.marker
        if marker is not None and not marker.evaluate({"extra": ""}):
            continue
        try:
            version = metadata.version(requirement.name)
        except metadata.PackageNotFoundError:
            faults.append(f"{requirement.name} is missing")
            continue
        installed.add(requirement.name)
        # Pre-releases count, because whoever installed a release candidate wanted it.
        if not requirement.specifier.contains(version, prereleases=True):
            faults.append(f"{requirement.name} {version} is not {requirement.specifier}")
    if faults:
        return Outcome.ERROR, f"{'; '.join(faults)}; run `pip install {distributions[0]}` again"
    versions = [f"{name} {metadata.version(name)}" for name in named]
    others = installed - set(named)
    return Outcome.OK, f"{', '.join(versions)}, and {len(others)} more"


def check_compiler() -> Answer:
    """Check that the compiler of hub programs runs."""
    from brickhub.hub.program.compile import compile_mpy

    return Outcome.OK, f"mpy-cross makes {len(compile_mpy('print(1)'))} bytes of one line"


def check_bluetooth() -> Answer:
    """Check that hubs can be scanned for; on Linux also why not."""
    from brickhub.hub.transports.ble import bluetooth_problem, scan

    # A missing Bluetooth is never more than a warning, because only a real hub needs it.
    fault = bluetooth_problem()
    if fault is not None:
        return Outcome.WARNING, f"{fault[1]}; {_WITHOUT_ROBOT}"
    try:
        hubs = scan(_SCAN_S)
    except BluetoothUnavailableError as error:
        return Outcome.WARNING, f"{error}; {_WITHOUT_ROBOT}"
    names = ", ".join(hub.name for hub in hubs) or "no hub in reach right now"
    return Outcome.OK, f"can look for hubs: {names}"


def check_usb() -> Answer:
    """List the serial ports; a hub on a cable is one of them."""
    from serial.tools.list_ports import comports

    ports = sorted(port.device for port in comports())
    return Outcome.OK, f"serial ports: {', '.join(ports) or 'none'}"


CHECKS: dict[str, Callable[[], Answer]] = {
    "python": check_python,
    "packages": check_packages,
    "compiler": check_compiler,
    "bluetooth": check_bluetooth,
    "usb": check_usb,
}


@dataclass(frozen=True)
class Doctor:
    """Check this computer: Python, packages, compiler, Bluetooth, USB.

    One line per check, with advice; exit code 1 if a required part is missing.

    Examples:
      brickhub doctor
      brickhub doctor --json
    """

    timeout_s: Annotated[float, option(metavar="SECONDS")] = 60.0
    """Timeout of each check."""
    json: JsonFlag = False
    checks: ClassVar[Mapping[str, Callable[[], Answer]]] = CHECKS

    def execute(self) -> int:
        if not 0 < self.timeout_s <= _MAX_TIMEOUT_S:
            raise DescriptionError(
                f"timeout-s is {self.timeout_s:g}; give a positive number of up to "
                f"{_MAX_TIMEOUT_S:g}"
            )
        # The checks run one by one, so that each line appears as soon as its check is done.
        findings = (run_check(name, check, self.timeout_s) for name, check in self.checks.items())
        return print_findings(findings, (9, 12), as_json=self.json)
