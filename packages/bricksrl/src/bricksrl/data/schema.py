"""Schema of a dataset: names, order, units and rate of its numbers, equal for all its episodes."""

from __future__ import annotations

import dataclasses
import enum
import json
import math
from dataclasses import dataclass, field
from typing import TYPE_CHECKING, Any

from brickhub.entry import Entry
from brickhub.fields import check_fields
from bricksrl.errors import DataError

if TYPE_CHECKING:
    from torchrl.envs import EnvBase

    from bricksrl.envs.task import Task

VERSION = 1
"""Version of the schema; others are refused."""


@dataclass(frozen=True)
class Description:
    """Description of recorded data.

    Attributes:
        env: id of the environment.
        rate_hz: nominal steps per second of the task; 1 if its steps have no fixed time.
        observation, action: entries of the vectors; actions are in -1..1, their entries give the mapped ranges.
        robot: the robot's whole description as plain values; empty without a robot.
        options: options of the environment.
        camera: name of the camera; ``None`` without one.
        image_px: side of its square image.
    """

    env: str
    rate_hz: float
    observation: tuple[Entry, ...]
    action: tuple[Entry, ...]
    robot: dict[str, Any] = field(default_factory=dict)
    options: dict[str, Any] = field(default_factory=dict)
    camera: str | None = None
    image_px: int = 0

    @property
    def image_key(self) -> str | None:
        """Name of the camera's feature in the LeRobot format."""
        return None if self.camera is None else f"observation.images.{self.camera}"

    def to_json(self) -> bytes:
        """Content of ``meta/bricksrl.json``."""
        vectors = {key: [_entry_to_json(entry) for entry in getattr(self, key)] for key in ("observation", "action")}
        return (json.dumps({"bricksrl_dataset": VERSION, **dataclasses.asdict(self), **vectors}, indent=1) + "\n").encode()

    @classmethod
    def from_json(cls, data: bytes, where: str) -> Description:
        """Inverse of `to_json`. Raises DataError if the data is no such description, or damaged."""
        try:
            values = json.loads(data)
        except (ValueError, RecursionError):
            raise DataError(f"{where} is not JSON; restore it from a copy") from None
        if not isinstance(values, dict) or values.pop("bricksrl_dataset", None) != VERSION:
            raise DataError(f"{where} describes no dataset of this version of BricksRL; choose another")
        try:
            for key in ("observation", "action"):
                values[key] = tuple(_entry_from_json(entry) for entry in values[key])
            check_fields(cls, values)
            description = cls(**values)
            camera, image_px = description.camera, description.image_px
            has_sound_camera = image_px == 0 if camera is None else camera.isidentifier() and image_px > 0
            has_entries = description.observation and description.action
            if not (has_entries and has_sound_camera and 0 < description.rate_hz < math.inf):
                raise ValueError("not a description")
        except (AttributeError, KeyError, TypeError, ValueError):
            raise DataError(f"{where} is damaged; restore it from a copy") from None
        return description

    def differences(self, other: Description) -> list[str]:
        """Differences to ``other``, a phrase for each attribute; empty if data of both may be joined."""
        phrases = []
        for name in ("env", "rate_hz", "camera", "image_px", "options"):
            own, others = getattr(self, name), getattr(other, name)
            if own != others:
                phrases.append(f"{name} {others} instead of {own}")
        for name in ("observation", "action"):
            own, others = getattr(self, name), getattr(other, name)
            if own != others:
                phrases.append(f"{name} {_difference(own, others)}")
        if self.robot != other.robot:
            own, others = self.robot.get("name", "none"), other.robot.get("name", "none")
            same = "the same name with another description"
            phrases.append(f"robot {others} instead of {own}" if own != others else f"robot {own}: {same}")
        return phrases


def _difference(own: tuple[Entry, ...], others: tuple[Entry, ...]) -> str:
    names, other_names = [entry.name for entry in own], [entry.name for entry in others]
    if names != other_names:
        return f"[{', '.join(other_names)}] instead of [{', '.join(names)}]"
    changed = [a.name for a, b in zip(own, others, strict=True) if a != b]
    return f"with another unit or range of {', '.join(changed)}"


def describe(env: EnvBase, options: dict[str, Any] | None = None, *, name: str | None = None) -> Description:
    """Description of an environment, ours or any other with one observation and one action vector.

    Args:
        options: options of the environment.
        name: name of an environment without a task; by default that of its class.
    """
    from bricksrl.envs.env_interface import interface_of

    task = interface_of(env).task
    if task is not None:
        return describe_task(task, options)
    from bricksrl.envs.specs import entries_of, spec_entries

    entries = entries_of(env), spec_entries(env.action_spec, "action")
    return Description(name or type(env).__name__, 1.0, *entries, options=_plain(options or {}))


def describe_task(task: Task, options: dict[str, Any] | None = None) -> Description:
    """Description of data recorded in a task."""
    camera = task.camera
    return Description(
        env=task.id,
        rate_hz=task.rate_hz,
        observation=tuple(Entry(e.name, e.low, e.high, e.unit, wraps=e.wraps) for e in task.entries),
        action=tuple(command.entry for command in task.interface.commands),
        robot={name: value for name, value in _plain(task.robot).items() if name not in ("model", "plan")},  # of its simulation
        options=_plain(options or {}),
        camera=None if camera is None else camera.name,
        image_px=0 if camera is None else camera.image_px,
    )


def _entry_to_json(entry: Entry) -> dict[str, Any]:
    low, high = (end if math.isfinite(end) else None for end in (entry.low, entry.high))
    return {"name": entry.name, "unit": entry.unit, "low": low, "high": high, "wraps": entry.wraps}


def _entry_from_json(values: dict[str, Any]) -> Entry:
    low, high = (default if values.get(end) is None else values[end] for end, default in (("low", -math.inf), ("high", math.inf)))
    entry = Entry(**{**values, "low": low, "high": high})
    check_fields(Entry, vars(entry))
    return entry


def _plain(value: Any) -> Any:
    """Convert dataclasses, enums and tuples to JSON types."""
    if dataclasses.is_dataclass(value):
        return {f.name: _plain(getattr(value, f.name)) for f in dataclasses.fields(value)}
    if isinstance(value, enum.Enum):
        return _plain(value.value)
    if isinstance(value, dict):
        return {str(key): _plain(item) for key, item in value.items()}
    if isinstance(value, (list, tuple)):
        return [_plain(item) for item in value]
    return value
