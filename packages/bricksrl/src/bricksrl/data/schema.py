"""Schema of a dataset, equal for all its episodes: names, order, units and rate of its numbers, and
the columns and files that hold them. These are LeRobot's, version 3.0. A column of vectors of
length 1 holds plain numbers, as in LeRobot.
"""

from __future__ import annotations

import dataclasses
import enum
import functools
import hashlib
import json
import logging
import math
from dataclasses import dataclass, field
from typing import TYPE_CHECKING, Any

from brickhub.entry import Entry
from brickhub.fields import check_fields
from brickhub.files import reading
from bricksrl.errors import DataError

_log = logging.getLogger(__name__)

if TYPE_CHECKING:
    from torchrl.envs import EnvBase

    from bricksrl.envs.task import Task

VERSION = 1
"""Version of the schema; others are refused."""
CODEBASE_VERSION = "v3.0"
CHUNK_SIZE = 1000
"""Maximum number of files in a folder."""
FILES = {
    "info": "meta/info.json",  # number of episodes, columns, paths; written last
    "stats": "meta/stats.json",  # minimum, maximum, mean and deviation of every column
    "tasks": "meta/tasks.parquet",  # the task instruction, in words
    "description": "meta/bricksrl.json",  # robot, units, ranges; LeRobot does not read it
    # a row for each episode
    "episodes": "meta/episodes/chunk-{chunk_index:03d}/file-{file_index:03d}.parquet",
    "data": "data/chunk-{chunk_index:03d}/file-{file_index:03d}.parquet",  # a row for each step
    # an image for each step
    "video": "videos/{video_key}/chunk-{chunk_index:03d}/file-{file_index:03d}.mp4",
}
"""Files by kind; there are several of the last three."""

OBSERVATION = "observation.state"
ACTION = "action"
NEXT = "next.observation.state"
STEP_COLUMNS = {
    "observation": OBSERVATION,
    "action": ACTION,
    "reward": "next.reward",
    "next_observation": NEXT,
    "terminated": "next.terminated",
    "truncated": "next.truncated",
    "intervention": "intervention",
    "age_s": "age_s",
    "hub_time_s": "hub_time_s",
}
"""Column of each attribute of a step, except its images."""
_NUMBERS = {
    "next.reward": "float32",
    "next.done": "bool",
    "next.terminated": "bool",
    "next.truncated": "bool",
    "intervention": "bool",
    "age_s": "float32",
    "hub_time_s": "float64",
    "timestamp": "float32",
    "frame_index": "int64",
    "episode_index": "int64",
    "index": "int64",
    "task_index": "int64",
}
"""Types of the columns of single numbers."""


@dataclass(frozen=True)
class Description:
    """Description of recorded data.

    Attributes:
        env: id of the environment.
        rate_hz: nominal steps per second of the task; 1 if its steps have no fixed time.
        observation, action: entries of the vectors; actions are in -1..1, their entries give the
            mapped ranges.
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

    @functools.cached_property
    def features(self) -> dict[str, dict[str, Any]]:
        """Columns as declared in ``info.json``."""
        vectors = {OBSERVATION: self.observation, ACTION: self.action, NEXT: self.observation}
        columns: dict[str, dict[str, Any]] = {}
        for column, entries in vectors.items():
            columns[column] = {
                "dtype": "float32",
                "shape": [len(entries)],
                "names": [entry.name for entry in entries],
            }
        columns |= {
            column: {"dtype": dtype, "shape": [1], "names": None}
            for column, dtype in _NUMBERS.items()
        }
        if self.image_key is not None:
            side = self.image_px
            columns[self.image_key] = {
                "dtype": "video",
                "shape": [side, side, 3],
                "names": ["height", "width", "channels"],
                "info": {
                    "video.height": side,
                    "video.width": side,
                    "video.codec": "h264",
                    "video.pix_fmt": "gbrp",
                    "video.is_depth_map": False,
                    "video.fps": self._fps,
                    "video.channels": 3,
                    "has_audio": False,
                },
            }
        return columns

    @property
    def _fps(self) -> int | float:
        """Steps per second, as an integer if possible, as in LeRobot."""
        return int(self.rate_hz) if self.rate_hz.is_integer() else self.rate_hz

    def info(
        self,
        episodes: int,
        steps: int,
    ) -> dict[str, Any]:
        """Content of ``info.json`` for so many episodes and steps."""
        return {
            "codebase_version": CODEBASE_VERSION,
            "robot_type": self.robot.get("name"),
            "total_episodes": episodes,
            "total_frames": steps,
            "total_tasks": 1,
            "chunks_size": CHUNK_SIZE,
            "data_files_size_in_mb": 100,
            "video_files_size_in_mb": 200,
            "fps": self._fps,
            "splits": {"train": f"0:{episodes}"},
            "data_path": FILES["data"],
            "video_path": None if self.camera is None else FILES["video"],
            "features": self.features,
        }

    def to_json(self) -> bytes:
        """Content of ``meta/bricksrl.json``."""
        vectors = {
            key: [_entry_to_json(entry) for entry in getattr(self, key)]
            for key in ("observation", "action")
        }
        values = {"bricksrl_dataset": VERSION, **dataclasses.asdict(self), **vectors}
        whole = {**values, "sha256": digest_of(values)}
        return (json.dumps(whole, indent=1) + "\n").encode()

    @classmethod
    def from_json(
        cls,
        data: bytes,
        where: str,
    ) -> Description:
        """Inverse of `to_json`. Raises DataError if the data is no such description, or damaged."""
        with reading(
            "the description",
            where,
            DataError,
            "restore it from a copy",
        ):
            values = dict(json.loads(data))
            digest = values.pop("sha256", None)
            expected_digest = digest_of(values)
            if values.pop("bricksrl_dataset", None) != VERSION:
                raise DataError(
                    f"{where} describes no dataset of this version of BricksRL; choose another"
                )
            # A letter of a name or a digit of a range may be spoiled, and still be a description.
            if digest != expected_digest:
                raise DataError(f"{where} is damaged or was edited; restore it from a copy")
            for key in ("observation", "action"):
                values[key] = tuple(_entry_from_json(entry) for entry in values[key])
            check_fields(cls, values)
            description = cls(**values)
            camera = description.camera
            image_px = description.image_px
            if camera is None:
                has_sound_camera = image_px == 0
            else:
                # The camera's name becomes that of a folder, and must not lead out of the
                # dataset's.
                has_sound_camera = camera.isidentifier() and image_px > 0
            has_entries = description.observation and description.action
            has_rate = 0 < description.rate_hz < math.inf
            if not (has_entries and has_sound_camera and has_rate):
                raise ValueError("not a description")
        return description

    def differences(self, other: Description) -> list[str]:
        """Differences to ``other``, a phrase for each attribute; empty if data of both may be
        joined."""
        phrases = []
        for name in ("env", "rate_hz", "camera", "image_px", "options"):
            own = getattr(self, name)
            others = getattr(other, name)
            if own != others:
                phrases.append(f"{name} {others} instead of {own}")
        for name in ("observation", "action"):
            own = getattr(self, name)
            others = getattr(other, name)
            names = [entry.name for entry in own]
            other_names = [entry.name for entry in others]
            # Changed names are reported alone, because they are the reason for everything else that
            # differs.
            changed = [a.name for a, b in zip(own, others, strict=False) if a != b]
            if names != other_names:
                phrases.append(f"{name} [{', '.join(other_names)}] instead of [{', '.join(names)}]")
            elif changed:
                phrases.append(f"{name} with another unit or range of {', '.join(changed)}")
        if self.robot != other.robot:
            own = self.robot.get("name", "none")
            others = other.robot.get("name", "none")
            if own != others:
                phrases.append(f"robot {others} instead of {own}")
            else:
                phrases.append(f"robot {own}: the same name with another description")
        return phrases


def digest_of(values: dict[str, Any]) -> str:
    """SHA-256 of values, whatever the order and the spaces of their JSON."""
    return hashlib.sha256(json.dumps(values, sort_keys=True).encode()).hexdigest()


def describe(
    env: EnvBase,
    options: dict[str, Any] | None = None,
    *,
    name: str | None = None,
) -> Description:
    """Description of an environment, ours or any other with one observation and one action vector.

    Args:
        options: options of the environment.
        name: name of an environment without a task; by default that of its class.
    """
    from bricksrl.envs.env_interface import interface_of

    task = interface_of(env).task
    if task is not None:
        return describe_task(task, options)
    from bricksrl.envs.specs import spec_entries
    from bricksrl.envs.transforms import base_of

    # The environment's own observations are recorded, because what transforms make of them follows
    # from these.
    env = base_of(env)
    return Description(
        env=name or type(env).__name__,
        rate_hz=1.0,
        observation=spec_entries(env.full_observation_spec_unbatched["observation"], "observation"),
        action=spec_entries(env.action_spec, "action"),
        options=_plain(options or {}),
    )


def describe_task(task: Task, options: dict[str, Any] | None = None) -> Description:
    """Description of data recorded in a task."""
    camera = task.camera
    if unrecorded := sorted(set(task.images) - {"image"}):
        _log.warning(
            "a dataset holds the images of one camera, the task's; those of %s are not recorded",
            ", ".join(unrecorded),
        )
    robot = _plain(task.robot)
    # Model and plan belong to the simulation alone. Without them, data of a robot and of its twin
    # can be joined.
    robot.pop("model", None)
    robot.pop("plan", None)
    return Description(
        env=task.id,
        rate_hz=task.rate_hz,
        observation=tuple(
            Entry(
                entry.name,
                entry.low,
                entry.high,
                entry.unit,
                wraps=entry.wraps,
            )
            for entry in task.entries
        ),
        action=tuple(command.entry for command in task.interface.commands),
        robot=robot,
        options=_plain(options or {}),
        camera=None if camera is None else camera.name,
        image_px=0 if camera is None else camera.image_px,
    )


def _entry_to_json(entry: Entry) -> dict[str, Any]:
    # JSON has no infinity, although Python would write one that no other program reads.
    low, high = (end if math.isfinite(end) else None for end in (entry.low, entry.high))
    return {"name": entry.name, "unit": entry.unit, "low": low, "high": high, "wraps": entry.wraps}


def _entry_from_json(values: dict[str, Any]) -> Entry:
    ends = {"low": -math.inf, "high": math.inf}
    for end in ends:
        if values.get(end) is not None:
            ends[end] = values[end]
    entry = Entry(**{**values, **ends})
    check_fields(Entry, vars(entry))
    return entry


def _plain(value: Any) -> Any:
    """Dataclasses, enums and tuples as JSON types."""

    def parts(value: Any) -> Any:
        if isinstance(value, enum.Enum):
            return value.value
        return {field.name: getattr(value, field.name) for field in dataclasses.fields(value)}

    return json.loads(json.dumps(value, default=parts))
