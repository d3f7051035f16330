"""Agents whose updates are compared: ours, the same ones written with TorchRL's losses,
Stable-Baselines3, and SBX.

Each function makes ``UPDATES`` updates of one agent: two layers of 256, batches of 256, an
observation of 8 numbers and an action of 4, from its own replay buffer with 10,000 random
transitions.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import replace
from typing import TYPE_CHECKING, Any

if TYPE_CHECKING:
    from tensordict import TensorDict
    from torchrl.data import TensorDictReplayBuffer

UPDATES = 20
OBSERVATION, ACTION, HIDDEN, BATCH = 8, 4, (256, 256), 256
STORED = 10_000

Update = Callable[[], object]
"""``UPDATES`` updates."""


def bare_environment() -> Any:
    """An environment with specs only."""
    from torchrl.data import Bounded, Composite, Unbounded
    from torchrl.envs import EnvBase

    class Bare(EnvBase):  # type: ignore[misc]
        """Specs only; never stepped."""

        def __init__(self) -> None:
            super().__init__(batch_size=())
            self.observation_spec = Composite(observation=Bounded(-1.0, 1.0, (OBSERVATION,)))
            self.action_spec = Bounded(-1.0, 1.0, (ACTION,))
            self.reward_spec = Unbounded((1,))

        def _reset(self, tensordict: Any = None, **_: Any) -> Any:
            raise NotImplementedError

        def _step(self, tensordict: Any) -> Any:
            raise NotImplementedError

        def _set_seed(self, seed: int | None) -> None:
            raise NotImplementedError

    return Bare()


def learner_of(agent: str, **changes: Any) -> Any:
    """Our learner with the paper's settings except for networks and batch, filled with random
    transitions. DroQ's actor is that of its authors, as the other packages have it: plain, and
    learning once in 20 updates."""
    import torch

    from bricksrl.agents import make_learner, preset

    values = {"hidden": HIDDEN, "batch_size": BATCH, "buffer_size": STORED, **changes}
    if agent == "droq":
        values |= {"actor_norm": "none", "actor_dropout": 0.0, "actor_delay": UPDATES}
    torch.manual_seed(0)
    learner = make_learner(agent, bare_environment(), replace(preset("paper", agent), **values))
    learner.remember(transitions())
    return learner


def ours(agent: str) -> Update:
    """Our agent; 20 updates in one call."""
    import torch

    torch.set_num_threads(1)
    learner = learner_of(agent)
    return lambda: learner.make_updates(UPDATES)


def ours_compiled(agent: str) -> Update:
    """Our agent, forward and backward pass in one graph, as with ``--compile``."""
    import torch

    from bricksrl.agents.compiled import compile_updates

    torch.set_num_threads(1)
    learner = learner_of(agent)
    compile_updates(learner)
    return lambda: learner.make_updates(UPDATES)


def torchrl(agent: str, *, tuned: bool = False) -> Update:
    """The agent as in TorchRL's examples: its loss on each batch, Adam, soft targets.

    Args:
        tuned: optimised: no vmap, fused Adam, one backward pass, and no computation of the actor's
            loss in updates without the actor.
    """
    import torch
    from tensordict.nn import TensorDictModule
    from torch import nn
    from torchrl import objectives
    from torchrl.modules import MLP

    torch.set_num_threads(1)
    torch.manual_seed(0)
    values = {"loss_function": "l2", "action_spec": spec(), "deactivate_vmap": tuned}
    adam: dict[str, Any] = {"lr": 3e-4, "fused": tuned}
    # the actor learns in each update of this number
    delay = {"sac": 1, "td3": 2, "crossq": 3}.get(agent, UPDATES)
    if agent == "td3":
        mlp = MLP(OBSERVATION, ACTION, num_cells=list(HIDDEN), activation_class=nn.ReLU)
        actor = TensorDictModule(nn.Sequential(mlp, nn.Tanh()), ["observation"], ["action"])
        loss = objectives.TD3Loss(actor, critic(), **values)
    elif agent == "crossq":
        adam |= {"lr": 1e-3, "betas": (0.5, 0.999)}
        loss = objectives.CrossQLoss(
            _torchrl_actor(batch_norm=True), critic(batch_norm=True), num_qvalue_nets=2, **values
        )
    else:
        norm: dict[str, Any] = {"layer_norm": True, "dropout": 0.01} if agent == "droq" else {}
        loss = objectives.SACLoss(
            _torchrl_actor(), critic(**norm), num_qvalue_nets=10 if agent == "redq" else 2, **values
        )
    loss.make_value_estimator(gamma=0.99)
    targets = None if agent == "crossq" else objectives.SoftUpdate(loss, tau=0.005)
    optimizer, buffer = torch.optim.Adam(loss.parameters(), **adam), stored()

    def losses(batch: Any, *, with_actor: bool) -> Any:
        if agent in ("td3", "crossq"):
            total, _ = loss.value_loss(batch) if agent == "td3" else loss.qvalue_loss(batch)
            if with_actor:
                of_actor, metadata = loss.actor_loss(batch)
                total = total + of_actor
                if agent == "crossq":
                    total = total + loss.alpha_loss(metadata["log_prob"])
            return total
        if tuned and not with_actor:
            return loss.qvalue_v2_loss(batch)[0]
        parts = loss(batch)
        return sum(
            parts[f"loss_{name}"]
            for name in ("qvalue", *(("actor", "alpha") if with_actor else ()))
        )

    def update() -> None:
        for i in range(1, UPDATES + 1):
            losses(buffer.sample(), with_actor=i % delay == 0).backward()
            optimizer.step()
            optimizer.zero_grad()
            if targets is not None and (agent != "td3" or i % delay == 0):
                targets.step()

    return update


def torchrl_tuned(agent: str) -> Update:
    """The agent with TorchRL's losses, optimised."""
    return torchrl(agent, tuned=True)


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
                norm = {
                    "norm_class": nn.BatchNorm1d,
                    "norm_kwargs": {"num_features": HIDDEN[0], "momentum": 0.01, "eps": 1e-3},
                }
            size = OBSERVATION + ACTION
            first = [nn.BatchNorm1d(size, momentum=0.01, eps=1e-3)] if batch_norm else []
            mlp = MLP(
                size,
                1,
                num_cells=list(HIDDEN),
                activation_class=nn.ReLU,
                dropout=dropout or None,
                **norm,
            )
            self.layers = nn.Sequential(*first, mlp)

        def forward(self, observation: Tensor, action: Tensor) -> Tensor:
            """The value ``[*batch, 1]``."""
            value: Tensor = self.layers(torch.cat((observation, action), -1))
            return value

    return ValueOperator(Critic(), in_keys=["observation", "action"])


def _torchrl_actor(*, batch_norm: bool = False) -> Any:
    from torch import nn
    from torchrl.modules import MLP

    from bricksrl.agents.networks import gaussian_policy

    norm: dict[str, Any] = {}
    if batch_norm:
        norm = {
            "norm_class": nn.BatchNorm1d,
            "norm_kwargs": {"num_features": HIDDEN[0], "momentum": 0.01, "eps": 1e-3},
        }
    first = [nn.BatchNorm1d(OBSERVATION, momentum=0.01, eps=1e-3)] if batch_norm else []
    mlp = MLP(OBSERVATION, 2 * ACTION, num_cells=list(HIDDEN), activation_class=nn.ReLU, **norm)
    return gaussian_policy(nn.Identity(), nn.Sequential(*first, mlp), spec())


def transitions() -> TensorDict:
    """Random transitions."""
    import torch
    from tensordict import TensorDict

    done = torch.zeros(STORED, 1, dtype=torch.bool)
    observation, following = (torch.rand(2, STORED, OBSERVATION) * 2 - 1).unbind()
    after = {
        "observation": following,
        "reward": observation.sum(-1, keepdim=True),
        "done": done,
        "terminated": done.clone(),
    }
    data = {
        "observation": observation,
        "action": torch.rand(STORED, ACTION) * 2 - 1,
        "next": TensorDict(after, [STORED]),
    }
    return TensorDict(data, [STORED])


def stored() -> TensorDictReplayBuffer:
    """TorchRL's replay buffer, full of random transitions."""
    from torchrl.data import LazyTensorStorage, TensorDictReplayBuffer

    buffer = TensorDictReplayBuffer(storage=LazyTensorStorage(STORED), batch_size=BATCH)
    buffer.extend(transitions())
    return buffer


def spec() -> Any:
    """Spec of the actions."""
    from torchrl.data import Bounded

    return Bounded(-1.0, 1.0, (ACTION,))


def sb3(agent: str) -> Update:
    """Stable-Baselines3's own agent."""
    import stable_baselines3
    import torch

    torch.set_num_threads(1)
    algorithm = {"sac": stable_baselines3.SAC, "td3": stable_baselines3.TD3}[agent]
    return _baseline(algorithm, {"device": "cpu"}, {"net_arch": list(HIDDEN)})


def sbx(agent: str) -> Update:
    """SBX's own agent, in JAX; DroQ is a setting of its SAC."""
    import sbx as jax_agents

    algorithm = {
        "sac": jax_agents.SAC,
        "droq": jax_agents.SAC,
        "td3": jax_agents.TD3,
        "crossq": jax_agents.CrossQ,
    }[agent]
    critic = {"dropout_rate": 0.01, "layer_norm": True} if agent == "droq" else {}
    options = {"policy_delay": UPDATES} if agent == "droq" else {}
    return _baseline(
        algorithm, options, {"net_arch": {"pi": list(HIDDEN), "qf": list(HIDDEN)}, **critic}
    )


def _baseline(algorithm: Any, options: dict[str, Any], policy: dict[str, Any]) -> Update:
    import gymnasium
    import numpy as np
    from gymnasium.spaces import Box
    from stable_baselines3.common.logger import configure

    class Still(gymnasium.Env[Any, Any]):
        """Spaces only; never stepped."""

        observation_space = Box(-1.0, 1.0, (OBSERVATION,), np.float32)
        action_space = Box(-1.0, 1.0, (ACTION,), np.float32)

    model = algorithm(
        "MlpPolicy",
        Still(),
        batch_size=BATCH,
        buffer_size=STORED,
        seed=0,
        policy_kwargs=policy,
        **options,
    )
    model.set_logger(configure(None, []))
    rng = np.random.default_rng(0)
    for _ in range(STORED):
        observation, next_observation = rng.uniform(-1, 1, (2, 1, OBSERVATION)).astype(np.float32)
        action = rng.uniform(-1, 1, (1, ACTION)).astype(np.float32)
        model.replay_buffer.add(
            observation, next_observation, action, observation.sum(-1), np.zeros(1), [{}]
        )
    return lambda: model.train(gradient_steps=UPDATES, batch_size=BATCH)


CONTESTANTS: dict[str, tuple[Callable[[str], Update], tuple[str, ...]]] = {
    "ours": (ours, ("sac", "td3", "droq", "redq", "crossq")),
    "ours_compiled": (ours_compiled, ("sac", "td3", "droq")),
    "torchrl_tuned": (torchrl_tuned, ("sac", "td3", "droq", "redq", "crossq")),
    "torchrl": (torchrl, ("sac", "td3", "droq", "redq", "crossq")),
    "sb3": (sb3, ("sac", "td3")),
    "sbx": (sbx, ("sac", "td3", "droq", "crossq")),
}
"""Functions by name, with their agents."""
