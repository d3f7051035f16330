"""State of losses and replay buffers for checkpoints, independent of the device."""

from __future__ import annotations

from typing import Any

import torch
from tensordict import TensorDict
from torchrl.data import ReplayBuffer
from torchrl.objectives import LossModule

from bricksrl.agents.replay.buffer import EpisodicReplayBuffer, TransitionReplayBuffer


class CountedUpdates:
    """Module with the number of the actor's updates in its state."""

    updates_made = 0

    def get_extra_state(self) -> dict[str, int]:
        """The number."""
        return {"made": self.updates_made}

    def set_extra_state(self, state: dict[str, int]) -> None:
        """Inverse of `get_extra_state`."""
        self.updates_made = int(state["made"])


def load_loss(loss: LossModule, state: dict[str, Any]) -> None:
    """Restore a loss's ``state_dict``. Raises RuntimeError if it is of another loss."""
    if any(name.startswith("_value_estimator.") for name in state):
        _ = loss.value_estimator  # TorchRL's losses create it lazily, and some buffers
    for name in state.keys() - loss.state_dict().keys():
        if getattr(loss, name, state) is None:
            delattr(loss, name)
            loss.register_buffer(name, state[name])
    loss.load_state_dict(state)


def memory_state(memory: ReplayBuffer) -> dict[str, Any]:
    """The filled part of a replay buffer and its write position."""
    rows = dict(memory[range(len(memory))].flatten_keys(".").items()) if len(memory) else {}
    links = memory.links() if isinstance(memory, EpisodicReplayBuffer) else {}
    return {"rows": rows, "writer": dict(memory.writer.state_dict()), **links}


def load_memory_state(memory: ReplayBuffer, state: dict[str, Any], device: torch.device | str = "cpu") -> None:
    """Restore `memory_state`. Raises ValueError, KeyError or RuntimeError if the state is of another buffer."""
    rows, capacity = dict(state["rows"]), memory.storage.max_size
    size = len(next(iter(rows.values()), ()))
    if size > capacity or state["writer"].get("_cursor", 0) not in range(capacity):
        raise ValueError(f"{size} transitions do not fit into a buffer of {capacity}")
    memory.empty()
    if size:
        frames = TensorDict(rows, [size], device=device).unflatten_keys(".")
        if isinstance(memory, TransitionReplayBuffer):
            TransitionReplayBuffer.extend(memory, frames)  # the successor links are in the state
        else:
            memory.extend(frames)
    memory.writer.load_state_dict(state["writer"])
    if isinstance(memory, EpisodicReplayBuffer):
        memory.load_links(state)
