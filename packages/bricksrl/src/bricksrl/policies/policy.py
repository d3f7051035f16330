"""Policies: a trained agent's deterministic actions, as a TorchRL module and for plain arrays;
those of a run by their names."""

from collections import deque
from collections.abc import Callable
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np
import torch
from tensordict import TensorDict, TensorDictBase
from tensordict.nn import TensorDictModuleBase
from torch import Tensor
from torchrl.envs import EnvBase
from torchrl.envs.utils import ExplorationType, set_exploration_type

from bricksrl.data.collect import random_policy
from bricksrl.envs import rollout
from bricksrl.envs.env_interface import interface_of
from bricksrl.envs.tasks.scripted import ArrayPolicy
from bricksrl.envs.transforms import Playback, base_of, layout_of, over, steps_of, still
from bricksrl.errors import DescriptionError
from bricksrl.policies import load_policy
from bricksrl.policies.sharing import is_policy
from bricksrl.training.learners import untrained_learner
from bricksrl.training.run_folder import RunFolder


class Policy(TensorDictModuleBase):  # type: ignore[misc]
    """Deterministic policy of a trained agent: ``env.rollout(100, policy)``, or `act` on an
    observation.

    Args:
        module: reads observations, and writes "action"; may have a method ``reset``.
        env: environment whose observations it takes.
        through: environment whose transforms these go through first; by default none. As they may
            remember, which stacked frames do, `reset` is needed where an episode starts.
    """

    def __init__(
        self,
        module: TensorDictModuleBase,
        env: EnvBase,
        through: EnvBase | None = None,
    ) -> None:
        super().__init__()
        layout = layout_of(env)
        self.shapes = dict(layout.vectors)
        self.in_keys = list(module.in_keys if through is None else layout.keys)
        self.out_keys = ["action"]
        self.module = module.eval()
        self._transforms = None if through is None else PolicyTransforms(through)

    @torch.no_grad()
    def forward(self, tensordict: TensorDictBase) -> TensorDictBase:
        for key in self.in_keys:
            if key not in tensordict:
                what = "images" if key == "image" else key
                raise DescriptionError(f"the policy uses {what}; give one too")
            # In front of it there may be any batch.
            shape = self.shapes.get(key, ())
            value = tensordict[key]
            if value.shape[value.ndim - len(shape) :] != shape:
                size = ", ".join(map(str, shape))
                raise DescriptionError(
                    f"the policy takes observations of {size} numbers; give [*batch, {size}]"
                )
        given = tensordict.select(*self.in_keys)
        with set_exploration_type(ExplorationType.DETERMINISTIC):
            if self._transforms is None:
                action = self.module(given)["action"]
            else:
                action = self._transforms.action(self.module, given)
        return tensordict.set("action", action)

    def act(
        self,
        observation: Any,
        image: Any = None,
    ) -> Any:
        """Action ``[*batch, m]``, in -1..1, for an observation ``[*batch, n]``: an array for an
        array, a tensor for a tensor. ``image``: uint8 ``[*batch, side, side, 3]``, for a policy
        that uses images. Raises DescriptionError for another n, or without the image that the
        policy needs."""
        values = torch.as_tensor(observation, dtype=torch.float32)
        # The first vector that the policy reads; most environments have one alone.
        key = next(iter(self.shapes), "observation")
        inputs = {key: values}
        if image is not None:
            inputs["image"] = torch.as_tensor(image)
        vector_ndim = len(self.shapes.get(key, (0,)))
        batch_size = values.shape[: values.ndim - vector_ndim]
        action: Tensor = self(TensorDict(inputs, batch_size))["action"]
        return action if isinstance(observation, Tensor) else np.asarray(action)

    def reset(self) -> None:
        """Reset the policy's state at the start of an episode, such as a chunk of planned
        actions."""
        if hasattr(self.module, "reset"):
            self.module.reset()
        if self._transforms is not None:
            self._transforms.view = None


class PolicyTransforms:
    """The transforms of a policy's training, on the observations that it is given one after the
    other."""

    def __init__(self, env: EnvBase) -> None:
        self._env = env
        self._skip = steps_of(env)
        self._given: deque[TensorDictBase] = deque()
        self._last: TensorDictBase
        self._playback: Playback
        self.view: EnvBase | None = None

    def action(
        self,
        module: TensorDictModuleBase,
        given: TensorDictBase,
    ) -> Tensor:
        """The module's action behind the transforms, as the environment gets it; between two steps
        of theirs its last one."""
        base = base_of(self._env)
        batch = given.batch_size

        def outcome(_: int) -> TensorDictBase:
            # Without a new observation the transforms step within their reset: the last one holds.
            if self._given:
                self._last = self._given.popleft()
            return still(base).expand(*batch, *base.batch_size).clone().update(self._last)

        self._given.append(given)
        if self.view is None or self._playback.batch_size != batch:
            self._given = deque([given])
            self._playback = Playback(base, outcome, batch)
            self.view = over(self._env, self._playback)
            self._acted = module(self.view.reset())
        elif len(self._given) == self._skip:
            self._acted = module(self.view.step(self._acted)["next"])
            # A playback remembers all its steps, of which only the last one is needed.
            del self._playback.played[:-1]
        action: Tensor = self.view.transform.inv(self._acted.clone())["action"]
        return action


@dataclass(frozen=True)
class Player:
    """A policy, and the reset of its state at the start of an episode."""

    act: rollout.Policy
    reset: Callable[[], None] = lambda: None


def named_policies(
    run_dir: Path,
    env: EnvBase,
    seed: int,
) -> dict[str, Callable[[], Player]]:
    """Factories of the policies of a run, or of a shared one, for comparison: random, first
    (untrained), best, last. Raises RunError or CheckpointError if there is no run in the folder,
    or, when called, the policy does not match ``env``.

    ``best`` exists only if the run was evaluated during training. ``seed`` is that of the random
    actions.
    """

    def player(policy: Policy) -> Player:
        return Player(policy, policy.reset)

    def first() -> Player:
        learner = untrained_learner(run_dir, env)
        return player(Policy(learner.policy, env))

    named = {"random": lambda: random_player(env, seed)}
    if not is_policy(run_dir):
        named["first"] = first
        if RunFolder(run_dir).best_path.exists():
            named["best"] = lambda: player(load_policy(run_dir, env, which="best"))
    return {**named, "last": lambda: player(load_policy(run_dir, env))}


def array_player(make: Callable[[], ArrayPolicy]) -> Player:
    """Player of a policy of arrays."""
    policy = make()

    def act(state: TensorDictBase) -> TensorDictBase:
        # Copies, as the environment may reuse its tensors.
        keys = [key for key in ("observation", "image") if key in state]
        inputs = {key: state[key].numpy().copy() for key in keys}
        return state.set("action", torch.as_tensor(policy(inputs), dtype=torch.float32))

    return Player(act)


def random_player(env: EnvBase, seed: int) -> Player:
    """Player of uniform random actions."""
    # The hub of a policy of its own would not heed them.
    interface_of(env).act_by_trials(None)
    return Player(random_policy(env, seed))
