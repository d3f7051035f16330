"""State of a replay buffer in a checkpoint."""

from typing import Any

import torch
from tensordict import TensorDict
from torchrl.data import ReplayBuffer

from bricksrl.agents.replay.buffer import TransitionReplayBuffer


def memory_state(memory: ReplayBuffer) -> dict[str, Any]:
    """The filled part of a replay buffer and its write position, independent of the device."""
    size = len(memory)
    rows: dict[str, Any] = {}
    # TorchRL's own state has the whole capacity, of which a run fills little.
    if size:
        rows = dict(memory[range(size)].flatten_keys(".").items())
    state: dict[str, Any] = {"rows": rows, "writer": dict(memory.writer.state_dict())}
    # Which row follows which: the steps of several robots alternate.
    if isinstance(memory, TransitionReplayBuffer):
        state |= memory.links()
    return state


def load_memory_state(
    memory: ReplayBuffer,
    state: dict[str, Any],
    device: torch.device | str = "cpu",
) -> None:
    """Restore `memory_state`. Raises ValueError, KeyError or RuntimeError if the state is of
    another buffer."""
    rows = dict(state["rows"])
    capacity = memory.storage.max_size
    # All columns have as many rows as the first; a state without columns is that of an empty one.
    first_column = next(iter(rows.values()), ())
    size = len(first_column)
    position = state["writer"].get("_cursor", 0)
    if size > capacity or position not in range(capacity):
        raise ValueError(f"{size} transitions do not fit into a buffer of {capacity}")
    memory.empty()
    is_ours = isinstance(memory, TransitionReplayBuffer)
    if size:
        transitions = TensorDict(rows, [size], device=device).unflatten_keys(".")
        # Of no robot: which row follows which is in the state.
        options = {"robot": None} if is_ours else {}
        memory.extend(transitions, **options)
    # After the rows, whose writing moves it.
    memory.writer.load_state_dict(state["writer"])
    if is_ours:
        memory.load_links(state)
