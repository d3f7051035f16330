"""A dataset as a replay buffer of TorchRL."""

from __future__ import annotations

import warnings
from pathlib import Path
from typing import TYPE_CHECKING

from bricksrl.data.layout import ACTION, NEXT, OBSERVATION
from bricksrl.data.reader import load

if TYPE_CHECKING:
    from torchrl.data.datasets import LeRobotExperienceReplay

_KEYS = {OBSERVATION: "observation", NEXT: ("next", "observation")}


def replay(path: Path | str, *, batch_size: int, slice_len: int | None = None) -> LeRobotExperienceReplay:
    """The transitions of a dataset in TorchRL's own buffer for LeRobot's data, which samples steps or parts of episodes.

    The keys are those of our environments. (TorchRL's way over the Hugging Face hub gives other keys, and vectors of length 1
    without their dimension.)

    Args:
        slice_len: sample runs of so many steps in a row, ``batch_size`` steps in all; without it single steps.

    Raises:
        DataError: the dataset cannot be read.
    """
    with warnings.catch_warnings():
        warnings.simplefilter("ignore", DeprecationWarning)  # TorchRL's import warns of its own classes
        from torchrl.data.datasets import LeRobotExperienceReplay

    episodes = load(path)
    columns = {
        OBSERVATION: episodes.observation,
        ACTION: episodes.action,
        NEXT: episodes.next_observation,
        "next.reward": episodes.reward,
        "next.terminated": episodes.terminated,
        "next.truncated": episodes.truncated,
        "next.done": episodes.terminated | episodes.truncated,
        "episode_index": episodes.episode,
        "intervention": episodes.intervention,
    }
    keys = dict(_KEYS)
    if episodes.image is not None and episodes.next_image is not None:
        columns |= {"image": episodes.image, "next.image": episodes.next_image}
    return LeRobotExperienceReplay.from_columns(columns, key_map=keys, batch_size=batch_size, slice_len=slice_len)
