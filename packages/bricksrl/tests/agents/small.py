"""Small environments and learners."""

from __future__ import annotations

import functools
import io
from dataclasses import fields, replace
from typing import Any

import torch
from tensordict import TensorDict, TensorDictBase
from torch import Tensor
from torchrl.data import Bounded, Composite, Unbounded
from torchrl.envs import EnvBase
from torchrl.envs.utils import ExplorationType, set_exploration_type

import bricksrl
from bricksrl.agents import make_learner, preset
from bricksrl.agents.learner import Learner
from bricksrl.agents.offline.imitation import ImitationLearner, recorded_memory
from bricksrl.envs.transforms import layout_of


class Sight(EnvBase):
    """Images with a red spot; acting towards its side is rewarded and moves it."""

    def __init__(self, side_px: int = 32) -> None:
        super().__init__(batch_size=())
        image = Bounded(0, 255, (side_px, side_px, 3), dtype=torch.uint8)
        self.observation_spec = Composite(observation=Bounded(-1.0, 1.0, (2,)), image=image)
        self.action_spec = Bounded(-1.0, 1.0, (2,))
        self.reward_spec = Unbounded((1,))
        self.side_px, self.column, self.made = side_px, 0, 0

    def _set_seed(self, seed: int | None) -> None:
        torch.manual_seed(seed or 0)

    def shown(self, column: int) -> TensorDict:
        image = torch.full((self.side_px, self.side_px, 3), 180, dtype=torch.uint8)
        image[12:18, column : column + 6] = torch.tensor([220, 10, 10], dtype=torch.uint8)
        return TensorDict({"observation": torch.zeros(2), "image": image}, [])

    def _jump(self) -> TensorDict:
        self.column = int(torch.randint(0, self.side_px - 6, ()))
        return self.shown(self.column)

    def _reset(self, tensordict: Any = None, **_: Any) -> TensorDict:
        self.made = 0
        return self._jump()

    def _step(self, tensordict: TensorDictBase) -> TensorDict:
        side = (self.column + 3.0) / self.side_px * 2.0 - 1.0
        self.made += 1
        last = torch.tensor([self.made >= 5])
        return self._jump().update(
            {
                "reward": tensordict["action"][:1] * side,
                "done": last,
                "truncated": last,
                "terminated": last & False,
            }
        )


ENV = bricksrl.make("RoboArmSim-v0", seed=0)
SIGHT = Sight()
TASK = ENV.task
LAYOUT = layout_of(ENV)
REPLAYING = ("sac", "droq", "redq", "td3", "crossq", "tqc", "iql", "cql", "td3bc")
IMITATING = ("bc", "act", "diffusion")
LEARNING = (*REPLAYING, "ppo", *IMITATING)
_SMALL: dict[str, Any] = {
    "hidden": (16,),
    "batch_size": 10,
    "updates_per_step": 1.0,
    "actor_delay": 1,
    "quantiles": 5,
    "dropped": 1,
    "width": 16,
    "feedforward": 16,
    "heads": 2,
    "denoising_steps": 3,
    "buffer_size": 1000,
    "steps": 8,
}


def settings(agent: str, *, images: bool = False, **changes: Any) -> Any:
    """Default settings with small networks."""
    usual = preset("default", agent, images=images)
    known = {field.name for field in fields(usual)}
    return replace(
        usual, **{key: value for key, value in {**_SMALL, **changes}.items() if key in known}
    )


def make(agent: str, seed: int = 11, env: Any = ENV, **changes: Any) -> Any:
    """An untrained learner."""
    torch.manual_seed(seed)
    return make_learner(agent, env, settings(agent, images=env is SIGHT, **changes))


def steps(count: int, length: int = 5) -> TensorDict:
    """Fixed random steps of the arm ``[count]`` in episodes of ``length``."""
    return _steps(count, length).clone()


@functools.cache
def _steps(count: int, length: int) -> TensorDict:
    generator = torch.Generator().manual_seed(7)
    with torch.random.fork_rng():
        ENV.set_seed(5)
        found = []
        for step in range(1, count + 1):
            state = ENV.reset() if step % length == 1 else ENV.step_mdp(state)  # noqa: F821
            state["action"] = torch.rand(4, generator=generator) * 2 - 1
            state = ENV.step(state)
            truncated = torch.tensor([step % length == 0])
            state["next", "truncated"] = truncated
            state["next", "done"] = state["next", "terminated"] | truncated
            found.append(state.clone())
    return torch.stack(found)


def learned(agent: str, updates: int = 3, **changes: Any) -> Learner:
    """A learner after some updates."""
    return taught(make(agent, **changes), updates)


def taught(learner: Learner, updates: int = 3) -> Learner:
    """The learner after some frames and updates."""
    torch.manual_seed(2)
    if isinstance(learner, ImitationLearner):
        learner.dataset = dataset(chunk=learner.chunk)
    if learner.on_policy:
        ENV.set_seed(5)
        learner.remember(rollout(learner))
        learner.learn()
    else:
        learner.remember(steps(30))
        learner.make_updates(updates)
    return learner


def rollout(learner: Learner) -> TensorDictBase:
    """Steps of the learner ``[1, time]``."""
    with torch.no_grad(), set_exploration_type(ExplorationType.RANDOM):
        found: TensorDictBase = ENV.rollout(
            learner.frames_per_batch, learner.policy, break_when_any_done=False
        )[None]
    return found


def dataset(frames: TensorDictBase | None = None, *, chunk: int = 0, batch_size: int = 10) -> Any:
    """A dataset to learn from."""
    return recorded_memory(
        steps(40) if frames is None else frames, batch_size, ("observation",), chunk=chunk
    )


def tensors(state: Any) -> list[Tensor]:
    """All tensors in a state, in order."""
    if isinstance(state, Tensor):
        return [state]
    if isinstance(state, dict):
        return [tensor for key in sorted(state, key=str) for tensor in tensors(state[key])]
    return (
        [tensor for one in state for tensor in tensors(one)]
        if isinstance(state, list | tuple)
        else []
    )


def weights(learner: Learner) -> list[Tensor]:
    """Copies of all learned tensors, without the replay buffer."""
    state = {key: value for key, value in learner.state_dict().items() if key != "memory"}
    return [tensor.clone() for tensor in tensors(state)]


def same(one: list[Tensor], other: list[Tensor]) -> bool:
    """Whether all tensors are equal, bit for bit."""
    return len(one) == len(other) and all(
        a.shape == b.shape and torch.equal(a, b) for a, b in zip(one, other, strict=True)
    )


def saved(learner: Learner) -> dict[str, Any]:
    """Its state after a file round trip."""
    file = io.BytesIO()
    torch.save(learner.state_dict(), file)
    file.seek(0)
    state: dict[str, Any] = torch.load(file, weights_only=True)
    return state
