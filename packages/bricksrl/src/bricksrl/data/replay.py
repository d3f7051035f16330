"""TorchRL replay buffer of a dataset."""

from __future__ import annotations

import warnings
from pathlib import Path
from typing import TYPE_CHECKING

from bricksrl.data.reader import COLUMNS, load
from bricksrl.data.schema import NEXT, OBSERVATION

if TYPE_CHECKING:
    from torchrl.data.datasets import LeRobotExperienceReplay

_KEYS = {OBSERVATION: "observation", NEXT: ("next", "observation")}


def replay(
    path: Path | str,
    *,
    batch_size: int,
    slice_len: int | None = None,
) -> LeRobotExperienceReplay:
    """Load a dataset into TorchRL's buffer for LeRobot's data, which samples steps or slices of
    episodes. Raises DataError if the dataset cannot be read.

    The keys are those of our environments. (TorchRL's loader from the Hugging Face hub has other
    keys, and drops the dimension of vectors of length 1.)

    Args:
        slice_len: sample slices of this many consecutive steps, ``batch_size`` steps in all; by
            default single steps.
    """
    with warnings.catch_warnings():
        # TorchRL's import warns about its own classes.
        warnings.simplefilter("ignore", DeprecationWarning)
        from torchrl.data.datasets import LeRobotExperienceReplay

    episodes = load(path)
    # Times describe the robot, and nothing is learned from them.
    learned = {name: column for name, column in COLUMNS.items() if not name.endswith("_s")}
    columns = {column: getattr(episodes, name) for name, column in learned.items()}
    columns["next.done"] = episodes.terminated | episodes.truncated
    if episodes.image is not None and episodes.next_image is not None:
        columns |= {"image": episodes.image, "next.image": episodes.next_image}
    return LeRobotExperienceReplay.from_columns(
        columns,
        key_map=dict(_KEYS),
        batch_size=batch_size,
        slice_len=slice_len,
    )
