"""Recorded frames of an environment, through its transforms."""

from collections.abc import Iterator

import torch
from tensordict import TensorDict, TensorDictBase
from torch import Tensor
from torchrl.envs import EnvBase

from bricksrl.envs.env_interface import interface_of
from bricksrl.envs.specs import SPECS, SpecsEnv
from bricksrl.envs.transforms.chain import base_of
from bricksrl.envs.transforms.playback import ACTION_TOLERANCE, Playback, over, still
from bricksrl.envs.transforms.state import load_transform_state, transform_state
from bricksrl.errors import DataError

_MOST_REPEATS = 24
"""Longest repetition of an action that may outlast the end of a recorded episode."""


def through(env: EnvBase, frames: TensorDictBase) -> TensorDictBase:
    """What an environment's transforms make of its own frames ``[time]`` of whole episodes, which
    end with "done"; the statistics that they gather they keep. Raises DataError if the actions are
    not those that would pass the transforms."""
    if base_of(env) is env:
        return frames
    base = base_of(env)
    if base.batch_size:  # copies: the frames are of one
        specs = {name: getattr(base, f"{name}_unbatched").clone() for name in SPECS}
        base = SpecsEnv(specs, interface_of(base).task)
    given = frames.select(
        *base.full_observation_spec.keys(),
        "action",
        "next",
        strict=False,
    )
    playback = Playback(base, lambda _: still(base))
    view = over(env, playback)
    # Transforms scale actions, each number by itself: two of them tell how.
    none = _passed(view, torch.zeros_like(given["action"][0]))
    full = _passed(view, torch.ones_like(given["action"][0]))
    made: list[TensorDictBase] = []
    start = 0
    ends = frames["next", "done"].view(-1).nonzero().flatten() + 1
    for end in ends.tolist():
        episode = given[start:end]
        outcomes = _outcomes(base, episode)
        # a repeated action may outlast its episode
        repeated = outcomes[-1:] * _MOST_REPEATS
        playback.outcome = [*outcomes, *repeated].__getitem__
        playback.played = outcomes[:1]
        # the actions of the agent that become the recorded ones
        actions = (episode["action"] - none) / (full - none)  # [time, m]
        made += _steps_behind(view, playback, actions, episode["action"])
        start = end
    load_transform_state(env, transform_state(view))
    return torch.stack(made)


def _outcomes(base: EnvBase, episode: TensorDictBase) -> list[TensorDictBase]:
    """What the environment itself gives in an episode ``[time]``: at its reset, then at each
    step."""
    first = episode[0].exclude("action", "next").update(base.full_done_spec.zero())
    outcomes = [still(base).update(first)]
    outcomes += [still(base).update(row["next"]) for row in episode]
    return outcomes


def _steps_behind(
    view: EnvBase,
    playback: Playback,
    actions: Tensor,
    recorded: Tensor,
) -> Iterator[TensorDictBase]:
    """The steps behind the transforms in an episode that their playback plays, by the agent's
    actions ``[time, m]``. Raises DataError if these do not become the recorded ones."""
    state = view.reset()
    # One step behind the transforms may be several of the episode's.
    while len(playback.played) <= len(actions):
        place = len(playback.played) - 1
        out = view.step(state.set("action", actions[place]))
        taken = recorded[place : len(playback.played) - 1]
        passed = torch.stack(playback.acted)[: len(taken)]
        if not torch.allclose(passed, taken, atol=ACTION_TOLERANCE):
            raise DataError(
                "the data has other actions than these transforms would give; record with "
                "them, or omit them"
            )
        yield out
        state = view.step_mdp(out)
        playback.acted.clear()


def _passed(view: EnvBase, action: Tensor) -> Tensor:
    """What transforms make of an action on its way to the environment."""
    passed: Tensor = view.transform.inv(TensorDict(action=action))["action"]
    return passed
