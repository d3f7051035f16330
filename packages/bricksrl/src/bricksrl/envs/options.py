"""Options of an environment: connection to the robot, physics, and variant of the task.

They are declared here for Python, the command line, Gymnasium and the configuration of a run alike:
a field is an option, its docstring the help.
"""

import json
from collections.abc import Iterable
from dataclasses import dataclass, field, fields, replace
from pathlib import Path
from typing import Annotated, Any, Self

import numpy as np

from brickhub.fields import Range, check_fields
from brickhub.hub.link.profiles import profile
from brickhub.options import Existing, Faults, Flag, existing_file, option, parsed
from brickhub.user_files import NotCode, check_there, with_absolute_file
from brickhub.virtual.faults import parse_fault
from bricksrl.errors import DescriptionError, TwinError
from bricktwin.target import ScenesWithoutCode, absolute_scene, load_scene
from bricktwin.twin.physics import PHYSICS_REMEDY, Physics, read_physics

_PHYSICS = existing_file("the physics in", TwinError, PHYSICS_REMEDY)


def parse_option(text: str) -> tuple[str, Any]:
    """Parse ``NAME=VALUE`` into the name and the value: JSON, or else a string. Raises
    DescriptionError if the text has no name or no ``=``."""
    name, equals, value = text.partition("=")
    if not (name.isidentifier() and equals):
        raise DescriptionError(f"'{text}' is not an option; give NAME=VALUE, such as sparse=true")
    try:
        return name, json.loads(value)
    except (ValueError, RecursionError):
        return name, value


@dataclass(frozen=True, kw_only=True)
class TransformOptions:
    """What is between the environment and its agent."""

    frame_stack: Annotated[int, Range(1, 64), option(metavar="N")] = 1
    """Observe the last N observations together (CatFrames)."""
    frame_skip: Annotated[int, Range(1, 1000), option(metavar="N")] = 1
    """Repeat each action for N steps of the robot; their rewards are summed."""
    transform: Annotated[str | None, option(metavar="FILE"), Existing(check_there)] = None
    """Your own transform: FILE.py[:NAME], a transform, its class, or a function from an environment
    to a TransformedEnv."""


TRANSFORMS: dict[str, Any] = vars(TransformOptions())
"""These options without any transform."""


@dataclass(frozen=True, kw_only=True)
class EnvOptions(TransformOptions):
    """Connection to the robot, physics of a virtual one, and options of the task."""

    hub: Annotated[str, option(metavar="HUB"), NotCode()] = "virtual"
    """How to reach the robot: virtual, ble or usb; ble:NAME, ble:ADDRESS or usb:PORT if there are
    several."""
    streaming: Flag = False
    """Let the hub stream observations at 100 Hz, whose age the readings hold, and apply the latest
    command; steps do not wait."""
    app_data: Flag = False
    """Send commands over AppData, where a new command replaces an unread one, instead of standard
    input."""
    realtime: Flag = False
    """Run a virtual robot in real time; always on while a human drives."""
    randomize: Flag = False
    """Domain randomization: draw the physics of the virtual robot (battery, friction, masses,
    noise, link) for each episode."""
    physics: Annotated[Physics | Path | None, parsed(Path, metavar="FILE"), option(), _PHYSICS] = (
        None
    )
    """Physics of the virtual robot: a JSON file such as `bricksrl twin fit` writes; by default
    charged, on a smooth floor."""
    link: Annotated[str | None, option(metavar="LINK"), NotCode()] = None
    """Link of the virtual robot: Bluetooth as mac, linux or bad-room, or usb, usb-quick or
    usb-slow, in place of that of the physics, which is linux by default."""
    scene: Annotated[
        str | None, option(metavar="SCENE"), Existing(load_scene), NotCode(ScenesWithoutCode())
    ] = None
    """Surroundings of the virtual robot in place of the task's: a world of `bricktwin world list`,
    a picture or a photograph of a mat as the floor, mat.png:fll or mat.png:1000x700, or
    my_scene.py:MAT."""
    fault: Faults = ()
    options: Annotated[
        dict[str, Any],
        parsed(parse_option, metavar="NAME=VALUE", collect=dict),
        option(name="option"),
    ] = field(default_factory=dict)
    """Option of the environment's task, such as sparse=true, threshold_deg=20 or
    calibration=red.json. May be repeated."""

    def __post_init__(self) -> None:
        for name, value in vars(self).items():
            # A seed from an array is a NumPy number, which JSON does not know.
            if isinstance(value, np.generic):
                object.__setattr__(self, name, value.item())
        file: object = self.physics
        # Programs may give a path as a text.
        if isinstance(file, str):
            object.__setattr__(self, "physics", Path(file))
        faults: object = self.fault
        # A single fault may be given as a text, and JSON has lists.
        if isinstance(faults, str | list):
            object.__setattr__(
                self,
                "fault",
                (faults,) if isinstance(faults, str) else tuple(faults),
            )
        check_fields(type(self), vars(self))
        for text in self.fault:
            # An unknown kind of fault is refused now, and not when the robot is made.
            parse_fault(text)
        if self.link is not None:
            # An unknown name is refused now, and not when the robot is made.
            profile(self.link)
        if self.scene is not None:
            object.__setattr__(self, "scene", absolute_scene(self.scene))
        if self.transform is not None:
            # An absolute path keeps its meaning in any folder.
            object.__setattr__(self, "transform", with_absolute_file(self.transform))
        if self.randomize and self.physics is not None:
            raise DescriptionError(
                "the physics is given and is to be random too; choose one of the two"
            )

    def changed(self, **named: Any) -> Self:
        """A copy with fields changed by name; any other name is an option of the task."""
        names = {option.name for option in fields(EnvOptions)}
        values: dict[str, Any] = {}
        options = dict(self.options)
        for name, value in named.items():
            if name in names:
                values[name] = value
            else:
                options[name] = value
        # A caller that gives `options` as a whole means to replace these.
        return replace(self, **{"options": options, **values})

    def refuse(
        self,
        names: Iterable[str],
        reason: str,
    ) -> None:
        """Raise DescriptionError with the reason if one of these options is given, as it would have
        no effect."""
        default = EnvOptions()
        if any(getattr(self, name) != getattr(default, name) for name in names):
            raise DescriptionError(reason)

    @property
    def env_options(self) -> "EnvOptions":
        """These options alone, for a subclass with further fields."""
        return EnvOptions(
            **{option.name: getattr(self, option.name) for option in fields(EnvOptions)}
        )

    @property
    def is_transformed(self) -> bool:
        """Whether agents get other observations, rewards or steps than the environment's own."""
        return self.transforms != TRANSFORMS

    @property
    def transforms(self) -> dict[str, Any]:
        """The options of what is between the environment and its agent."""
        return {name: getattr(self, name) for name in TRANSFORMS}

    def as_it_is(self) -> Self:
        """A copy without transforms."""
        return replace(self, **TRANSFORMS)

    @property
    def known_physics(self) -> Physics | None:
        """The fixed physics; a file is read. Raises TwinError if it cannot be."""
        return read_physics(self.physics) if isinstance(self.physics, Path) else self.physics
