"""Keyboard of a terminal as the driver of a robot."""

from __future__ import annotations

import contextlib
import signal
import sys
from collections.abc import Iterator, Sequence
from typing import TYPE_CHECKING, Self

import torch
from torch import Tensor

from brickhub.entry import Entry
from bricksrl.errors import DataError
from bricksrl.teleop.mapping import KEY_PAIRS, push_action, rest_action

if TYPE_CHECKING:
    from prompt_toolkit.input import Input


class KeyboardDriver:
    """Driver by keyboard: each command has a key to raise and one to lower it; a step applies the keys since the last step.
    Raises DataError if the robot has more commands than there are keys, or there is no terminal.

    A terminal reports key presses but no releases; a held key repeats. Use it as a context manager: inside, keys are read one
    by one and are not echoed.

    Args:
        commands: commands of the robot.
        in_charge: drive from the start; the space bar toggles between human and policy.
        source: source of the keys; by default the terminal.
    """

    def __init__(self, commands: Sequence[Entry], *, in_charge: bool = True, source: Input | None = None) -> None:
        if len(commands) > len(KEY_PAIRS):
            raise DataError(f"{len(commands)} commands are too many for the keyboard, which drives {len(KEY_PAIRS)}; use the API")
        self.in_charge = in_charge
        self._rest = rest_action(commands)
        self._keys: dict[str, tuple[int, float]] = {}
        for index, (up, down) in enumerate(KEY_PAIRS[: len(commands)]):
            self._keys |= {up: (index, 1.0), down: (index, -1.0)}
        self._source = source if source is not None else _terminal()
        self._raw_mode = contextlib.ExitStack()

    def __call__(self, observation: Tensor) -> Tensor | None:
        """Action ``[m]`` of the keys since the last call; ``None`` while the policy is in charge."""
        pushes = torch.zeros_like(self._rest)
        for press in self._source.read_keys():
            key = str(getattr(press.key, "value", press.key))
            if key == "c-c":
                signal.raise_signal(signal.SIGINT)  # in raw mode the terminal does not send it
            if key == " ":
                self.in_charge = not self.in_charge
            if key.lower() in self._keys:
                index, push = self._keys[key.lower()]
                pushes[index] = push
        return push_action(pushes, self._rest) if self.in_charge else None

    @contextlib.contextmanager
    def quiet(self) -> Iterator[None]:
        """Restore the terminal inside this context, for a question and its answer."""
        with self._source.cooked_mode():
            yield

    def __enter__(self) -> Self:
        self._raw_mode.enter_context(self._source.raw_mode())
        return self

    def __exit__(self, *_: object) -> None:
        self._raw_mode.close()
        self._source.close()


def _terminal() -> Input:
    from prompt_toolkit.input import create_input

    if sys.stdin is None or not sys.stdin.isatty():
        raise DataError("nobody sits at a terminal to press keys; run this in one, or drive with a gamepad")
    return create_input()
