"""Options of an environment: connection to the robot, physics, and variant of the task; pickling as these options."""

from __future__ import annotations

import functools
from collections.abc import Callable
from dataclasses import dataclass, field, fields, replace
from typing import Any, Self

import numpy as np

from brickhub.fields import check_fields
from brickhub.hub.transport import Pipe
from bricksrl.errors import BricksError, DescriptionError
from bricktwin.twin.physics import Physics, RandomPhysics


@dataclass(frozen=True, kw_only=True)
class EnvOptions:
    """Connection to the robot, physics of a virtual one, and options of the task. Raises DescriptionError if two options
    contradict each other.
    """

    hub: str = "virtual"
    """How to reach the robot: "virtual" simulates it, "ble" finds a real hub over Bluetooth, "ble:NAME" or "ble:ADDRESS" takes
    that one, and "usb" or "usb:PORT" one on a cable."""
    realtime: bool = False
    """Run a virtual robot in real time."""
    streaming: bool = False
    """Stream: the hub sends observations continuously and applies the latest command. Steps then run at a fixed rate, and the
    link's readings and statistics hold the age of each observation."""
    app_data: bool = False
    """Send to the hub program over AppData instead of its standard input."""
    randomize: bool = False
    """Domain randomization: draw the physics of a virtual robot anew for each episode."""
    physics: Physics | None = None
    """Physics of a virtual robot, such as a fitted one; by default a freshly charged robot on a smooth floor."""
    options: dict[str, Any] = field(default_factory=dict)
    """Options of the task, such as ``{"sparse": True}``; plain values."""

    def __post_init__(self) -> None:
        for name, value in vars(self).items():
            if isinstance(value, np.generic):  # a NumPy number, such as a seed from an array
                object.__setattr__(self, name, value.item())
        check_fields(type(self), vars(self))
        if self.randomize and self.physics is not None:
            raise DescriptionError("the physics is given and is to be random too; choose one of the two")

    def changed(self, **named: Any) -> Self:
        """A copy with fields changed by name; any other name is an option of the task."""
        names = {option.name for option in fields(EnvOptions)}
        values = {name: value for name, value in named.items() if name in names}
        options = {**self.options, **{name: value for name, value in named.items() if name not in names}}
        return replace(self, **{"options": options, **values})

    @property
    def env_options(self) -> EnvOptions:
        """These options alone, for a subclass with further fields."""
        return EnvOptions(**{option.name: getattr(self, option.name) for option in fields(EnvOptions)})

    @property
    def pipe(self) -> Pipe:
        """The channel for input to the hub program."""
        return Pipe.APP_DATA if self.app_data else Pipe.STDIN

    @property
    def physics_or_draw(self) -> Physics | RandomPhysics | None:
        """The fixed physics, or a sampler of one for each episode."""
        return RandomPhysics() if self.randomize else self.physics


class PicklableEnv:
    """An environment that is pickled and copied as the call that makes it: a fresh one with the same options and seed.

    Attributes:
        remake: makes it, given a seed; ``None`` if there cannot be two of it, as of a robot.
    """

    remake: Callable[..., object] | None = None
    _seed: int | None = None

    def __reduce__(self) -> tuple[Callable[[], object], tuple[()]]:
        if self.remake is None:
            env_id = vars(self)["task"].id
            raise BricksError(
                f"{env_id} cannot be pickled with its link to a robot; pass a function that makes it, such as "
                f"functools.partial(bricksrl.make, '{env_id}', hub='ble')"
            )
        return functools.partial(self.remake, seed=self._seed), ()
