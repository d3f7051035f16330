"""Who updates the same networks: our agents, the same agents written with TorchRL's losses, Stable-Baselines3, and SBX.

Each function makes ``UPDATES`` updates of one agent: two layers of 256, batches of 256, an observation of 8 numbers and an action
of 4, out of a replay buffer of its own with 10,000 random transitions.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import replace
from typing import TYPE_CHECKING, Any

if TYPE_CHECKING:
    from torchrl.data import TensorDictReplayBuffer

UPDATES = 20
OBSERVATION, ACTION, HIDDEN, BATCH = 8, 4, (256, 256), 256
STORED = 10_000

Update = Callable[[], object]
"""``UPDATES`` updates."""


def ours(agent: str, precision: str = "float32") -> Update:
    """Our agent, with the paper's settings but for networks and batch; 20 updates in one call."""
    import torch

    from bricksrl.agents import make_agent, preset
    from bricksrl.agents.agent import Transition
    from bricksrl.agents.layout import ObservationLayout
    from bricksrl.agents.off_policy import OffPolicyAgent

    torch.set_num_threads(1)
    torch.manual_seed(0)
    changes: Any = {"hidden": HIDDEN, "batch_size": BATCH, "updates_per_step": UPDATES, "precision": precision}
    layout = ObservationLayout((-1.0,) * OBSERVATION, (1.0,) * OBSERVATION, (False,) * OBSERVATION)
    learner = make_agent(agent, layout, ACTION, replace(preset("paper", agent), **changes))
    assert isinstance(learner, OffPolicyAgent)
    for _ in range(STORED):
        one, other = torch.rand(2, OBSERVATION) * 2 - 1
        learner.remember(Transition(one, torch.rand(ACTION) * 2 - 1, float(one.sum()), other, False))
    return learner.update


def ours_bf16(agent: str) -> Update:
    """The same, networks computed in bfloat16."""
    return ours(agent, "bfloat16")


def torchrl(agent: str, *, parts: bool = False) -> Update:
    """The agent as TorchRL's own examples have it: its loss on each batch, one Adam, soft targets.

    Args:
        parts: of SAC's loss, compute only the critics' where the actor does not learn; the examples compute all of it.
    """
    import torch

    torch.set_num_threads(1)
    torch.manual_seed(0)
    if agent == "td3":
        return _torchrl_td3()
    if agent == "crossq":
        return _torchrl_crossq()
    kind = {"layer_norm": True, "dropout": 0.01} if agent == "droq" else {}
    return _torchrl_sac(kind, count=10 if agent == "redq" else 2, delay=1 if agent == "sac" else UPDATES, parts=parts)


def torchrl_parts(agent: str) -> Update:
    """The agent as somebody writes it with TorchRL who leaves out what is not needed."""
    return torchrl(agent, parts=True)


def critic(*, layer_norm: bool = False, dropout: float = 0.0, batch_norm: bool = False) -> Any:
    """TorchRL's critic."""
    import torch
    from torch import Tensor, nn
    from torchrl.modules import MLP, ValueOperator

    class Critic(nn.Module):
        """An action value, from ordinary layers."""

        def __init__(self) -> None:
            super().__init__()
            norm: dict[str, Any] = {}
            if layer_norm:
                norm = {"norm_class": nn.LayerNorm, "norm_kwargs": {"normalized_shape": HIDDEN[0]}}
            if batch_norm:
                norm = {"norm_class": nn.BatchNorm1d, "norm_kwargs": {"num_features": HIDDEN[0], "momentum": 0.01, "eps": 1e-3}}
            size = OBSERVATION + ACTION
            first = [nn.BatchNorm1d(size, momentum=0.01, eps=1e-3)] if batch_norm else []
            mlp = MLP(size, 1, num_cells=list(HIDDEN), activation_class=nn.ReLU, dropout=dropout or None, **norm)
            self.layers = nn.Sequential(*first, mlp)

        def forward(self, observation: Tensor, action: Tensor) -> Tensor:
            """The value ``[*batch, 1]``."""
            value: Tensor = self.layers(torch.cat((observation, action), -1))
            return value

    return ValueOperator(Critic(), in_keys=["observation", "action"])


def _torchrl_actor(*, batch_norm: bool = False) -> Any:
    from tensordict.nn import NormalParamExtractor
    from torch import nn
    from torchrl.modules import MLP

    from bricksrl.agents.networks import make_policy

    norm: dict[str, Any] = {}
    if batch_norm:
        norm = {"norm_class": nn.BatchNorm1d, "norm_kwargs": {"num_features": HIDDEN[0], "momentum": 0.01, "eps": 1e-3}}
    first = [nn.BatchNorm1d(OBSERVATION, momentum=0.01, eps=1e-3)] if batch_norm else []
    mlp = MLP(OBSERVATION, 2 * ACTION, num_cells=list(HIDDEN), activation_class=nn.ReLU, **norm)
    return make_policy(nn.Sequential(*first, mlp, NormalParamExtractor(scale_lb=0.1)), ACTION)


def stored() -> TensorDictReplayBuffer:
    """TorchRL's replay buffer, full of random transitions."""
    import torch
    from tensordict import TensorDict
    from torchrl.data import LazyTensorStorage, TensorDictReplayBuffer

    buffer = TensorDictReplayBuffer(storage=LazyTensorStorage(STORED), batch_size=BATCH)
    done = torch.zeros(STORED, 1, dtype=torch.bool)
    observation, following = (torch.rand(2, STORED, OBSERVATION) * 2 - 1).unbind()
    after = {"observation": following, "reward": observation.sum(-1, keepdim=True), "done": done, "terminated": done.clone()}
    data = {"observation": observation, "action": torch.rand(STORED, ACTION) * 2 - 1, "next": TensorDict(after, [STORED])}
    buffer.extend(TensorDict(data, [STORED]))
    return buffer


def spec() -> Any:
    """Of the actions."""
    from torchrl.data import Bounded

    return Bounded(-1.0, 1.0, (ACTION,))


def _torchrl_sac(kind: dict[str, Any], *, count: int, delay: int, parts: bool) -> Update:
    """SAC, or DroQ and REDQ where the actor learns in every ``delay``-th update."""
    import torch
    from torchrl.objectives import SACLoss, SoftUpdate

    loss = SACLoss(_torchrl_actor(), critic(**kind), num_qvalue_nets=count, loss_function="l2", action_spec=spec())
    loss.make_value_estimator(gamma=0.99)
    targets, optimiser, buffer = SoftUpdate(loss, tau=0.005), torch.optim.Adam(loss.parameters(), lr=3e-4), stored()

    def update() -> None:
        for i in range(1, UPDATES + 1):
            batch = buffer.sample()
            if parts and i % delay:
                total, _ = loss.qvalue_v2_loss(batch)
            else:
                found = loss(batch)
                total = found["loss_qvalue"]
                if i % delay == 0:
                    total = total + found["loss_actor"] + found["loss_alpha"]
            total.backward()
            optimiser.step()
            optimiser.zero_grad()
            targets.step()

    return update


def _torchrl_td3() -> Update:
    """TD3 with an actor that learns in every second update."""
    import torch
    from tensordict.nn import TensorDictModule
    from torch import nn
    from torchrl.modules import MLP
    from torchrl.objectives import SoftUpdate, TD3Loss

    mlp = MLP(OBSERVATION, ACTION, num_cells=list(HIDDEN), activation_class=nn.ReLU)
    actor = TensorDictModule(nn.Sequential(mlp, nn.Tanh()), ["observation"], ["action"])
    loss = TD3Loss(actor, critic(), action_spec=spec(), loss_function="l2")
    loss.make_value_estimator(gamma=0.99)
    targets, buffer = SoftUpdate(loss, tau=0.005), stored()
    for_critics = torch.optim.Adam(list(loss.qvalue_network_params.flatten_keys().values()), lr=3e-4)
    for_actor = torch.optim.Adam(list(loss.actor_network_params.flatten_keys().values()), lr=3e-4)

    def update() -> None:
        for i in range(1, UPDATES + 1):
            batch = buffer.sample()
            of_critics, _ = loss.value_loss(batch)
            of_critics.backward()
            for_critics.step()
            for_critics.zero_grad()
            if i % 2 == 0:
                of_actor, _ = loss.actor_loss(batch)
                of_actor.backward()
                for_actor.step()
                for_actor.zero_grad()
                targets.step()

    return update


def _torchrl_crossq() -> Update:
    """CrossQ with an actor that learns in every third update."""
    import torch
    from torchrl.objectives import CrossQLoss

    actor = _torchrl_actor(batch_norm=True)
    loss = CrossQLoss(actor, critic(batch_norm=True), num_qvalue_nets=2, loss_function="l2", action_spec=spec())
    loss.make_value_estimator(gamma=0.99)
    optimiser, buffer = torch.optim.Adam(loss.parameters(), lr=1e-3, betas=(0.5, 0.999)), stored()

    def update() -> None:
        for i in range(1, UPDATES + 1):
            batch = buffer.sample()
            total, _ = loss.qvalue_loss(batch)
            if i % 3 == 0:
                of_actor, found = loss.actor_loss(batch)
                total = total + of_actor + loss.alpha_loss(found["log_prob"])
            total.backward()
            optimiser.step()
            optimiser.zero_grad()

    return update


def sb3(agent: str) -> Update:
    """Stable-Baselines3's own agent."""
    import stable_baselines3
    import torch

    torch.set_num_threads(1)
    kind = {"sac": stable_baselines3.SAC, "td3": stable_baselines3.TD3}[agent]
    return _baseline(kind, {"device": "cpu"}, {"net_arch": list(HIDDEN)})


def sbx(agent: str) -> Update:
    """SBX's own agent, in JAX; DroQ is a setting of its SAC."""
    import sbx as jax_agents

    kind = {"sac": jax_agents.SAC, "droq": jax_agents.SAC, "td3": jax_agents.TD3, "crossq": jax_agents.CrossQ}[agent]
    critic = {"dropout_rate": 0.01, "layer_norm": True} if agent == "droq" else {}
    options = {"policy_delay": UPDATES} if agent == "droq" else {}
    return _baseline(kind, options, {"net_arch": {"pi": list(HIDDEN), "qf": list(HIDDEN)}, **critic})


def _baseline(kind: Any, options: dict[str, Any], policy: dict[str, Any]) -> Update:
    import gymnasium
    import numpy as np
    from gymnasium.spaces import Box
    from stable_baselines3.common.logger import configure

    class Still(gymnasium.Env[Any, Any]):
        """Says only what there is to observe and to do."""

        observation_space = Box(-1.0, 1.0, (OBSERVATION,), np.float32)
        action_space = Box(-1.0, 1.0, (ACTION,), np.float32)

    model = kind("MlpPolicy", Still(), batch_size=BATCH, buffer_size=STORED, seed=0, policy_kwargs=policy, **options)
    model.set_logger(configure(None, []))
    rng = np.random.default_rng(0)
    for _ in range(STORED):
        one, other = rng.uniform(-1, 1, (2, 1, OBSERVATION)).astype(np.float32)
        action = rng.uniform(-1, 1, (1, ACTION)).astype(np.float32)
        model.replay_buffer.add(one, other, action, one.sum(-1), np.zeros(1), [{}])
    return lambda: model.train(gradient_steps=UPDATES, batch_size=BATCH)


CONTESTANTS: dict[str, tuple[Callable[[str], Update], tuple[str, ...]]] = {
    "ours": (ours, ("sac", "td3", "droq", "redq", "crossq")),
    "ours_bf16": (ours_bf16, ("sac", "td3", "droq", "redq", "crossq")),
    "torchrl": (torchrl, ("sac", "td3", "droq", "redq", "crossq")),
    "torchrl_parts": (torchrl_parts, ("droq", "redq")),
    "sb3": (sb3, ("sac", "td3")),
    "sbx": (sbx, ("sac", "td3", "droq", "crossq")),
}
"""Each with the agents that it has."""
