"""What an agent remembers that sees: each image once, in bytes, and never a frame of the camera."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any

import torch
from torch import Tensor


@dataclass(frozen=True)
class Rows:
    """Steps out of the memory: ``image``, ``next_image`` uint8 ``[batch, side, side, 3]``, ``observation``,
    ``next_observation`` ``[batch, n]``, ``action`` ``[batch, m]``, ``reward`` and ``terminated`` (bool) ``[batch]``."""

    image: Tensor
    observation: Tensor
    action: Tensor
    reward: Tensor
    next_image: Tensor
    next_observation: Tensor
    terminated: Tensor


class ImageReplay:
    """A ring of moments: an image, an observation and, but for an episode's last, the action that led to the next moment.

    The moment after a step is the one before the next step, so each image is there once. Draws use torch's global generator.

    Args:
        capacity: moments; the oldest are overwritten first.
        side_px: of the images.
        observation_size, action_size: n and m.
    """

    def __init__(self, capacity: int, side_px: int, observation_size: int, action_size: int) -> None:
        self.capacity = capacity
        # the system gives memory only where it is written
        self._images = torch.empty(capacity, side_px, side_px, 3, dtype=torch.uint8)
        self._observations = torch.zeros(capacity, observation_size)
        self._actions = torch.zeros(capacity, action_size)
        self._outcomes = torch.zeros(capacity, 2)
        self._goes_on = torch.zeros(capacity, dtype=torch.bool)
        self._added = 0
        self._open = False

    def __len__(self) -> int:
        """Steps that can be drawn."""
        return int(self._goes_on.sum())

    def add(
        self,
        before: tuple[Tensor, Tensor],
        action: Tensor,
        reward: float,
        after: tuple[Tensor, Tensor],
        *,
        terminated: bool,
        last: bool,
    ) -> None:
        """Keep a step between two moments, each an observation ``[n]`` and an image; ``last`` of its episode."""
        if not self._open:
            self._write(*before)
        at = (self._added - 1) % self.capacity
        self._write(*after)
        self._actions[at] = action
        self._outcomes[at, 0], self._outcomes[at, 1] = reward, float(terminated)
        self._goes_on[at] = True
        self._open = not last

    def end_episode(self) -> None:
        """Whatever is added next belongs to another episode."""
        self._open = False

    def _write(self, observation: Tensor, image: Tensor) -> None:
        at = self._added % self.capacity
        self._observations[at], self._images[at] = observation, image
        self._goes_on[at] = False
        self._added += 1

    def draw(self, count: int) -> Rows:
        """So many steps, drawn uniformly with replacement."""
        known = self._goes_on.nonzero().squeeze(-1)
        at = known[torch.randint(len(known), (count,))]
        after = (at + 1) % self.capacity
        reward, terminated = self._outcomes[at].unbind(-1)
        return Rows(
            self._images[at],
            self._observations[at],
            self._actions[at],
            reward,
            self._images[after],
            self._observations[after],
            terminated > 0,
        )

    @property
    def bytes_used(self) -> int:
        """Memory of what has been written."""
        used = min(self._added, self.capacity)
        return sum(part[:used].numel() * part.element_size() for part in self._parts().values())

    def _parts(self) -> dict[str, Tensor]:
        return {
            "images": self._images,
            "observations": self._observations,
            "actions": self._actions,
            "outcomes": self._outcomes,
            "goes_on": self._goes_on,
        }

    def state_dict(self) -> dict[str, Any]:
        """The filled part."""
        used = min(self._added, self.capacity)
        filled = {name: part[:used].clone() for name, part in self._parts().items()}
        return {**filled, "added": self._added, "open": self._open}

    def load_state_dict(self, state: dict[str, Any]) -> None:
        """Take over what `state_dict` of a ring of this capacity gave."""
        self._added, self._open = int(state["added"]), bool(state["open"])
        used = min(self._added, self.capacity)
        for name, part in self._parts().items():
            if self._added < 0 or part[:used].shape != state[name].shape:
                raise ValueError(f"memory of shape {tuple(part[:used].shape)} here and {tuple(state[name].shape)} there")
            part[:used] = state[name]
