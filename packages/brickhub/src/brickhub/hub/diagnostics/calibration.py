"""Calibration of one robot against its description: zeros and reversed directions of its motors.

A calibration belongs to a hub, by its address, and to the robot built around it. It modifies the
description, from which the hub program is made.
"""

import json
import os
import sys
from collections.abc import Callable
from dataclasses import dataclass, field, replace
from pathlib import Path

from brickhub.errors import BricksError, DescriptionError
from brickhub.files import as_file_name, reading, write_durably
from brickhub.hub.transport import Transport
from brickhub.robot import Direction, Motor, Robot


class CalibrationError(BricksError):
    """A calibration that cannot be read, or does not belong to the robot."""


@dataclass(frozen=True)
class Calibration:
    """Zeros and directions found on one robot.

    Attributes:
        zeros_deg: for each motor, the measured output angle at the description's 0.
        reversed: motors that turn opposite to the description.
    """

    zeros_deg: dict[str, int] = field(default_factory=dict)
    reversed: frozenset[str] = frozenset()


def calibrated(robot: Robot, calibration: Calibration) -> Robot:
    """The robot's description with its calibration applied. Raises DescriptionError if the
    calibration names motors that the robot does not have."""
    # The robot may have been described anew since it was calibrated.
    named = set(calibration.zeros_deg) | calibration.reversed
    known = {motor.name for motor in robot.motors}
    unknown = sorted(named - known)
    if unknown:
        raise DescriptionError(
            f"robot '{robot.name}' has no motor '{unknown[0]}'; calibrate it again"
        )
    motors = []
    for motor in robot.motors:
        direction = motor.direction
        if motor.name in calibration.reversed:
            direction = Direction(-direction.value)
        zero_deg = calibration.zeros_deg.get(motor.name, motor.zero_deg)
        motors.append(replace(motor, direction=direction, zero_deg=zero_deg))
    return replace(robot, motors=tuple(motors))


def zero_between(stops_deg: tuple[int, int], motor: Motor) -> int:
    """Zero of a joint from the measured angles of its two stops: its range is centred between them.
    Raises CalibrationError if the motor has no range, or the stops are too close for it."""
    if motor.range_deg is None:
        raise CalibrationError(
            f"motor '{motor.name}' has no range, so no stops; calibrate it by hand"
        )
    width = stops_deg[1] - stops_deg[0]
    required = motor.range_deg[1] - motor.range_deg[0]
    # Something in the way stopped the joint before its own stops.
    if width < required:
        raise CalibrationError(
            f"motor '{motor.name}' is blocked after {width} degrees and has to turn by "
            f"{required}; clear its way and try again"
        )
    # A joint is centred between its stops, so its zero is the difference of the two middles.
    return round((sum(stops_deg) - sum(motor.range_deg)) / 2)


def calibration_folder() -> Path:
    """Folder of the calibrations, in the user's settings folder: ``XDG_CONFIG_HOME``, or that of
    the system."""
    config_home = os.environ.get("XDG_CONFIG_HOME")
    home = Path.home()
    # This variable counts on every system, because a user who sets it means it.
    if config_home:
        base = Path(config_home)
    elif sys.platform == "win32":
        base = Path(os.environ.get("APPDATA") or home / "AppData" / "Roaming")
    elif sys.platform == "darwin":
        base = home / "Library" / "Application Support"
    else:
        base = home / ".config"
    return base / "bricksrl" / "calibrations"


def load_calibration(
    hub: str,
    robot: Robot,
    folder: Path | None = None,
) -> Calibration:
    """Saved calibration of the robot on this hub; an empty one if there is none. Raises
    CalibrationError if it is invalid."""
    path = _path(hub, robot, folder)
    if not path.exists():
        return Calibration()
    with reading(
        "the calibration in",
        path,
        CalibrationError,
        "delete the file and calibrate again",
    ):
        data = json.loads(path.read_bytes())
        # Types are converted here, so that a file with other types is refused as unreadable.
        zeros_deg = {str(name): int(zero_deg) for name, zero_deg in data["zeros_deg"].items()}
        reversed_motors = frozenset(str(name) for name in data["reversed"])
        return Calibration(zeros_deg, reversed_motors)


def hub_id(transport: Transport) -> str:
    """Key of a hub's calibrations: the address that it has when it is connected."""
    identity = getattr(transport, "identity", None)
    return "virtual" if identity is None else identity.address


def calibration_of(transport: Transport, folder: Path | None = None) -> Callable[[Robot], Robot]:
    """Argument ``calibrate`` for a link over this transport."""

    def apply(robot: Robot) -> Robot:
        # A transport knows its hub only once it is connected.
        hub = hub_id(transport)
        return calibrated(robot, load_calibration(hub, robot, folder))

    return apply


def save_calibration(
    hub: str,
    robot: Robot,
    calibration: Calibration,
    folder: Path | None = None,
) -> Path:
    """Write a calibration atomically; returns its path. Raises WriteError if the file cannot be
    written."""
    path = _path(hub, robot, folder)
    # The file also names the hub, because the name of the file no longer shows the address to a
    # reader.
    data = {
        "hub": hub,
        "zeros_deg": calibration.zeros_deg,
        "reversed": sorted(calibration.reversed),
    }
    text = json.dumps(data, indent=2) + "\n"
    write_durably(path, text.encode())
    return path


def forget_calibration(
    hub: str,
    robot: Robot,
    folder: Path | None = None,
) -> None:
    """Delete the saved calibration; without effect if there is none. Raises CalibrationError if the
    file cannot be deleted."""
    path = _path(hub, robot, folder)
    try:
        path.unlink(missing_ok=True)
    except OSError as error:
        raise CalibrationError(
            f"cannot delete {path} ({error.strerror}); delete it yourself"
        ) from None


def _path(
    hub: str,
    robot: Robot,
    folder: Path | None,
) -> Path:
    hub_folder = (folder or calibration_folder()) / as_file_name(hub)
    return hub_folder / f"{as_file_name(robot.name)}.json"
