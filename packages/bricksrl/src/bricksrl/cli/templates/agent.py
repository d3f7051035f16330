"""An algorithm of my own: deep deterministic policy gradient (Lillicrap et al., 2016) with
TorchRL's loss.

bricksrl check my_file.py                                   # builds, learns, saves, restores?
bricksrl train WalkerSim-v0 --agent my_file.py --episodes 20
bricksrl train WalkerSim-v0 --agent my_file.py --set noise=0.2
"""

from __future__ import annotations

from dataclasses import dataclass

from torchrl.envs import EnvBase
from torchrl.objectives import DDPGLoss, SoftUpdate

from bricksrl.agents import networks, operators, settings
from bricksrl.agents.features import encoder
from bricksrl.agents.replay.replay_learner import ReplayLearner, off_policy_learner


# What can be set: `bricksrl settings my_file.py` shows it. Learning rate, layers, batch size and so
# on come from the base.
@dataclass(frozen=True)
class Settings(settings.OffPolicySettings):
    """Settings of the algorithm; the text below a field is its help."""

    noise: float = 0.3
    """Standard deviation of the noise on the actions while exploring."""


def build(env: EnvBase, settings: Settings, device: str = "cpu") -> ReplayLearner:
    """The algorithm in an environment: networks, loss, optimiser, replay buffer."""
    # Networks: features of the observation, the actor, and a critic of observation and action.
    features = encoder.make_encoder(env, settings)
    actions = networks.action_size(env)
    body = networks.make_body(settings, features.size, actions, norm="layer")
    critic = operators.critic_operator(
        features, networks.make_body(settings, features.size + actions, 1, norm="layer")
    )
    actor, policy = networks.deterministic_policy(
        features, body, networks.action_spec(env), noise=settings.noise
    )

    # The loss is any LossModule of TorchRL's or of your own; the target networks follow slowly.
    loss = DDPGLoss(actor, critic, delay_actor=True, delay_value=True).to(device)
    loss.make_value_estimator(gamma=settings.gamma)
    target = SoftUpdate(loss, tau=0.005)

    # All parts together, with Adam and a replay buffer; the training loop collects steps, remembers
    # them and learns from batches.
    return off_policy_learner(env, settings, policy.to(device), loss, target)
