"""Export of datasets to NumPy, one plain Parquet file, and Minari."""

from __future__ import annotations

import io
import json
import os
import shutil
import warnings
from collections.abc import Iterator
from contextlib import contextmanager
from dataclasses import replace
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np
import pyarrow as pa

from brickhub.files import atomic_folder, refuse_existing, write_durably
from bricksrl.data.columns import to_parquet
from bricksrl.data.reader import COLUMNS, load
from bricksrl.errors import DataError

if TYPE_CHECKING:
    from bricksrl.data.reader import Episodes


def export_numpy(path: Path, out: Path) -> None:
    """Write an ``.npz`` file of arrays over all steps, as in `Episodes`, and ``description``, a JSON text. Raises DataError if
    the dataset cannot be read, or ``out`` exists."""
    refuse_existing(out, DataError)
    episodes = load(path)
    tensors = {name: getattr(episodes, name) for name in (*COLUMNS, "image", "next_image")}
    arrays: dict[str, Any] = {name: tensor.numpy() for name, tensor in tensors.items() if tensor is not None}
    arrays["description"] = np.array(episodes.description.to_json().decode())
    buffer = io.BytesIO()
    np.savez_compressed(buffer, allow_pickle=False, **arrays)
    write_durably(out, buffer.getvalue())


def export_parquet(path: Path, out: Path) -> None:
    """Write a Parquet file with a row per step and a column per number, named after its channel; without images. Raises DataError
    as in `export_numpy`."""
    refuse_existing(out, DataError)
    episodes = load(path, images=False)
    columns: dict[str, Any] = {}
    names = [channel.name for channel in episodes.description.observation]
    for prefix, values in (("", episodes.observation), ("next_", episodes.next_observation)):
        columns |= {f"{prefix}{name}": values[:, i].numpy() for i, name in enumerate(names)}
    columns |= {f"action_{c.name}": episodes.action[:, i].numpy() for i, c in enumerate(episodes.description.action)}
    flat = ("reward", "terminated", "truncated", "episode", "intervention", "age_s", "hub_time_s")
    columns |= {name: getattr(episodes, name).numpy() for name in flat}
    units = {c.name: c.unit for c in episodes.description.observation}
    about = {"env": episodes.description.env, "units": json.dumps(units)}
    write_durably(out, to_parquet(pa.table(columns).replace_schema_metadata(about)))


def export_minari(path: Path, out: Path) -> None:
    """Write a Minari dataset into the folder ``out``, named as Minari requires: ``namespace/name-v0`` below any folder.

    `minari.load_dataset` finds it if ``MINARI_DATASETS_PATH`` is that folder. `recover_environment` makes the environment with a
    virtual robot, if it is one that comes with BricksRL.

    Raises:
        DataError: as in `export_numpy`; also if Minari is not installed, or ``out`` does not end like ``bricksrl/walker-v0``.
    """
    try:
        import minari
        from minari.data_collector import EpisodeBuffer
        from minari.namespace import NAMESPACE_METADATA_FILENAME
    except ImportError as error:
        raise DataError("no Minari is here to write its format; install it: pip install 'bricksrl[data]'") from error
    refuse_existing(out, DataError)
    episodes = load(path)
    name = f"{out.absolute().parent.name}/{out.name}"
    buffers = [EpisodeBuffer(**_minari_episode(episodes, k)) for k in range(len(episodes.rows))]
    with atomic_folder(out) as folder, _datasets_in(folder / "new"), warnings.catch_warnings():
        warnings.simplefilter("ignore")  # it warns that there are no authors
        try:
            minari.create_dataset_from_buffers(
                name,
                buffers,
                **_minari_environment(episodes),
                algorithm_name=", ".join(dict.fromkeys(row.about.policy for row in episodes.rows)),
                description=f"{episodes.description.env}, recorded with BricksRL",
                data_format="hdf5",
                jpeg_encoding=False,
            )
        except ValueError as error:
            raise DataError(f"Minari refuses the name {name} ({error}); end the path like bricksrl/walker-v0") from None
        for written in (folder / "new" / name).iterdir():
            written.rename(folder / written.name)
        namespace = (folder / "new" / name).parent / NAMESPACE_METADATA_FILENAME
        if not (out.parent / namespace.name).exists():
            namespace.rename(out.parent / namespace.name)
        shutil.rmtree(folder / "new")


def _minari_episode(episodes: Episodes, episode: int) -> dict[str, Any]:
    at = (episodes.episode == episode).numpy()
    states = np.concatenate((episodes.observation[at].numpy(), episodes.next_observation[at][-1:].numpy()))
    observations: Any = states
    if episodes.image is not None and episodes.next_image is not None:
        images = np.concatenate((episodes.image[at].numpy(), episodes.next_image[at][-1:].numpy()))
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
    """Spaces of the environment, and Gymnasium's specification of it with its options; ``None`` if it is not registered."""
    import gymnasium

    spec = gymnasium.registry.get(f"bricksrl/{episodes.description.env}")
    box = gymnasium.spaces.Box(-np.inf, np.inf, tuple(episodes.observation.shape[1:]))
    observation_space: Any = box
    if episodes.image is not None:
        image = gymnasium.spaces.Box(0, 255, tuple(episodes.image.shape[1:]), np.uint8)
        observation_space = gymnasium.spaces.Dict({"observation": box, "image": image})
    return {
        "env": None if spec is None else replace(spec, kwargs=spec.kwargs | episodes.description.options),
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
