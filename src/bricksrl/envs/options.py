"""Options of an environment: how its robot is reached, what its world is, which variant of its task it has."""

from __future__ import annotations

from dataclasses import dataclass, field, fields, replace
from typing import Any, Self

from bricksrl.errors import DescriptionError
from bricksrl.hub.transport import Pipe
from bricksrl.twin.physics import Physics, RandomPhysics


@dataclass(frozen=True, kw_only=True)
class EnvOptions:
    """How a robot is reached, what its world is, and the options of the task.

    Raises:
        DescriptionError: at construction, when two of them contradict each other.
    """

    hub: str = "virtual"
    """How to reach the robot: "virtual" runs the hub program on a simulated one, "ble" finds a real one over Bluetooth,
    "ble:NAME" or "ble:ADDRESS" that one, and "usb" or "usb:PORT" one on a cable."""
    realtime: bool = False
    """Let a virtual robot take as long as a real one."""
    streaming: bool = False
    """Have the hub send its observations all the time, and take the latest command; steps then follow one another at a fixed
    rate, and the age of each observation is in the link's readings and statistics."""
    app_data: bool = False
    """Speak to the program on the hub over AppData instead of its standard input."""
    randomize: bool = False
    """Draw another physics of a virtual robot for each episode."""
    physics: Physics | None = None
    """Physics of a virtual robot, such as a fitted one; without it a freshly charged robot on a smooth floor."""
    options: dict[str, Any] = field(default_factory=dict)
    """Options of the task, such as ``{"sparse": True}``; plain values."""

    def __post_init__(self) -> None:
        if self.randomize and self.physics is not None:
            raise DescriptionError("the physics is given and is to be random too; choose one of the two")

    def changed(self, **named: Any) -> Self:
        """With fields by their names; any other name is an option of the task."""
        own = {one.name for one in fields(EnvOptions)}
        given = {name: value for name, value in named.items() if name in own}
        options = {**self.options, **{name: value for name, value in named.items() if name not in own}}
        return replace(self, **{"options": options, **given})

    @property
    def env_options(self) -> EnvOptions:
        """These alone, where a class has more."""
        return EnvOptions(**{one.name: getattr(self, one.name) for one in fields(EnvOptions)})

    @property
    def pipe(self) -> Pipe:
        """The way into the program on the hub."""
        return Pipe.APP_DATA if self.app_data else Pipe.STDIN

    @property
    def physics_or_draw(self) -> Physics | RandomPhysics | None:
        """Physics, or how to draw one for each episode."""
        return RandomPhysics() if self.randomize else self.physics
