"""Your own algorithm in a few lines: DDPG (Lillicrap et al., 2016) with TorchRL's loss, which
BricksRL does not include.

bricksrl check examples/12_own_agent.py
bricksrl train RoboArmSim-v0 --agent examples/12_own_agent.py --set noise=0.2
"""

from dataclasses import dataclass

from torchrl.objectives import DDPGLoss, SoftUpdate

from bricksrl.agents import networks, operators, settings
from bricksrl.agents.features import encoder
from bricksrl.agents.replay.replay_learner import off_policy_learner


@dataclass(frozen=True)
class Settings(settings.OffPolicySettings):
    noise: float = 0.3
    """Standard deviation of the noise on the actions while exploring."""


def build(env, settings: Settings, device="cpu"):
    features, m = encoder.make_encoder(env, settings), networks.action_size(env)
    body = networks.make_body(settings, features.size, m, norm="layer")
    critic = operators.critic_operator(
        features, networks.make_body(settings, features.size + m, 1, norm="layer")
    )
    actor, policy = networks.deterministic_policy(
        features, body, networks.action_spec(env), noise=settings.noise
    )
    loss = DDPGLoss(actor, critic, delay_actor=True, delay_value=True).to(device)
    loss.make_value_estimator(gamma=settings.gamma)
    return off_policy_learner(env, settings, policy.to(device), loss, SoftUpdate(loss, tau=0.005))
