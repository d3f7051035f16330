"""Import of the paper's datasets: folders of memory-mapped tensors, as the released code saved its replay buffers.

A folder holds ``meta.json`` with shapes and types, one ``.memmap`` file of plain numbers for each tensor, and the same below
``next``. Only these are read; nothing is unpickled.

The released code differs from the paper in orders and ranges, which is undone here: angles from -180 to 179 become 0 to 360; the
Walker's actions are ordered left front, left back, right front, right back; the RoboArm's angles and goals grab, high, low,
rotation. Some versions of its Walker report an acceleration instead of the distance: the channel is then renamed. Time limits
were stored like any other end; here they become truncations.
"""

from __future__ import annotations

import json
import math
from collections.abc import Iterator
from dataclasses import dataclass, replace
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np
from numpy.typing import NDArray

from bricksrl.data.edit import write_dataset
from bricksrl.data.episode import About, EpisodeData, Step, new_episode
from bricksrl.data.schema import describe_task
from bricksrl.entry import Entry
from bricksrl.errors import DataError

if TYPE_CHECKING:
    from bricksrl.data.episode_index import Index
    from bricksrl.data.schema import Description
    from bricksrl.envs.task import Task

_TYPES = {
    "torch.float32": np.float32,
    "torch.float64": np.float64,
    "torch.int64": np.int64,
    "torch.bool": np.bool_,
    "torch.uint8": np.uint8,
}
_MAX_META_BYTES = 1_000_000
Arrays = dict[str, NDArray[Any]]


@dataclass(frozen=True)
class _Order:
    """Indices of the released code's columns, in our order."""

    observation: tuple[int, ...]
    action: tuple[int, ...]


_ORDERS = {
    "Walker-v0": _Order((0, 1, 2, 3, 4, 5, 6), (0, 2, 1, 3)),
    "RoboArm-v0": _Order((3, 2, 1, 0, 7, 6, 5, 4), (0, 1, 2, 3)),
    "RunAway-v0": _Order((0, 1, 2, 3, 4), (0,)),
    "Spinning-v0": _Order((0, 1, 2, 3, 4, 5), (0, 1)),
}


@dataclass(frozen=True)
class Imported:
    """Imported dataset: its source, its new folder and its index."""

    source: Path
    out: Path
    index: Index


def import_paper(source: Path, out: Path, *, env: str | None = None) -> list[Imported]:
    """Import one of the paper's datasets into ``out``, or all below a folder, each into a subfolder of ``out``. Raises DataError
    if there is no dataset, one is damaged, or ``out`` exists.

    Args:
        env: environment of the datasets; by default inferred from the names of the folders.
    """
    folders = [path.parent for path in sorted(source.rglob("meta.json")) if (path.parent / "next").is_dir()]
    if not folders:
        raise DataError(f"there is no dataset of memory-mapped tensors in {source}; choose a folder with a meta.json and a next")
    imported = []
    for folder in folders:
        task = env or _task_of(folder)
        policy = "expert" if "expert" in folder.name else "random" if "random" in folder.name else folder.name
        target = out if folder == source else out / f"{task}-{policy}"
        imported.append(Imported(folder, target, _import_one(folder, target, task, policy)))
    return imported


def _task_of(folder: Path) -> str:
    for part in reversed(folder.resolve().parts):
        for env in _ORDERS:
            if env.removesuffix("-v0").lower() in part.lower():
                return env
    raise DataError(f"the names of {folder} do not tell which task it is of; say it: --env {' or '.join(_ORDERS)}")


def _import_one(folder: Path, out: Path, env: str, policy: str) -> Index:
    from bricksrl.envs import get_task

    if env not in _ORDERS:
        raise DataError(f"the paper has no dataset of {env}; choose one of {', '.join(_ORDERS)}")
    task = get_task(env)
    current, after = read_tensors(folder), read_tensors(folder / "next")
    _require(current, ("observation", "action"), folder)
    _require(after, ("observation", "reward", "done"), folder / "next")
    observation, next_observation = (_observations(arrays, task, folder) for arrays in (current, after))
    action = _rows(current, "action", folder)
    rows = (len(observation), len(next_observation), len(action), after["reward"].size, after["done"].size)
    if len(set(rows)) != 1 or action.shape[1] != len(_ORDERS[env].action):
        raise DataError(f"{folder} holds tensors of shapes that are not those of {env}; name its task with --env")
    action = action[:, list(_ORDERS[env].action)]
    description = _description(task, observation)
    done, reward = after["done"].reshape(-1).astype(bool), after["reward"].reshape(-1).astype(np.float64)
    # Where the next row does not continue this one, an episode ended too.
    jumps = np.append(~np.isclose(observation[1:], next_observation[:-1], equal_nan=True).all(axis=1), True)
    return write_dataset(
        out, description, _episodes(description, task, policy, observation, action, reward, next_observation, done, jumps)
    )


def _episodes(
    description: Description,
    task: Task,
    policy: str,
    observation: NDArray[Any],
    action: NDArray[Any],
    reward: NDArray[Any],
    after: NDArray[Any],
    done: NDArray[np.bool_],
    jumps: NDArray[np.bool_],
) -> Iterator[EpisodeData]:
    start = 0
    for end in np.flatnonzero(done | jumps):
        steps = []
        for i in range(start, end + 1):
            last = i == end
            ended = bool(last and done[i] and i + 1 - start < task.max_steps)
            steps.append(
                Step(observation[i], action[i], float(reward[i]), after[i], terminated=ended, truncated=last and not ended)
            )
        yield new_episode(steps, About(policy=policy, whole=bool(done[end])), description)
        start = int(end) + 1


def _require(arrays: Arrays, names: tuple[str, ...], folder: Path) -> None:
    missing = [name for name in names if name not in arrays]
    if missing:
        raise DataError(f"{folder} has no tensor {', '.join(missing)}; it is not a dataset of the paper")
    for name in names:
        with np.errstate(all="ignore"):
            is_finite = np.isfinite(arrays[name].astype(np.float32)).all()
        if not is_finite:
            raise DataError(f"{folder} has numbers in its tensor {name} that are none, or too large; restore it from a copy")


def _rows(arrays: Arrays, name: str, folder: Path) -> NDArray[Any]:
    """Tensor reshaped to ``[N, n]``."""
    array = arrays[name]
    if array.size == 0 or array.ndim == 0:
        raise DataError(f"{folder} has no steps in its tensor {name}; restore it from a copy")
    return array.reshape(len(array), -1)


def _observations(arrays: Arrays, task: Task, folder: Path) -> NDArray[np.float32]:
    """Observations ``[N, n]`` in our order and ranges."""
    env = task.id
    parts = [_rows(arrays, "observation", folder)]
    if env == "RoboArm-v0":
        _require(arrays, ("goal_observation",), folder)
        parts.append(_rows(arrays, "goal_observation", folder))
    order = list(_ORDERS[env].observation)
    width = sum(part.shape[1] for part in parts)
    if width != len(order):
        raise DataError(f"{folder} observes {width} numbers and {env} has {len(order)}; name its task with --env")
    if len({len(part) for part in parts}) != 1:
        raise DataError(f"{folder} has observations and goals of different numbers of steps; restore it from a copy")
    joined = np.concatenate(parts, axis=1).astype(np.float32)
    ordered: NDArray[np.float32] = joined[:, order]
    for i, entry in enumerate(task.entries):
        if entry.wraps:
            ordered[:, i] %= 360.0
    return ordered


def _description(task: Task, observation: NDArray[np.float32]) -> Description:
    """Description of the task, with the last channel renamed where the released code reports an acceleration in it."""
    description = describe_task(task)
    last, values = description.observation[-1], observation[:, -1]
    if last.name == "distance" and ((values < 0).any() or (values > 2000).any()):
        acceleration = Entry("acceleration_x", unit="mm/s^2")
        description = replace(description, observation=(*description.observation[:-1], acceleration))
    return description


def read_tensors(folder: Path) -> Arrays:
    """Read the tensors of one folder, by name, as plain numbers. Raises DataError if ``meta.json`` or a file is missing, damaged
    or of the wrong size."""
    meta = folder / "meta.json"
    try:
        if meta.stat().st_size > _MAX_META_BYTES:
            raise DataError(f"{meta} is too large for what it should hold; it is not of the paper")
        tensors = json.loads(meta.read_bytes())
    except OSError as error:
        raise DataError(f"cannot read {meta} ({error.strerror}); choose a folder with memory-mapped tensors") from None
    except (ValueError, RecursionError):
        raise DataError(f"{meta} is not JSON; restore it from a copy") from None
    if not isinstance(tensors, dict):
        raise DataError(f"{meta} describes no tensors; restore it from a copy")
    return {name: _read_tensor(folder, name, entry) for name, entry in tensors.items() if _is_tensor(entry)}


def _is_tensor(entry: Any) -> bool:
    return isinstance(entry, dict) and "dtype" in entry and "shape" in entry


def _read_tensor(folder: Path, name: str, entry: dict[str, Any]) -> NDArray[Any]:
    dtype, shape = _TYPES.get(str(entry["dtype"])), entry["shape"]
    is_shape = isinstance(shape, list) and len(shape) <= 8 and all(type(side) is int and side >= 0 for side in shape)
    if dtype is None or not is_shape or not name.isidentifier():
        raise DataError(f"{folder / 'meta.json'} describes a tensor '{name}' that is not of the paper; restore it from a copy")
    path = folder / f"{name}.memmap"
    try:
        data = path.read_bytes()
    except OSError as error:
        raise DataError(f"cannot read {path} ({error.strerror}); restore it from a copy") from None
    if len(data) != math.prod(shape) * np.dtype(dtype).itemsize:
        raise DataError(f"{path} has {len(data)} bytes, which is not what its meta.json says; restore it from a copy")
    return np.frombuffer(data, dtype).reshape(shape).copy()
