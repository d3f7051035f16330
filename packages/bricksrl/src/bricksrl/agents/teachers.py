"""Teachers: a frozen base that a policy adds to, or demonstrations that it imitates first; then an
anchor (`bricksrl.agents.anchor`) holds it there."""

import math
from collections.abc import Sequence

import numpy as np
import torch
from tensordict import TensorDictBase
from tensordict.nn import TensorDictModuleBase
from torch import Tensor, nn
from torchrl.envs.utils import ExplorationType, set_exploration_type

from bricksrl.agents.actor_critic import ActorCriticLoss, on_base
from bricksrl.agents.anchor import layers_of
from bricksrl.agents.features.encoder import Encoder, encode
from bricksrl.agents.gradient_descent import GradientLearner
from bricksrl.agents.learner import Learner
from bricksrl.agents.sac import LEAST_SCALE, SCALE_SHIFT, SACLoss
from bricksrl.envs.tasks.scripted import ArrayPolicy
from bricksrl.errors import RunError

MARGIN = 1.2
"""First standard deviation, relative to the minimum, at which it has no gradient."""
ALPHA = 0.01
"""Maximum initial temperature, so that entropy does not outweigh the policy."""
UPDATES = 2000
"""Updates of imitation."""
ROWS = 256
"""Frames in each of these updates."""


class Base(nn.Module):
    """A frozen policy, as a function from what is observed to its best actions ``[*batch, m]``."""

    def __init__(self, policy: TensorDictModuleBase) -> None:
        super().__init__()
        self.policy = policy.eval().requires_grad_(False)
        # nor do its encoders see what is learned on top of it
        for module in policy.modules():
            if isinstance(module, Encoder):
                module.is_frozen = True
        self.in_keys = list(policy.in_keys)

    def forward(self, observed: TensorDictBase) -> Tensor:
        # a new TensorDict, as the policy writes its action into what it is given
        selected = observed.select(*self.in_keys)
        # what is learned explores on top of it, and a base that explored too would hide that
        with set_exploration_type(ExplorationType.DETERMINISTIC):
            action: Tensor = self.policy(selected)["action"]
        return action


class Scripted(TensorDictModuleBase):  # type: ignore[misc]
    """A hand-written controller of arrays, for TensorDicts of any batch."""

    def __init__(
        self,
        policy: ArrayPolicy,
        keys: Sequence[str],
    ) -> None:
        super().__init__()
        self.controller = policy
        self.in_keys = list(keys)
        self.out_keys = ["action"]

    def forward(self, tensordict: TensorDictBase) -> TensorDictBase:
        # a controller knows one observation, and no batch
        flat = tensordict.select(*self.in_keys).reshape(-1).cpu()
        acted = []
        for single in flat:
            # a copy, as a controller is free to write into what it is given
            observed = {key: single[key].numpy().copy() for key in self.in_keys}
            acted.append(self.controller(observed))
        # NumPy's own numbers are float64
        actions = torch.as_tensor(np.stack(acted), dtype=torch.float32, device=tensordict.device)
        return tensordict.set("action", actions.view(*tensordict.batch_size, -1))


class Residual(TensorDictModuleBase):  # type: ignore[misc]
    """A policy that adds the actions of a ``learned`` one to those of its base (Johannink et al.,
    2019), within -1..1."""

    def __init__(
        self,
        base: Base,
        learned: TensorDictModuleBase,
    ) -> None:
        super().__init__()
        self.base = base
        self.learned = learned
        self.in_keys = list(dict.fromkeys((*base.in_keys, *learned.in_keys)))
        self.out_keys = ["action"]

    def forward(self, tensordict: TensorDictBase) -> TensorDictBase:
        base_action = self.base(tensordict)
        learned_action = self.learned(tensordict)["action"]
        return tensordict.set("action", on_base(learned_action, base_action))


def add_base(learner: Learner, base: Base) -> None:
    """Let a new learner's actions be added to those of a base: nothing at first. Raises RunError as
    `hold` does."""
    loss = _teachable(learner)
    loss.base = base.to(learner.device)
    learner.policy = Residual(base, learner.policy)
    # weights and biases of the last layer: with them at 0 the base acts alone
    with torch.no_grad():
        for part in layers_of(loss.actor)[-2:]:
            part.zero_()
    hold(learner)


def imitate(
    learner: Learner,
    frames: TensorDictBase,
    actions: Tensor,
) -> None:
    """Teach a new learner's actor the ``actions`` ``[time, m]`` for what ``frames`` ``[time]``
    observe, by least squares, and hold it there. Raises RunError as `hold` does."""
    loss = _teachable(learner)
    frames = frames.to(learner.device)
    actions = actions.to(learner.device)
    # one of its own: moments of imitation would steer the learner's first updates
    taught = [*loss.encoder.parameters(), *loss.actor.parameters()]
    optimizer = torch.optim.Adam(taught, fused=True)
    # CrossQ's actor is in evaluation mode between updates
    was_training = loss.actor.training
    loss.actor.train()
    size = actions.shape[-1]
    for _ in range(UPDATES):
        drawn = torch.randint(len(frames), (ROWS,), device=learner.device)
        observed = frames[drawn]
        features = encode(loss.encoder, observed)
        # the mean before the tanh; a Gaussian actor's scales come after it
        mean = loss.actor(features)[..., :size]
        base_action = None if loss.base is None else loss.base(observed)
        acted = on_base(mean.tanh(), base_action)
        error = (acted - actions[drawn]).square().mean()
        error.backward()
        optimizer.step()
        optimizer.zero_grad()
    loss.actor.train(was_training)
    hold(learner)


@torch.no_grad()
def hold(learner: Learner) -> None:
    """Let a policy that was taught explore little, and anchor it. Raises RunError if the agent has
    no such policy."""
    loss = _teachable(learner)
    if isinstance(loss, SACLoss):
        *_, weight, bias = layers_of(loss.actor)
        # the second half of the outputs are scales, before the softplus of `location_and_scale`,
        # which is inverted here
        size = len(bias) // 2
        scale = MARGIN * loss.settings.min_scale - LEAST_SCALE
        weight[size:] = 0.0
        bias[size:] = math.log(math.expm1(scale)) - SCALE_SHIFT
        loss.log_alpha.clamp_(max=math.log(ALPHA))
    # TD3's target would else go on from the actor as it was before it was taught
    if hasattr(loss, "target_actor"):
        loss.target_actor.load_state_dict(loss.actor.state_dict())
    loss.anchor_actor()


def _teachable(learner: Learner) -> ActorCriticLoss:
    loss = learner.loss if isinstance(learner, GradientLearner) else None
    if not isinstance(loss, ActorCriticLoss):
        raise RunError(
            "only sac, droq, redq, td3, crossq and cql can be taught; choose one of them"
        )
    return loss
