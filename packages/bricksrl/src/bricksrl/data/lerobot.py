"""Datasets that LeRobot recorded (format v3.0), with the robot plugin of BricksRL or one with the
same names of features.

LeRobot records what was observed before each action, and the action in the units of its command.
What the learner needs besides follows from the task: the next observation is that of the next
frame, rewards and ends are those of the task's own functions, and actions are mapped to -1..1. The
action of an episode's last frame has no outcome and is left out. Where the task ends, a new episode
begins, as LeRobot records on.
"""

from __future__ import annotations

import json
import logging
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np
import pyarrow as pa
from numpy.typing import NDArray

from brickhub.files import quoted, reading
from bricksrl.data.columns import read_parquet
from bricksrl.data.dataset import About, Episode
from bricksrl.data.schema import (
    ACTION,
    CODEBASE_VERSION,
    FILES,
    OBSERVATION,
    Description,
    describe_task,
)
from bricksrl.data.steps import Step, new_episode
from bricksrl.errors import DataError, counted

if TYPE_CHECKING:
    from bricksrl.envs.task import Task

_log = logging.getLogger(__name__)

_ENVS = {
    "bricksrl_walker": "Walker-v0",
    "bricksrl_two_wheeler": "RunAway-v0",
    "bricksrl_robo_arm": "RoboArm-v0",
}
"""Environments of the robots of the plugin, by the type that LeRobot stores."""
_INDICES = ("episode_index", "frame_index", "index")


def is_lerobot(root: Path) -> bool:
    """True if the folder has a dataset that another program wrote in LeRobot's format."""
    return (root / FILES["info"]).exists() and not (root / FILES["description"]).exists()


def read_lerobot(root: Path, task: Task | str | None = None) -> tuple[Description, list[Episode]]:
    """Read the episodes of such a dataset. Nothing in it is executed.

    Args:
        task: whose rewards and ends they get; by default that of the robot which LeRobot names.

    Raises:
        DataError: a part is missing, damaged, or not what the task observes and commands.
    """
    info = _read_info(root)
    task = _task_of(root, info, task)
    states = _features(
        root,
        info,
        OBSERVATION,
        [entry.name for entry in task.entries],
    )
    actions = _features(
        root,
        info,
        ACTION,
        [command.name for command in task.interface.commands],
    )
    _check_judged(root, task)
    features = info["features"].items()
    pictures = [name for name, feature in features if feature.get("dtype") in ("video", "image")]
    if pictures:
        _log.warning("%s has images (%s), which are not read", root, ", ".join(pictures))
    columns = _read_columns(root, info)
    observation = columns[OBSERVATION][:, states]
    commands = task.interface.commands
    low = np.array([command.low for command in commands], np.float32)
    high = np.array([command.high for command in commands], np.float32)
    commanded = columns[ACTION][:, actions]  # [frames, m], in the units of the commands
    action = 2.0 * (commanded - low) / (high - low) - 1.0
    # A robot clamps its commands, so recorded actions are clamped in the same way.
    action = action.clip(-1.0, 1.0)
    description = describe_task(task)
    episodes: list[Episode] = []
    for number in range(info["total_episodes"]):
        at = np.flatnonzero(columns["episode_index"] == number)
        episodes += _episodes(
            task,
            description,
            observation[at],
            action[at],
        )
    if not episodes:
        raise DataError(
            f"no episode in {root} has two frames, and so no action has an outcome; record "
            "longer ones"
        )
    return description, episodes


def _read_info(root: Path) -> dict[str, Any]:
    path = root / FILES["info"]
    with reading(
        "the index",
        path,
        DataError,
        "restore it from a copy",
    ):
        info = dict(json.loads(path.read_bytes()))
        if info.get("codebase_version") != CODEBASE_VERSION:
            version = info.get("codebase_version")
            remedy = "convert it with LeRobot's own script"
            raise DataError(
                f"{root} is in LeRobot's format {version}, not {CODEBASE_VERSION}; {remedy}"
            )
        for name in ("total_episodes", "total_frames"):
            if type(info[name]) is not int or info[name] < 1:
                raise DataError(
                    f"{path} says that {name} is {info[name]!r}; record at least one episode, or "
                    "restore the file"
                )
        if isinstance(info["fps"], bool) or not float(info["fps"]) > 0:
            raise DataError(f"{path} says that fps is {info['fps']!r}; restore it from a copy")
        if not all(isinstance(feature, dict) for feature in dict(info["features"]).values()):
            raise TypeError
    return info


def _task_of(
    root: Path,
    info: dict[str, Any],
    task: Task | str | None,
) -> Task:
    from bricksrl.envs.registry import get_task

    if task is None:
        robot = str(info.get("robot_type"))
        task = _ENVS.get(robot)
        if task is None:
            way = f"say it: `bricksrl data import {quoted(root)} --env ENV --out NEW`"
            raise DataError(
                f"{root} is of a robot '{robot}', which does not tell the environment; {way}"
            )
    return get_task(task) if isinstance(task, str) else task


def _check_judged(root: Path, task: Task) -> None:
    """Raise DataError unless observations tell rewards and ends of the task."""
    reason = ""
    if task.images:
        reason = "it observes images, which are not read"
    elif task.has_hidden_entries:
        reason = "its reward depends on more than the agent observes"
    elif task.base_env is not None:
        reason = "its rewards are those of an environment of one's own"
    if reason:
        raise DataError(
            f"{root} cannot be used for {task.id}: {reason}; record with `bricksrl record "
            f"{task.id}`"
        )


def _features(
    root: Path,
    info: dict[str, Any],
    feature: str,
    wanted: list[str],
) -> list[int]:
    """Places of these names in a feature, a vector."""
    described = info["features"].get(feature)
    if described is None:
        raise DataError(f"{root} has no feature {feature}; record it with a robot that has one")
    names = described.get("names")
    # LeRobot's own robots write names in groups, such as {"motors": [...]}.
    if isinstance(names, dict):
        groups = names.values()
        names = []
        for group in groups:
            names += group if isinstance(group, list) else [group]
    if not isinstance(names, list) or described.get("shape") != [len(names)]:
        raise DataError(
            f"{root} does not name the numbers of {feature}; only a vector with names can be read"
        )
    if missing := [name for name in wanted if name not in names]:
        has = ", ".join(map(str, names))
        raise DataError(
            f"{feature} in {root} has no {', '.join(missing)}, only [{has}]; choose the "
            "environment of these data"
        )
    if unused := [str(name) for name in names if name not in wanted]:
        # Unseen entries of an observation are no loss. But a command that our task does not know
        # has moved the robot, and its effect would be credited to the others.
        if feature == ACTION:
            raise DataError(
                f"{feature} in {root} has {', '.join(unused)} too; choose the environment of "
                "these data"
            )
        _log.warning("%s has %s, which is not observed; it is left out", root, ", ".join(unused))
    return [names.index(name) for name in wanted]


def _read_columns(root: Path, info: dict[str, Any]) -> dict[str, NDArray[Any]]:
    """Columns of all frames, checked: complete, in order, and finite."""
    paths = sorted(root.glob("data/chunk-*/file-*.parquet"))
    if not paths:
        raise DataError(
            f"{root} has no files data/chunk-000/file-000.parquet; restore them from a copy"
        )
    parts = [_read_file(path, info) for path in paths]
    columns = {name: np.concatenate([part[name] for part in parts]) for name in parts[0]}
    frames = len(columns["index"])
    if frames != info["total_frames"]:
        told = counted(info["total_frames"], "frame")
        raise DataError(
            f"{root} has {counted(frames, 'frame')}, and its info.json counts {told}; restore "
            "what is missing"
        )
    if not np.array_equal(columns["index"], np.arange(frames)):
        at = int(np.flatnonzero(columns["index"] != np.arange(frames))[0])
        raise DataError(
            f"{root} has a gap: frame {at} has the index {columns['index'][at]}; restore what "
            "is missing"
        )
    number = columns["episode_index"]
    is_sorted = (np.diff(number) >= 0).all()
    is_complete = np.array_equal(np.unique(number), np.arange(info["total_episodes"]))
    if not (is_sorted and is_complete):
        told = counted(info["total_episodes"], "episode")
        raise DataError(
            f"{root} does not have the {told} of its info.json, one after the other; restore what "
            "is missing"
        )
    # The number of the episode changes at the first frame of each.
    first = np.flatnonzero(np.diff(number, prepend=-1))
    length = np.diff(first, append=frames)
    wanted = np.arange(frames) - np.repeat(first, length)
    if not np.array_equal(columns["frame_index"], wanted):
        at = int(np.flatnonzero(columns["frame_index"] != wanted)[0])
        raise DataError(
            f"{root} has a gap in episode {number[at]}: its frame {wanted[at]} is missing; "
            "restore it"
        )
    for name in (OBSERVATION, ACTION):
        if not np.isfinite(columns[name]).all():
            at = int(np.flatnonzero(~np.isfinite(columns[name]).all(axis=1))[0])
            raise DataError(f"{name} in {root} is no number in frame {at}; leave its episode out")
    return columns


def _read_file(path: Path, info: dict[str, Any]) -> dict[str, NDArray[Any]]:
    table = read_parquet(path)
    columns = {}
    for name in (OBSERVATION, ACTION, *_INDICES):
        if table.column_names.count(name) != 1:
            raise DataError(f"{path} has not one column {name}; restore it from a copy")
        column = table[name].combine_chunks()
        length = info["features"][name]["shape"][0] if name in (OBSERVATION, ACTION) else 1
        # LeRobot has written different kinds of lists in different versions, and all of them are
        # read.
        lists = (pa.types.is_list, pa.types.is_fixed_size_list, pa.types.is_large_list)
        is_list = any(is_kind(column.type) for is_kind in lists)
        flat = column.flatten() if is_list else column
        if length > 1 or is_list:
            is_number = pa.types.is_floating(flat.type)
        else:
            is_number = not pa.types.is_nested(flat.type)
        has_gap = column.null_count or flat.null_count
        if has_gap or not is_number or len(flat) != length * len(column):
            raise DataError(
                f"{path}: the column {name} does not hold {counted(length, 'number')} in each "
                "frame; restore it"
            )
        dtype = np.int64 if name in _INDICES else np.float32
        try:
            values = flat.to_numpy(zero_copy_only=False).astype(dtype)
        except (TypeError, ValueError):
            raise DataError(
                f"{path}: the column {name} holds no numbers; restore it from a copy"
            ) from None
        columns[name] = values if name in _INDICES else values.reshape(-1, length)
    return columns


def _episodes(
    task: Task,
    description: Description,
    states: NDArray[Any],
    actions: NDArray[Any],
) -> list[Episode]:
    """Episodes of the task in the frames of one of LeRobot's: a new one begins where the task
    ends."""
    import torch

    from bricksrl.envs.task import success_of

    if len(states) < 2:
        return []
    before = torch.from_numpy(states[:-1].copy())
    after = torch.from_numpy(states[1:].copy())
    chosen = torch.from_numpy(actions[:-1].astype(np.float32))
    rewards = task.reward(before, chosen, after).reshape(-1).tolist()
    terminated = task.terminated(after).reshape(-1).tolist()
    episodes: list[Episode] = []
    steps: list[Step] = []
    first = 0
    for number, (reward, is_over) in enumerate(zip(rewards, terminated, strict=True)):
        is_last = is_over or number == len(rewards) - 1
        step = Step(
            observation=states[number],
            action=chosen[number].numpy(),
            reward=reward,
            next_observation=states[number + 1],
            terminated=is_over,
            truncated=is_last and not is_over,
        )
        steps.append(step)
        if is_last:
            about = About(policy="lerobot", success=success_of(task, after[first : number + 1]))
            episodes.append(new_episode(steps, about, description))
            steps = []
            first = number + 1
    return episodes
