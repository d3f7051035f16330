"""Steps of an episode as they are recorded, and the columns that they become."""

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import ArrayLike, NDArray

from bricksrl.data.columns import image_statistics
from bricksrl.data.dataset import About, Episode
from bricksrl.data.schema import STEP_COLUMNS, Description

Image = NDArray[np.uint8]


@dataclass(frozen=True)
class Step:
    """One step of an episode.

    Attributes:
        observation, next_observation: ``[n]``, before and after the step.
        action: ``[m]``, in -1..1, as given to the environment.
        image, next_image: uint8 ``[side, side, 3]``, with a camera.
        intervention: whether a human chose the action.
        age_s: age of the observation when the action was sent to the robot.
        hub_time_s: the hub's clock when it measured ``next_observation``; NaN without a hub.
    """

    observation: ArrayLike
    action: ArrayLike
    reward: float
    next_observation: ArrayLike
    terminated: bool
    truncated: bool
    image: Image | None = None
    next_image: Image | None = None
    intervention: bool = False
    age_s: float = 0.0
    hub_time_s: float = float("nan")


def new_episode(
    steps: Sequence[Step],
    about: About,
    description: Description,
) -> Episode:
    """Episode of these steps, as the first one of a dataset; `write_episodes` gives it another
    number."""
    columns = {}
    for name, column in STEP_COLUMNS.items():
        dtype = description.features[column]["dtype"]
        values = [np.asarray(getattr(step, name), dtype) for step in steps]
        columns[column] = np.stack([value.reshape(-1) for value in values])
    frames = np.arange(len(steps), dtype=np.int64)
    zeros = np.zeros(len(steps), np.int64)
    columns["next.done"] = columns["next.terminated"] | columns["next.truncated"]
    # LeRobot expects nominal times, by the rate of the task; the hub's clock is a column of its
    # own.
    columns["timestamp"] = (frames / description.rate_hz).astype(np.float32)
    columns |= {"frame_index": frames, "episode_index": zeros, "index": frames, "task_index": zeros}
    if description.camera is None:
        return Episode(about, columns)
    # The image after a step is the one before the next step, so it is kept once.
    shown = [*(step.image for step in steps), steps[-1].next_image]
    images = np.stack([image for image in shown if image is not None])
    return Episode(
        about,
        columns,
        images,
        image_statistics(images[:-1]),
    )
