"""State of a learner: all that learning changes, in a form that a checkpoint can hold and any device can take up."""

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
    """The state; see `Learner.state_dict`."""
    state: dict[str, Any] = {"policy": dict(learner.policy.state_dict()), "updates": learner.updates, "due": learner.due}
    if learner.loss is not None and learner.optimizer is not None:
        state |= {"loss": dict(learner.loss.state_dict()), "optimizer": learner.optimizer.state_dict()}
    if learner.memory is not None and not learner.on_policy and len(learner.memory):
        state["memory"] = memory_state(learner.memory)
    return state


def load_state(learner: Learner, state: dict[str, Any]) -> None:
    """Go on from a state; see `Learner.load_state_dict`."""
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
        if getattr(loss, name, state) is None:  # losses of TorchRL's make some buffers when they first need them
            delattr(loss, name)
            loss.register_buffer(name, state[name])
    loss.load_state_dict(state)


def memory_state(memory: ReplayBuffer) -> dict[str, Any]:
    """The filled part of any replay buffer, and where it goes on."""
    rows = dict(memory[range(len(memory))].flatten_keys(".").items()) if len(memory) else {}
    links = memory.links() if isinstance(memory, EpisodicReplayBuffer) else {}
    return {"rows": rows, "writer": dict(memory.writer.state_dict()), **links}


def load_memory_state(memory: ReplayBuffer, state: dict[str, Any], device: torch.device | str = "cpu") -> None:
    """Go on from `memory_state`; what is here is forgotten.

    Raises:
        ValueError, KeyError, RuntimeError: the state is that of another memory.
    """
    rows, capacity = dict(state["rows"]), memory.storage.max_size
    size = len(next(iter(rows.values()), ()))
    if size > capacity or state["writer"].get("_cursor", 0) not in range(capacity):
        raise ValueError(f"a memory of {size} transitions does not fit into one of {capacity}")
    memory.empty()
    if size:
        frames = TensorDict(rows, [size], device=device).unflatten_keys(".")
        if isinstance(memory, TransitionReplayBuffer):
            TransitionReplayBuffer.extend(memory, frames)  # what followed what is in the state
        else:
            memory.extend(frames)
    memory.writer.load_state_dict(state["writer"])
    if isinstance(memory, EpisodicReplayBuffer):
        memory.load_links(state)
