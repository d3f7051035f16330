"""Keyboard and gamepad of BricksRL as LeRobot teleoperators, and random commands for trying out."""

from __future__ import annotations

from typing import Any

import torch
from lerobot.teleoperators.teleoperator import Teleoperator
from lerobot.utils.errors import DeviceNotConnectedError

from bricksrl.envs import get_task
from bricksrl.errors import DataError
from bricksrl.teleoperation import GamepadDriver, KeyboardDriver, at_rest
from lerobot_robot_bricksrl.config import (
    BricksGamepadConfig,
    BricksKeyboardConfig,
    BricksRandomConfig,
)


class _Hand(Teleoperator):
    """A driver of BricksRL, whose actions in -1..1 become commands in their units."""

    def __init__(self, config: Any) -> None:
        super().__init__(config)
        self.config = config
        self.commands = get_task(config.env).interface.commands
        self._driver: Any = None

    def _connect(self) -> Any:
        raise NotImplementedError

    @property
    def action_features(self) -> dict[str, type]:
        return {command.name: float for command in self.commands}

    @property
    def feedback_features(self) -> dict[str, type]:
        return {}

    @property
    def is_connected(self) -> bool:
        return self._driver is not None

    @property
    def is_calibrated(self) -> bool:
        return True

    def connect(self, calibrate: bool = True) -> None:
        """Listen to it.

        Raises:
            ConnectionError: there is none.
        """
        try:
            self._driver = self._connect()
        except DataError as error:
            raise ConnectionError(str(error)) from None

    def calibrate(self) -> None:
        """Nothing."""

    def configure(self) -> None:
        """Nothing."""

    def get_action(self) -> dict[str, Any]:
        """Commands by their names, in their units; those that move nothing after its human has
        given control back.

        Raises:
            DeviceNotConnectedError: nothing is connected.
        """
        if self._driver is None:
            raise DeviceNotConnectedError(f"{self} is not connected; run connect() first")
        action = self._driver(torch.empty(0))
        shares = (
            at_rest([command.entry for command in self.commands])
            if action is None
            else action.tolist()
        )
        return {
            command.name: command.low + (share + 1.0) / 2.0 * (command.high - command.low)
            for command, share in zip(self.commands, shares, strict=True)
        }

    def send_feedback(self, feedback: dict[str, Any]) -> None:
        """Nothing to feel here."""

    def disconnect(self) -> None:
        """Let go of it."""
        driver, self._driver = self._driver, None
        if hasattr(driver, "__exit__"):
            driver.__exit__(None, None, None)


class BricksKeyboard(_Hand):
    """Two keys for each command: q and a for the first one, w and s for the second, and so on."""

    config_class = BricksKeyboardConfig
    name = "bricksrl_keyboard"

    def _connect(self) -> Any:
        return KeyboardDriver([command.entry for command in self.commands]).__enter__()


class BricksGamepad(_Hand):
    """A stick for each command."""

    config_class = BricksGamepadConfig
    name = "bricksrl_gamepad"

    def _connect(self) -> Any:
        return GamepadDriver([command.entry for command in self.commands]).__enter__()


class BricksRandom(_Hand):
    """Uniformly random commands."""

    config_class = BricksRandomConfig
    name = "bricksrl_random"

    def _connect(self) -> Any:
        generator = torch.Generator().manual_seed(self.config.seed)
        return lambda _observation: 2.0 * torch.rand(len(self.commands), generator=generator) - 1.0
