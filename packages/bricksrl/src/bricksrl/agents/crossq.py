"""CrossQ (Bhatt et al., 2024): SAC with batch normalisation instead of target critics."""

from dataclasses import dataclass
from typing import Annotated, ClassVar

import torch
from torch import Tensor, nn
from torchrl.envs import EnvBase

from bricksrl.agents.actor_critic import Batch, Critics
from bricksrl.agents.features.encoder import make_encoder
from bricksrl.agents.networks import BatchNorm, action_size, action_spec, gaussian_policy, make_body
from bricksrl.agents.replay.replay_learner import ReplayLearner, off_policy_learner
from bricksrl.agents.sac import SACLoss
from bricksrl.agents.settings import (
    IMAGES_OFF_POLICY,
    PAPER_OFF_POLICY,
    EntropySettings,
    OffPolicySettings,
    Positive,
    Presets,
    Range,
    ShareBelowOne,
)


@dataclass(frozen=True)
class CrossQSettings(EntropySettings, OffPolicySettings):
    """Settings of CrossQ."""

    actor_q: ClassVar[str] = "min"
    """The actor maximises the minimum of the critics."""
    batch_size: Annotated[int, Range(2)] = 256
    adam_beta: Annotated[float, ShareBelowOne] = 0.5
    actor_delay: Annotated[int, Range(1)] = 3
    alpha_init: Annotated[float, Positive] = 0.1
    momentum: Annotated[float, Range(0.0, 1.0, above=True)] = 0.05
    """Weight of a batch in the running statistics of batch normalisation."""


PRESETS = {
    "crossq": Presets(
        default=CrossQSettings(),
        images=CrossQSettings(**IMAGES_OFF_POLICY),
        # rate and momentum of its authors
        paper=CrossQSettings(
            **{**PAPER_OFF_POLICY, "learning_rate": 1e-3},
            alpha_init=1.0,
            momentum=0.01,
        ),
    )
}


class CrossQLoss(SACLoss):
    """Loss of CrossQ: state and next state pass the critics in one batch, normalised together.
    Networks use running statistics except where a loss trains them. Tests compare it with TorchRL's
    ``CrossQLoss``."""

    def __init__(
        self,
        encoder: nn.Module,
        actor: nn.Module,
        critics: Critics,
        settings: CrossQSettings,
    ) -> None:
        super().__init__(
            encoder,
            actor,
            critics,
            settings,
        )
        # SAC's: a copy that nothing moves would only fill memory and checkpoints
        del self.target_critics

    def qvalue_loss(self, batch: Batch) -> dict[str, Tensor]:
        """Squared errors summed over the critics."""
        self.actor.eval()
        with torch.no_grad():
            out = self.actor(batch.next_features)
            next_action, next_log_prob = self.draw(out, batch.next_base)
        # one pass for both: actions of the data and of the policy are distributed differently, and
        # statistics of one of them would not fit the other
        features = torch.cat((batch.features, batch.next_features))
        actions = torch.cat((batch.action, next_action))
        self.critics.train()
        both_values = self.critics(features, actions)  # [k, 2 batch]
        self.critics.eval()
        count = len(batch.reward)
        values = both_values[:, :count]
        # the critics are their own targets, of which nothing is learned
        next_values = both_values[:, count:].detach()
        next_value = next_values.amin(0) - self.alpha * next_log_prob
        target = batch.reward + batch.discount * next_value
        return {"loss_qvalue": self.errors(values, target)}

    def actor_loss(self, batch: Batch) -> dict[str, Tensor]:
        """Losses of actor and temperature; the critics use running statistics."""
        self.actor.train()
        losses = super().actor_loss(batch)
        self.actor.eval()
        return losses


def batch_normalised(network: nn.Module, momentum: float) -> nn.Sequential:
    """A multilayer perceptron with batch normalisation before each linear layer."""
    layers: list[nn.Module] = []
    for layer in network.children():
        if isinstance(layer, nn.Linear):
            # epsilon of CrossQ's authors
            layers.append(BatchNorm(layer.in_features, eps=1e-3, momentum=momentum))
        layers.append(layer)
    return nn.Sequential(*layers)


def build(
    env: EnvBase,
    settings: CrossQSettings,
    device: torch.device | str = "cpu",
) -> ReplayLearner:
    """CrossQ for an environment. Initialized from torch's global generator."""
    m = action_size(env)
    encoder = make_encoder(env, settings)

    def body(in_size: int, out_size: int) -> nn.Module:
        network = make_body(settings, in_size, out_size)
        # a user's network is learned as it is
        if settings.network:
            return network
        return batch_normalised(network, settings.momentum)

    actor = body(encoder.size, 2 * m).eval()
    bodies = [body(encoder.size + m, 1) for _ in range(2)]
    critics = Critics(bodies).eval()
    policy = gaussian_policy(
        encoder,
        actor,
        action_spec(env),
        min_scale=settings.min_scale,
    )
    loss = CrossQLoss(
        encoder,
        actor,
        critics,
        settings,
    ).to(device)
    return off_policy_learner(
        env,
        settings,
        policy.to(device),
        loss,
    )
