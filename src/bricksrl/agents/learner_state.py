"""State of a learner for checkpoints, independent of the device."""

from __future__ import annotations

from typing import Any

import torch
from tensordict import TensorDict
from torchrl.data import ReplayBuffer
from torchrl.objectives import LossModule

from bricksrl.agents.episodic_replay import EpisodicReplayBuffer
from bricksrl.agents.learner import Learner
from bricksrl.agents.replay import TransitionReplayBuffer
from bricksrl.errors import CheckpointError


def state_of(learner: Learner) -> dict[str, Any]:
    """See `Learner.state_dict`."""
    state: dict[str, Any] = {"policy": dict(learner.policy.state_dict()), "updates": learner.updates, "due": learner.due}
    if learner.loss is not None and learner.optimizer is not None:
        state |= {"loss": dict(learner.loss.state_dict()), "optimizer": learner.optimizer.state_dict()}
    if learner.memory is not None and not learner.on_policy and len(learner.memory):
        state["memory"] = memory_state(learner.memory)
    return state


def load_state(learner: Learner, state: dict[str, Any]) -> None:
    """See `Learner.load_state_dict`."""
    try:
        learner.policy.load_state_dict(state["policy"])
        learner.updates, learner.due = int(state["updates"]), float(state["due"])
        if learner.loss is not None and learner.optimizer is not None:
            if any(name.startswith("anchor.") for name in state["loss"]):
                from bricksrl.agents.policy_transfer import anchor

                anchor(learner)
            _load_loss(learner.loss, state["loss"])
            learner.optimizer.load_state_dict(state["optimizer"])
        if learner.memory is not None:
            learner.memory.empty()
            if "memory" in state:
                load_memory_state(learner.memory, state["memory"], learner.device)
    except (AssertionError, AttributeError, LookupError, OverflowError, RuntimeError, TypeError, ValueError) as error:
        reason = (str(error) or type(error).__name__).splitlines()[0]
        raise CheckpointError(f"the checkpoint does not fit this agent ({reason}); resume with the settings it had") from None


def _load_loss(loss: LossModule, state: dict[str, Any]) -> None:
    for name in state.keys() - loss.state_dict().keys():
        if getattr(loss, name, state) is None:  # TorchRL's losses create some buffers lazily
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
