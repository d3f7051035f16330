"""Keyboard or gamepad for the commands that let a human drive."""

from __future__ import annotations

from collections.abc import Iterator
from contextlib import AbstractContextManager, contextmanager, nullcontext
from typing import TYPE_CHECKING

from bricksrl.cli.terminal import print_line

if TYPE_CHECKING:
    from bricksrl.data.schema import Description
    from bricksrl.teleop.gamepad import GamepadDriver
    from bricksrl.teleop.keyboard import KeyboardDriver

HANDS = ("keyboard", "gamepad")


@contextmanager
def driving(hands: str | None, description: Description, *, in_charge: bool) -> Iterator[KeyboardDriver | GamepadDriver | None]:
    """The driver, after telling what the keys do; ``None`` for no hands.

    Raises:
        DataError: there is no such thing to drive with here.
    """
    from bricksrl.teleop.gamepad import GamepadDriver
    from bricksrl.teleop.keyboard import KeyboardDriver
    from bricksrl.teleop.mapping import legend

    if hands is None:
        yield None
        return
    kind = KeyboardDriver if hands == "keyboard" else GamepadDriver
    with kind(description.action, in_charge=in_charge) as driver:
        if hands == "keyboard":
            for line in legend(description.action):
                print_line(line)
        yield driver


def quiet(driver: object) -> AbstractContextManager[None]:
    """Inside, keys are an answer to what the terminal asks, and do not drive."""
    from bricksrl.teleop.keyboard import KeyboardDriver

    return driver.quiet() if isinstance(driver, KeyboardDriver) else nullcontext()
