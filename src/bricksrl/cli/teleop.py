"""Teleoperation by keyboard or gamepad, for the commands that let a human drive."""

from __future__ import annotations

from collections.abc import Iterator
from contextlib import AbstractContextManager, contextmanager, nullcontext
from typing import TYPE_CHECKING

from bricksrl.cli.terminal import print_line

if TYPE_CHECKING:
    from bricksrl.data.schema import Description
    from bricksrl.teleop.gamepad import GamepadDriver
    from bricksrl.teleop.keyboard import KeyboardDriver

DEVICES = ("keyboard", "gamepad")


@contextmanager
def driving(device: str | None, description: Description, *, in_charge: bool) -> Iterator[KeyboardDriver | GamepadDriver | None]:
    """The driver of a keyboard or a gamepad, after printing the keys' meanings; ``None`` for no device. Raises DataError if the
    device is not available."""
    from bricksrl.teleop.gamepad import GamepadDriver
    from bricksrl.teleop.keyboard import KeyboardDriver
    from bricksrl.teleop.mapping import legend

    if device is None:
        yield None
        return
    driver_type = KeyboardDriver if device == "keyboard" else GamepadDriver
    with driver_type(description.action, in_charge=in_charge) as driver:
        if device == "keyboard":
            for line in legend(description.action):
                print_line(line)
        yield driver


def quiet(driver: object) -> AbstractContextManager[None]:
    """Context in which the driver ignores keys, so that they can answer a question on the terminal."""
    from bricksrl.teleop.keyboard import KeyboardDriver

    return driver.quiet() if isinstance(driver, KeyboardDriver) else nullcontext()
