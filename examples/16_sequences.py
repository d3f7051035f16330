"""An agent that reads sequences: a small decision transformer (Chen et al., 2021,
https://arxiv.org/abs/2106.01345).

It is asked for a return, and acts on its last observations. Its replay buffer is TorchRL's, with a
sampler of slices of episodes:

    bricksrl train WalkerSim-v0 --episodes 20 --run runs/sac
    bricksrl train-offline WalkerSim-v0 --agent examples/16_sequences.py --data runs/sac \\
        --updates 2000 --run runs/offline
    bricksrl train WalkerSim-v0 --agent examples/16_sequences.py --from runs/offline
"""

from dataclasses import dataclass

import torch
from tensordict import TensorDict, TensorDictBase
from tensordict.nn import TensorDictModuleBase
from torch import Tensor, nn
from torchrl.data import LazyTensorStorage, SliceSampler, TensorDictReplayBuffer
from torchrl.envs import EnvBase
from torchrl.envs.utils import ExplorationType, exploration_type
from torchrl.objectives.common import LossModule

from bricksrl.agents.gradient_descent import GradientDescent
from bricksrl.agents.replay.replay_learner import ReplayLearner

SLICE = 8
"""Steps of a sequence."""


@dataclass(frozen=True)
class Settings:
    """Settings of the agent."""

    width: int = 64
    """Numbers of a token."""
    asked: float = 0.0
    """Return that is asked for until the end of a sequence."""


class Transformer(TensorDictModuleBase):
    """Policy: the last observations ``[*copies, n]``, and the return asked for, to "action"
    ``[*copies, m]``."""

    def __init__(self, env: EnvBase, settings: Settings) -> None:
        super().__init__()
        spec = env.full_observation_spec_unbatched["observation"]
        self.in_keys, self.out_keys, self.asked = ["observation"], ["action"], settings.asked
        self.register_buffer(
            "scale", torch.maximum(spec.low.abs(), spec.high.abs()).clamp(1.0, 1e4)
        )
        layer = nn.TransformerEncoderLayer(
            settings.width, 4, 2 * settings.width, dropout=0.0, batch_first=True
        )
        self.token, self.place = (
            nn.Linear(len(self.scale) + 1, settings.width),
            nn.Embedding(SLICE, settings.width),
        )
        self.body = nn.TransformerEncoder(layer, 2, enable_nested_tensor=False)
        self.head = nn.Linear(settings.width, env.full_action_spec_unbatched["action"].shape[-1])
        self.reset()

    def reset(self) -> None:
        """Forget the episode."""
        self.seen: list[Tensor] = []

    def actions(self, observed: Tensor, to_go: Tensor) -> Tensor:
        """Actions ``[batch, time, m]`` for observations ``[batch, time, n]`` and returns to go
        ``[batch, time, 1]``."""
        time = observed.shape[1]
        tokens = self.token(torch.cat((observed / self.scale, to_go / 10.0), -1)) + self.place(
            torch.arange(time)
        )
        mask = nn.Transformer.generate_square_subsequent_mask(time)
        acted: Tensor = self.head(self.body(tokens, mask=mask, is_causal=True)).tanh()
        return acted

    def forward(self, tensordict: TensorDictBase) -> TensorDictBase:
        """Write the action; noise explores."""
        self.seen = [*self.seen, tensordict["observation"]][-SLICE:]
        observed = torch.stack(self.seen, -2)
        rows = observed.reshape(-1, *observed.shape[-2:])
        action = self.actions(rows, torch.full_like(rows[..., :1], self.asked))[:, -1].view(
            *observed.shape[:-2], -1
        )
        if exploration_type() == ExplorationType.RANDOM:
            action = (action + 0.1 * torch.randn_like(action)).clamp(-1.0, 1.0)
        return tensordict.set("action", action)


class ImitationLoss(LossModule):
    """Squared error of the actions in slices of episodes, given what they led to."""

    def __init__(self, policy: Transformer) -> None:
        super().__init__()
        self.policy = policy

    def forward(self, batch: TensorDictBase) -> TensorDict:
        """The loss of a batch ``[slices * SLICE]``."""
        rows = batch.view(-1, SLICE)
        to_go = rows["next", "reward"].flip(1).cumsum(1).flip(1)
        return TensorDict(
            {
                "loss_action": (self.policy.actions(rows["observation"], to_go) - rows["action"])
                .square()
                .mean()
            }
        )


def build(env: EnvBase, settings: Settings, device: str = "cpu") -> ReplayLearner:
    """The agent for an environment."""
    policy = Transformer(env, settings).to(device)
    loss = ImitationLoss(policy)
    sampler = SliceSampler(slice_len=SLICE, end_key=("next", "done"))
    memory = TensorDictReplayBuffer(
        storage=LazyTensorStorage(100_000), sampler=sampler, batch_size=32 * SLICE
    )
    descent = GradientDescent(loss, torch.optim.Adam(loss.parameters(), 1e-3))
    return ReplayLearner(policy, descent, memory)
