"""Datasets in the formats of others: export to Minari; import of what LeRobot recorded, and of the
paper's datasets.

The paper's datasets are folders of memory-mapped tensors, as the released code saved its replay
buffers. A folder holds ``meta.json`` with shapes and types, one ``.memmap`` file of plain numbers
for each tensor, and the same below ``next``. Only these are read; nothing is unpickled.

The released code differs from the paper in orders and ranges, which is undone here: angles from
-180 to 179 become 0 to 360; the Walker's actions are ordered left front, left back, right front,
right back; the RoboArm's angles and goals grab, high, low, rotation. Some versions of its Walker
report an acceleration instead of the distance: the channel is then renamed. Time limits were stored
like any other end; here they become truncations.
"""

from __future__ import annotations

import json
import math
import os
import re
import shutil
import warnings
from collections.abc import Iterator
from contextlib import contextmanager
from dataclasses import replace
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np
from numpy.typing import NDArray

from brickhub.entry import Entry
from brickhub.files import atomic_folder, reading
from bricksrl.data.columns import read_bytes
from bricksrl.data.dataset import About, Dataset, refuse_target
from bricksrl.data.edit import write_dataset
from bricksrl.data.lerobot import read_lerobot
from bricksrl.data.reader import Episodes, load
from bricksrl.data.schema import describe_task
from bricksrl.data.steps import Step, new_episode
from bricksrl.envs.registry import options_of
from bricksrl.errors import DataError, installed

if TYPE_CHECKING:
    from torch import Tensor

    from bricksrl.envs.task import Task

_TYPES = {
    f"torch.{name}": np.dtype(name) for name in ("float32", "float64", "int64", "bool", "uint8")
}
_MAX_META_BYTES = 1_000_000
Arrays = dict[str, NDArray[Any]]

_ORDERS = {
    "Walker-v0": ([0, 1, 2, 3, 4, 5, 6], [0, 2, 1, 3]),
    "RoboArm-v0": ([3, 2, 1, 0, 7, 6, 5, 4], [0, 1, 2, 3]),
    "RunAway-v0": ([0, 1, 2, 3, 4], [0]),
    "Spinning-v0": ([0, 1, 2, 3, 4, 5], [0, 1]),
}
"""Columns of the released code's observations and actions, in our order, by environment."""


def export_minari(path: Path, out: Path) -> None:
    """Write a Minari dataset into the folder ``out``, named as Minari requires:
    ``namespace/name-v0`` below any folder.

    `minari.load_dataset` finds it if ``MINARI_DATASETS_PATH`` is that folder. `recover_environment`
    makes the environment with a virtual robot, if it is one that comes with BricksRL.

    Raises:
        DataError: the dataset cannot be read, ``out`` exists or does not end like
            ``bricksrl/walker-v0``, or Minari is not installed.
    """
    with installed("Minari", DataError, '"bricksrl[data]"'):
        import minari
        from minari.data_collector import EpisodeBuffer
        from minari.namespace import NAMESPACE_METADATA_FILENAME
    refuse_target(out)
    name = f"{out.absolute().parent.name}/{out.name}"
    # Minari 0.5 asks for a version too, but ends in a TypeError without one.
    if re.search(r"-v\d+$", out.name) is None:
        raise DataError(f"{name} has no version; end the path like bricksrl/walker-v0")
    episodes = load(path)
    buffers = [EpisodeBuffer(**_minari_episode(episodes, k)) for k in range(len(episodes.rows))]
    policies = dict.fromkeys(row.about.policy for row in episodes.rows)
    with atomic_folder(out) as folder, _datasets_in(folder / "new"), warnings.catch_warnings():
        # Minari warns that no authors are named.
        warnings.simplefilter("ignore")
        try:
            minari.create_dataset_from_buffers(
                name,
                buffers,
                **_minari_environment(episodes),
                algorithm_name=", ".join(policies),
                description=f"{episodes.description.env}, recorded with BricksRL",
                data_format="hdf5",
                jpeg_encoding=False,
            )
        except ValueError as error:
            raise DataError(
                f"Minari refuses the name {name} ({error}); end the path like bricksrl/walker-v0"
            ) from None
        # Minari writes into a folder with the dataset's name inside of its own. Only that inner
        # folder was asked for, and it must appear whole or not at all.
        for written in (folder / "new" / name).iterdir():
            written.rename(folder / written.name)
        namespace = (folder / "new" / name).parent / NAMESPACE_METADATA_FILENAME
        if not (out.parent / namespace.name).exists():
            namespace.rename(out.parent / namespace.name)
        shutil.rmtree(folder / "new")


def _minari_episode(episodes: Episodes, episode: int) -> dict[str, Any]:
    at = (episodes.episode == episode).numpy()

    def with_last(before: Tensor, after: Tensor) -> NDArray[Any]:
        # Minari has one observation more than steps, which is the one after the last step.
        return np.concatenate((before[at].numpy(), after[at][-1:].numpy()))

    states = with_last(episodes.observation, episodes.next_observation)
    observations: Any = states
    if episodes.image is not None and episodes.next_image is not None:
        images = with_last(episodes.image, episodes.next_image)
        observations = {"observation": states, "image": images}
    return {
        "id": episode,
        "seed": episodes.rows[episode].about.seed,
        "observations": observations,
        "actions": episodes.action[at].numpy(),
        "rewards": episodes.reward[at].tolist(),
        "terminations": episodes.terminated[at].tolist(),
        "truncations": episodes.truncated[at].tolist(),
        "infos": {"intervention": [False, *episodes.intervention[at].tolist()]},
    }


def _minari_environment(episodes: Episodes) -> dict[str, Any]:
    """Spaces of the environment, and Gymnasium's specification of it with its options; ``None`` if
    it is not registered."""
    import gymnasium

    env_id = episodes.description.env
    options = episodes.description.options
    spec = gymnasium.registry.get(f"bricksrl/{env_id}")
    # Only options of the task are taken. Anything else that a file names, such as a transform, is
    # left out, because Minari's `recover_environment` would execute it.
    if spec is not None:
        spec = replace(spec, kwargs=spec.kwargs | options_of(env_id, options))
    box = gymnasium.spaces.Box(-np.inf, np.inf, tuple(episodes.observation.shape[1:]))
    observation_space: Any = box
    if episodes.image is not None:
        image = gymnasium.spaces.Box(
            0,
            255,
            tuple(episodes.image.shape[1:]),
            np.uint8,
        )
        observation_space = gymnasium.spaces.Dict({"observation": box, "image": image})
    return {
        "env": spec,
        "observation_space": observation_space,
        "action_space": gymnasium.spaces.Box(-1.0, 1.0, tuple(episodes.action.shape[1:])),
    }


@contextmanager
def _datasets_in(folder: Path) -> Iterator[None]:
    """Set Minari's folder, which it takes from an environment variable only."""
    before = os.environ.get("MINARI_DATASETS_PATH")
    os.environ["MINARI_DATASETS_PATH"] = str(folder.resolve())
    try:
        yield
    finally:
        if before is None:
            del os.environ["MINARI_DATASETS_PATH"]
        else:
            os.environ["MINARI_DATASETS_PATH"] = before


def import_lerobot(
    source: Path,
    out: Path,
    *,
    env: str | None = None,
) -> Dataset:
    """Write such a dataset as one of ours. Raises DataError as `read_lerobot`, and if ``out``
    exists."""
    description, episodes = read_lerobot(source, env)
    return write_dataset(out, description, episodes)


def import_paper(
    source: Path,
    out: Path,
    *,
    env: str | None = None,
) -> list[tuple[Path, Dataset]]:
    """Import one of the paper's datasets into ``out``, or all below a folder, each into a subfolder
    of ``out``; returns each with its source. Raises DataError if there is no dataset, one is
    damaged, or ``out`` exists.

    Args:
        env: environment of the datasets; by default inferred from the names of the folders.
    """
    candidates = [path.parent for path in sorted(source.rglob("meta.json"))]
    folders = [folder for folder in candidates if (folder / "next").is_dir()]
    if not folders:
        raise DataError(
            f"there is no dataset of memory-mapped tensors in {source}; choose a folder with a "
            "meta.json and a next"
        )
    imported = []
    for folder in folders:
        task = env or _task_of(folder)
        policy = _policy_of(folder)
        target = out if folder == source else out / f"{task}-{policy}"
        imported.append((folder, _import_one(folder, target, task, policy)))
    return imported


def _policy_of(folder: Path) -> str:
    """Policy that the paper recorded with, after which its folders are named."""
    for policy in ("expert", "random"):
        if policy in folder.name:
            return policy
    return folder.name


def _task_of(folder: Path) -> str:
    for part in reversed(folder.resolve().parts):
        for env in _ORDERS:
            if env.removesuffix("-v0").lower() in part.lower():
                return env
    raise DataError(
        f"the names of {folder} do not tell which task it is of; say it: --env "
        f"{' or '.join(_ORDERS)}"
    )


def _import_one(
    folder: Path,
    out: Path,
    env: str,
    policy: str,
) -> Dataset:
    from bricksrl.envs import get_task

    if env not in _ORDERS:
        raise DataError(f"the paper has no dataset of {env}; choose one of {', '.join(_ORDERS)}")
    task = get_task(env)
    action_order = _ORDERS[env][1]
    current = read_tensors(folder)
    after = read_tensors(folder / "next")
    observation = _observations(current, task, folder)
    action = _rows(current, "action", folder)
    next_observation = _observations(after, task, folder / "next")
    reward = _rows(after, "reward", folder / "next").reshape(-1)
    done = _rows(after, "done", folder / "next").reshape(-1)
    lengths = {len(observation), len(next_observation), len(action), len(reward), len(done)}
    if len(lengths) != 1 or action.shape[1] != len(action_order):
        raise DataError(
            f"{folder} holds tensors of shapes that are not those of {env}; name its task "
            "with --env"
        )
    done = done.astype(bool)
    # An episode also ended where the next row does not continue this one.
    is_same = np.isclose(observation[1:], next_observation[:-1], equal_nan=True)  # [N - 1, n]
    jumps = np.append(~is_same.all(axis=1), True)
    ends = np.flatnonzero(done | jumps)
    lengths_of = np.diff(ends, prepend=-1)
    # The released code stored a time limit like any other end, so an episode that reached the limit
    # counts as cut by it.
    terminated = np.zeros_like(done)
    truncated = np.zeros_like(done)
    terminated[ends] = done[ends] & (lengths_of < task.max_steps)
    truncated[ends] = ~terminated[ends]
    columns = (
        observation,
        action[:, action_order],
        reward.tolist(),
        next_observation,
        terminated.tolist(),
        truncated.tolist(),
    )
    steps = [Step(*row) for row in zip(*columns, strict=True)]
    description = describe_task(task)
    last = description.observation[-1]
    values = observation[:, -1]
    # Some versions of the released Walker report an acceleration in this place. A distance is 0 to
    # 2000 mm, by which the two are told apart.
    if last.name == "distance" and ((values < 0).any() or (values > 2000).any()):
        acceleration = Entry("acceleration_x", unit="mm/s^2")
        description = replace(
            description, observation=(*description.observation[:-1], acceleration)
        )
    episodes = []
    for end, length in zip(ends, lengths_of, strict=True):
        about = About(policy=policy, whole=bool(done[end]))
        episodes.append(new_episode(steps[end + 1 - length : end + 1], about, description))
    return write_dataset(out, description, episodes)


def _rows(
    arrays: Arrays,
    name: str,
    folder: Path,
) -> NDArray[Any]:
    """A tensor as ``[N, n]``. Raises DataError if there is none, or it has no rows or numbers that
    are none."""
    if name not in arrays:
        raise DataError(f"{folder} has no tensor {name}; it is not a dataset of the paper")
    array = arrays[name]
    with np.errstate(all="ignore"):
        is_finite = np.isfinite(array.astype(np.float32)).all()
    if not is_finite:
        raise DataError(
            f"{folder} has numbers in its tensor {name} that are none, or too large; restore it "
            "from a copy"
        )
    if array.size == 0 or array.ndim == 0:
        raise DataError(f"{folder} has no steps in its tensor {name}; restore it from a copy")
    return array.reshape(len(array), -1)


def _observations(
    arrays: Arrays,
    task: Task,
    folder: Path,
) -> NDArray[np.float32]:
    """Observations ``[N, n]`` in our order and ranges."""
    names = ["observation", "goal_observation"] if task.id == "RoboArm-v0" else ["observation"]
    parts = [_rows(arrays, name, folder) for name in names]
    order = _ORDERS[task.id][0]
    width = sum(part.shape[1] for part in parts)
    if width != len(order):
        raise DataError(
            f"{folder} observes {width} numbers and {task.id} has {len(order)}; name its task "
            "with --env"
        )
    if len({len(part) for part in parts}) != 1:
        raise DataError(
            f"{folder} has observations and goals of different numbers of steps; restore it "
            "from a copy"
        )
    joined = np.concatenate(parts, axis=1).astype(np.float32)
    ordered: NDArray[np.float32] = joined[:, order]
    # The released code has angles in -180..179, but here they are in 0..360.
    wraps = [entry.wraps for entry in task.entries]
    ordered[:, wraps] %= 360.0
    return ordered


def read_tensors(folder: Path) -> Arrays:
    """Read the tensors of one folder, by name, as plain numbers. Raises DataError if ``meta.json``
    or a file is missing, damaged or of the wrong size."""
    meta = folder / "meta.json"
    if meta.exists() and meta.stat().st_size > _MAX_META_BYTES:
        raise DataError(f"{meta} is too large for what it should hold; it is not of the paper")
    with reading(
        "the description",
        meta,
        DataError,
        "choose a folder with memory-mapped tensors, or restore it from a copy",
    ):
        tensors = dict(json.loads(meta.read_bytes()))
    arrays = {}
    for name, entry in tensors.items():
        # Beside tensors the file has facts about itself, such as the shape of the batch, which are
        # no data.
        if isinstance(entry, dict) and {"dtype", "shape"} <= entry.keys():
            arrays[name] = _read_tensor(folder, name, entry)
    return arrays


def _read_tensor(
    folder: Path,
    name: str,
    entry: dict[str, Any],
) -> NDArray[Any]:
    dtype = _TYPES.get(str(entry["dtype"]))
    shape = entry["shape"]
    is_list = isinstance(shape, list) and len(shape) <= 8
    is_shape = is_list and all(type(side) is int and side >= 0 for side in shape)
    # The name becomes that of a file, and must not lead out of the folder.
    if dtype is None or not is_shape or not name.isidentifier():
        raise DataError(
            f"{folder / 'meta.json'} describes a tensor '{name}' that is not of the paper; "
            "restore it from a copy"
        )
    path = folder / f"{name}.memmap"
    data = read_bytes(path)
    if len(data) != math.prod(shape) * dtype.itemsize:
        raise DataError(
            f"{path} has {len(data)} bytes, which is not what its meta.json says; restore it "
            "from a copy"
        )
    return np.frombuffer(data, dtype).reshape(shape).copy()
