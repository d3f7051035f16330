"""Implicit Q-learning (Kostrikov et al., 2021) with TorchRL's loss: no action is ever valued that the data does not have."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Annotated

import torch
from tensordict.nn import TensorDictModule, TensorDictSequential
from torch import Tensor, nn
from torchrl.data import Composite
from torchrl.envs import EnvBase
from torchrl.modules import IndependentNormal, ProbabilisticActor
from torchrl.objectives import IQLLoss, SoftUpdate

from bricksrl.agents.encoder import encoder_keys, make_encoder
from bricksrl.agents.learner import Learner, off_policy_learner
from bricksrl.agents.networks import Actor, action_size, action_spec, make_body
from bricksrl.agents.operators import critic_operator, value_operator
from bricksrl.agents.settings import NotNegative, Range, Share, TargetSettings

LOG_SCALE = (-5.0, 2.0)
"""Limits of the logarithm of the policy's standard deviation, as its authors have them."""


@dataclass(frozen=True)
class IQLSettings(TargetSettings):
    """Settings of IQL."""

    new_goals: Annotated[float, Share] = 0.0
    """As for other algorithms; none, because what was done for one goal is no example for another one that is drawn at random."""
    expectile: Annotated[float, Range(0.0, 1.0, above=True, below=True)] = 0.8
    """Expectile of the values of the data's actions that is the value of a state; 0.5 is the mean."""
    temperature: Annotated[float, NotNegative] = 3.0
    """Weight of an action's advantage when it is imitated; 0 imitates all alike."""


class StateIndependentScale(nn.Module):
    """Outputs ``[*batch, m]`` of a network to the mean in -1..1 of a normal, and its standard deviation, the same everywhere."""

    def __init__(self, size: int) -> None:
        super().__init__()
        self.log_scale = nn.Parameter(torch.zeros(size))

    def forward(self, out: Tensor) -> tuple[Tensor, Tensor]:
        mean = out.tanh()
        return mean, self.log_scale.clamp(*LOG_SCALE).exp().expand_as(mean)


def build(env: EnvBase, settings: IQLSettings, device: torch.device | str = "cpu") -> Learner:
    """IQL for an environment; networks are drawn from torch's global generator."""
    m, encoder = action_size(env), make_encoder(env, settings)
    kind = {"layer_norm": settings.critic_layer_norm}
    actor = ProbabilisticActor(
        TensorDictModule(
            Actor(encoder, make_body(settings, encoder.size, m), StateIndependentScale(m)),
            in_keys=encoder_keys(encoder),
            out_keys=["loc", "scale"],
        ),
        in_keys=["loc", "scale"],
        distribution_class=IndependentNormal,
        spec=Composite(action=action_spec(env)),
    ).to(device)
    loss = IQLLoss(
        actor,
        critic_operator(encoder, make_body(settings, encoder.size + m, 1, **kind)).to(device),
        value_operator(encoder, make_body(settings, encoder.size, 1, **kind)).to(device),
        loss_function="l2",
        temperature=settings.temperature,
        expectile=settings.expectile,
        deactivate_vmap=True,
    ).to(device)
    loss.make_value_estimator(gamma=settings.gamma)
    loss.value_estimator.set_keys(steps_to_next_obs=("next", "steps_to_next_obs"))  # it passes on nothing that is beside "next"
    bounded = TensorDictModule(nn.Hardtanh(), in_keys=["action"], out_keys=["action"])
    target = SoftUpdate(loss, tau=settings.tau)
    return off_policy_learner(env, settings, TensorDictSequential(actor, bounded), loss, target)
