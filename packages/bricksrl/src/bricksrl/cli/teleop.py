"""Teleoperation by keyboard, gamepad or Controller of LEGO's kits, for the commands that let a human drive."""

from __future__ import annotations

from collections.abc import Iterator
from contextlib import AbstractContextManager, contextmanager, nullcontext
from dataclasses import replace
from typing import TYPE_CHECKING, Literal, get_args

from brickhub.cli.terminal import print_line

if TYPE_CHECKING:
    from bricksrl.envs.options import EnvOptions
    from bricksrl.envs.rollout import Driver
    from bricksrl.envs.task import Task

Device = Literal["keyboard", "gamepad", "controller"]
DEVICES = get_args(Device)


def with_human(options: EnvOptions, env: str) -> EnvOptions:
    """Options of an environment in which a human drives: a virtual robot moves in real time. A real one does anyway, and for a
    simulation `driving` keeps the pace."""
    from bricksrl.envs.registry import is_simulation

    return replace(options, realtime=True) if options.hub == "virtual" and not is_simulation(env) else options


@contextmanager
def driving(device: str | None, env: str, task: Task, *, in_charge: bool) -> Iterator[Driver | None]:
    """The driver of a keyboard, a gamepad or a Controller of LEGO's kits, after printing the keys' meanings; ``None`` for no
    device. Raises DataError if the device is not available."""
    from bricksrl.envs.registry import is_simulation
    from bricksrl.teleoperation import DRIVERS, Paced, legend

    if device is None:
        yield None
        return
    commands = [command.entry for command in task.interface.commands]
    with DRIVERS[device](commands, in_charge=in_charge) as driver:
        if device == "keyboard":
            for line in legend(commands):
                print_line(line)
        yield Paced(driver, task.rate_hz) if is_simulation(env) else driver


def quiet(driver: object) -> AbstractContextManager[None]:
    """Context in which the driver ignores keys, so that they can answer a question on the terminal."""
    from bricksrl.teleoperation import KeyboardDriver

    return driver.quiet() if isinstance(driver, KeyboardDriver) else nullcontext()
