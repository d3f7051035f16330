"""Truncated quantile critics (Kuznetsov et al., 2020), with TorchRL's loss."""

from dataclasses import dataclass
from typing import Annotated

import torch
from torchrl.envs import EnvBase
from torchrl.objectives import SoftUpdate, TQCLoss

from bricksrl.agents.features.encoder import make_encoder
from bricksrl.agents.networks import action_size, action_spec, gaussian_policy, make_body
from bricksrl.agents.operators import critic_operator
from bricksrl.agents.replay.replay_learner import ReplayLearner, off_policy_learner
from bricksrl.agents.settings import (
    IMAGES_TARGETS,
    PAPER_TARGETS,
    EntropySettings,
    OffPolicySettings,
    Presets,
    Range,
    TargetSettings,
)
from bricksrl.errors import DescriptionError


@dataclass(frozen=True)
class TQCSettings(EntropySettings, TargetSettings, OffPolicySettings):
    """Settings of TQC."""

    num_qs: Annotated[int, Range(1, 64)] = 2
    """Number of critics."""
    quantiles: Annotated[int, Range(2, 200)] = 25
    """Quantiles of the return per critic."""
    dropped: Annotated[int, Range(0, 200)] = 2
    """Number of largest quantiles per critic that the target omits."""

    def __post_init__(self) -> None:
        super().__post_init__()
        # the target is a mean over those that are left
        if self.dropped >= self.quantiles:
            raise DescriptionError(
                f"dropped is {self.dropped}; leave at least one of the {self.quantiles} quantiles"
            )


PRESETS = {
    "tqc": Presets(
        default=TQCSettings(),
        images=TQCSettings(**IMAGES_TARGETS, alpha_init=0.1),
        paper=TQCSettings(**PAPER_TARGETS, alpha_init=1.0),
    )
}


def build(
    env: EnvBase,
    settings: TQCSettings,
    device: torch.device | str = "cpu",
) -> ReplayLearner:
    """TQC for an environment. Initialized from torch's global generator."""
    m = action_size(env)
    encoder = make_encoder(env, settings)
    actor = make_body(settings, encoder.size, 2 * m)
    policy = gaussian_policy(
        encoder,
        actor,
        action_spec(env),
        min_scale=settings.min_scale,
    )
    # TorchRL makes the other critics from this one, with weights of their own
    body = make_body(
        settings,
        encoder.size + m,
        settings.quantiles,
        norm=settings.critic_norm,
    )
    critic = critic_operator(encoder, body)
    loss = TQCLoss(
        policy.to(device),
        critic.to(device),
        num_qvalue_nets=settings.num_qs,
        top_quantiles_to_drop_per_net=settings.dropped,
        alpha_init=settings.alpha_init,
        target_entropy=settings.target_entropy * m,
        action_spec=action_spec(env),
        # a loop over the critics, which is faster than TorchRL's vmap for so few
        deactivate_vmap=True,
    ).to(device)
    loss.make_value_estimator(gamma=settings.gamma)
    target = SoftUpdate(loss, tau=settings.tau)
    return off_policy_learner(
        env,
        settings,
        policy,
        loss,
        target,
    )
