"""Implicit Q-learning (Kostrikov et al., 2021) with TorchRL's loss: only values of the data's
actions are used."""

from dataclasses import dataclass
from typing import Annotated

import torch
from tensordict.nn import TensorDictModule, TensorDictSequential
from torch import Tensor, nn
from torchrl.data import Composite
from torchrl.envs import EnvBase
from torchrl.modules import IndependentNormal, ProbabilisticActor
from torchrl.objectives import IQLLoss, SoftUpdate

from bricksrl.agents.features.encoder import encoder_keys, make_encoder
from bricksrl.agents.networks import Actor, action_size, action_spec, make_body
from bricksrl.agents.operators import critic_operator, value_operator
from bricksrl.agents.replay.replay_learner import ReplayLearner, off_policy_learner
from bricksrl.agents.settings import (
    IMAGES_TARGETS,
    PAPER_TARGETS,
    NotNegative,
    OffPolicySettings,
    Presets,
    Range,
    Share,
    TargetSettings,
)

LOG_SCALE = (-5.0, 2.0)
"""Limits of the log standard deviation; source: the authors' code."""


@dataclass(frozen=True)
class IQLSettings(TargetSettings, OffPolicySettings):
    """Settings of IQL."""

    new_goals: Annotated[float, Share] = 0.0
    """Share of relabelled goals; 0, as actions for one goal are no examples for a random other
    one."""
    expectile: Annotated[float, Range(0.0, 1.0, above=True, below=True)] = 0.8
    """Expectile of the action values that is a state's value; 0.5 is the mean."""
    temperature: Annotated[float, NotNegative] = 3.0
    """Weight of the advantage in imitation; 0 imitates all actions equally."""


PRESETS = {
    "iql": Presets(
        default=IQLSettings(),
        images=IQLSettings(**IMAGES_TARGETS),
        paper=IQLSettings(
            **PAPER_TARGETS,
            expectile=0.5,
            temperature=1.0,
        ),
    )
}


class StateIndependentScale(nn.Module):
    """Outputs ``[*batch, m]`` to a normal's mean in -1..1 and its state-independent standard
    deviation."""

    def __init__(self, size: int) -> None:
        super().__init__()
        self.log_scale = nn.Parameter(torch.zeros(size))

    def forward(self, out: Tensor) -> tuple[Tensor, Tensor]:
        mean = out.tanh()
        scale = self.log_scale.clamp(*LOG_SCALE).exp()
        return mean, scale.expand_as(mean)


def build(
    env: EnvBase,
    settings: IQLSettings,
    device: torch.device | str = "cpu",
) -> ReplayLearner:
    """IQL for an environment. Initialized from torch's global generator."""
    m = action_size(env)
    encoder = make_encoder(env, settings)
    actor_body = make_body(settings, encoder.size, m)
    network = Actor(encoder, actor_body, StateIndependentScale(m))
    actor = ProbabilisticActor(
        TensorDictModule(network, in_keys=encoder_keys(encoder), out_keys=["loc", "scale"]),
        in_keys=["loc", "scale"],
        # not squashed, as in the authors' code: actions of a dataset may be at their limits, where
        # the density of a squashed one is not finite
        distribution_class=IndependentNormal,
        spec=Composite(action=action_spec(env)),
    ).to(device)
    critic_body = make_body(
        settings,
        encoder.size + m,
        1,
        norm=settings.critic_norm,
    )
    critic = critic_operator(encoder, critic_body).to(device)
    value_body = make_body(
        settings,
        encoder.size,
        1,
        norm=settings.critic_norm,
    )
    value = value_operator(encoder, value_body).to(device)
    loss = IQLLoss(
        actor,
        critic,
        value,
        loss_function="l2",
        temperature=settings.temperature,
        expectile=settings.expectile,
        # a loop over the critics, which is faster than TorchRL's vmap for so few
        deactivate_vmap=True,
    ).to(device)
    loss.make_value_estimator(gamma=settings.gamma)
    # it passes on only what is under "next"
    loss.value_estimator.set_keys(steps_to_next_obs=("next", "steps_to_next_obs"))
    # a normal reaches beyond -1..1; the loss must see it without this limit
    bounded = TensorDictModule(nn.Hardtanh(), in_keys=["action"], out_keys=["action"])
    policy = TensorDictSequential(actor, bounded)
    target = SoftUpdate(loss, tau=settings.tau)
    return off_policy_learner(
        env,
        settings,
        policy,
        loss,
        target,
    )
