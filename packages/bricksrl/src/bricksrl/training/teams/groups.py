"""Team learning: MAPPO, IPPO and independent SAC for groups of a multi-agent environment.

MAPPO (Yu et al., 2022) has one critic for all observations of a group, IPPO (de Witt et al., 2020)
one for each robot's own; both use TorchRL's losses. Independent SAC learns from each robot's
transitions separately. A group shares its networks.
"""

import warnings
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass
from typing import Annotated, Any, Literal

import torch
from tensordict import TensorDict, TensorDictBase
from tensordict.nn import NormalParamExtractor, TensorDictModule, TensorDictSequential
from torch import Tensor, nn
from torchrl.data import Bounded, Composite, Unbounded
from torchrl.envs import EnvBase
from torchrl.modules import MultiAgentMLP, ProbabilisticActor, TanhNormal
from torchrl.objectives import IPPOLoss, MAPPOLoss

from brickhub.fields import Count, Range, check_fields, check_value
from bricksrl.agents.learner import Learner
from bricksrl.envs.specs import SpecsEnv
from bricksrl.errors import DescriptionError

TeamAgent = Literal["mappo", "ippo", "sac"]

_PPO_BATCH = 4096
_SAC_BATCH = 256


@dataclass(frozen=True)
class TeamSettings:
    """Settings of MAPPO, IPPO and independent SAC."""

    hidden: tuple[int, ...] = (64, 64)
    learning_rate: float = 1e-3
    gamma: float = 0.97
    gae_lambda: float = 0.95
    clip_epsilon: float = 0.2
    entropy_coeff: float = 0.003
    max_grad_norm: float = 0.5
    steps: Count = 32
    """Steps of each copy between updates."""
    passes: Count = 6
    """Of MAPPO and IPPO, as the four settings before ``steps``."""
    batch_size: Annotated[int | None, Range(1)] = None
    """Transitions of an update; by default 4096, for independent SAC 256."""
    updates_per_step: float = 1.0
    """Updates of independent SAC per step of all copies."""

    def __post_init__(self) -> None:
        check_fields(TeamSettings, vars(self))


class _Scaled(nn.Module):
    """Divides observations by their nominal bounds, then applies a network."""

    scale: Tensor

    def __init__(self, net: nn.Module, scale: Tensor) -> None:
        super().__init__()
        self.net = net
        self.register_buffer("scale", scale)

    def forward(self, observation: Tensor) -> Tensor:
        out: Tensor = self.net(observation / self.scale)
        return out


class PPOGroup:
    """A group that learns by MAPPO or IPPO.

    Args:
        scale: ``[n]``, divisor of observations.
        central: whether the critic sees all robots of the group.
    """

    def __init__(
        self,
        group: str,
        robots: int,
        scale: Tensor,
        size: int,
        settings: TeamSettings,
        *,
        central: bool,
    ) -> None:
        from torchrl.objectives.value import GAE

        self._group = group
        self._settings = settings
        n = len(scale)
        options: dict[str, Any] = {
            "n_agents": robots,
            "share_params": True,
            "activation_class": nn.Tanh,
            "num_cells": settings.hidden,
        }
        net = MultiAgentMLP(n, 2 * size, centralized=False, **options)
        body = nn.Sequential(_Scaled(net, scale), NormalParamExtractor(scale_lb=0.05))
        self.policy = ProbabilisticActor(
            TensorDictModule(body, [(group, "observation")], [(group, "loc"), (group, "scale")]),
            in_keys=[(group, "loc"), (group, "scale")],
            out_keys=[(group, "action")],
            distribution_class=TanhNormal,
            return_log_prob=True,
            log_prob_key=(group, "action_log_prob"),
        )
        value = _Scaled(MultiAgentMLP(n, 1, centralized=central, **options), scale)
        critic = TensorDictModule(value, [(group, "observation")], [(group, "state_value")])
        make = MAPPOLoss if central else IPPOLoss
        with warnings.catch_warnings(action="ignore"):
            self.loss = make(
                self.policy,
                critic,
                clip_epsilon=settings.clip_epsilon,
                entropy_coeff=settings.entropy_coeff,
                normalize_advantage=True,
            )
        keys = {
            name: (group, name)
            for name in ("action", "reward", "done", "terminated", "advantage", "value_target")
        }
        self.loss.set_keys(
            **keys, sample_log_prob=(group, "action_log_prob"), value=(group, "state_value")
        )
        self._advantage = GAE(gamma=settings.gamma, lmbda=settings.gae_lambda, value_network=critic)
        ends = {
            name: (group, name)
            for name in ("reward", "done", "terminated", "advantage", "value_target")
        }
        self._advantage.set_keys(**ends, value=(group, "state_value"))
        self._optimizer = torch.optim.Adam(self.loss.parameters(), lr=settings.learning_rate)

    def learn(self, frames: TensorDictBase) -> dict[str, Tensor]:
        group = self._group
        after = frames["next"]
        for name in ("done", "terminated"):  # robots share the episode's end
            ends = after[name].unsqueeze(-2).expand(after[group, "reward"].shape)
            after[group, name] = ends.clone()
            frames[group, name] = torch.zeros_like(ends)
        with torch.no_grad():
            frames = self._advantage(frames)
        rows = frames.reshape(-1)
        metrics: dict[str, list[Tensor]] = {}
        size = min(self._settings.batch_size or _PPO_BATCH, len(rows))
        for _ in range(self._settings.passes):
            for indices in torch.randperm(len(rows), device=rows.device).split(size):
                losses = self.loss(rows[indices])
                parts = [value for name, value in losses.items() if name.startswith("loss_")]
                torch.stack([value.sum() for value in parts]).sum().backward()
                torch.nn.utils.clip_grad_norm_(self.loss.parameters(), self._settings.max_grad_norm)
                self._optimizer.step()
                self._optimizer.zero_grad()
                for name, value in losses.items():
                    metrics.setdefault(name, []).append(value.detach().mean())
        return {name: torch.stack(values).mean() for name, values in metrics.items()}


class SACGroup:
    """A group of independent SAC learners with shared networks."""

    def __init__(
        self, group: str, robots: int, low: Tensor, high: Tensor, size: int, settings: TeamSettings
    ) -> None:
        from bricksrl.agents.sac import SACSettings, build

        flag = Unbounded((1,), dtype=torch.bool)
        specs = {
            "observation_spec": Composite(
                observation=Bounded(low, high, low.shape, dtype=torch.float32)
            ),
            "action_spec": Bounded(-1.0, 1.0, (size,)),
            "reward_spec": Unbounded((1,)),
            "done_spec": Composite(done=flag, terminated=flag.clone(), truncated=flag.clone()),
        }
        sac_settings = SACSettings(
            hidden=settings.hidden,
            gamma=settings.gamma,
            learning_rate=settings.learning_rate,
            updates_per_step=1.0,
            batch_size=settings.batch_size or _SAC_BATCH,
        )
        self._learner: Learner = build(SpecsEnv(specs, None), sac_settings)
        self._group = group
        self._robots = robots
        self._settings = settings
        self._due = 0.0
        self.policy = TensorDictModule(
            _RobotPolicy(self._learner.policy), [(group, "observation")], [(group, "action")]
        )

    def learn(self, frames: TensorDictBase) -> dict[str, Tensor]:
        group = self._group
        after = frames["next"]
        shape = frames.batch_size

        def per_robot(part: TensorDictBase, name: str) -> Tensor:
            """Robots as copies, ``[copies * robots, time, n]``."""
            value = (
                part[group, name] if (group, name) in part.keys(True) else part[name].unsqueeze(-2)
            )
            value = value.expand(*shape, self._robots, value.shape[-1])
            copies: Tensor = value.transpose(1, 2).reshape(-1, shape[1], value.shape[-1])
            return copies

        outcomes = {
            name: per_robot(after, name)
            for name in ("observation", "reward", "terminated", "done", "link_lost")
        }
        batch = [shape[0] * self._robots, shape[1]]
        current = {name: per_robot(frames, name) for name in ("observation", "action")}
        self._learner.remember(TensorDict({**current, "next": TensorDict(outcomes, batch)}, batch))
        self._due += self._settings.updates_per_step * shape[1]
        count = int(self._due)
        self._due = self._due % 1.0
        return self._learner.make_updates(count)


class _RobotPolicy(nn.Module):
    """Policy of one robot, observations to actions."""

    def __init__(self, policy: Any) -> None:
        super().__init__()
        self.policy = policy

    def forward(self, observation: Tensor) -> Tensor:
        out: Tensor = self.policy(TensorDict({"observation": observation}, observation.shape[:-1]))[
            "action"
        ]
        return out


GroupLearner = PPOGroup | SACGroup
"""A learning group. ``policy``: ``(group, "observation")`` to ``(group, "action")``; explores under
``ExplorationType.RANDOM``. ``learn``: from frames ``[copies, time]``; returns mean metrics."""


def alternating(scripts: Sequence[Callable[[Tensor], Tensor]]) -> Callable[[Tensor], Tensor]:
    """Script ``k`` modulo their number for copy ``k``; the first one for a single environment."""

    def act(observation: Tensor) -> Tensor:
        if observation.ndim < 3:
            return scripts[0](observation)
        copies = torch.arange(len(observation), device=observation.device)
        return torch.stack([script(observation) for script in scripts])[
            copies % len(scripts), copies
        ]

    return act


def make_group(env: EnvBase, group: str, agent: TeamAgent, settings: TeamSettings) -> GroupLearner:
    """The learner of a group. Initialized from torch's global generator. Raises DescriptionError if
    there is no such group or agent."""
    if group not in env.task.groups:
        raise DescriptionError(
            f"{env.task.id} has no group '{group}'; it has {', '.join(env.task.groups)}"
        )
    low, high = (
        torch.tensor([getattr(entry, end) for entry in env.task.entries]) for end in ("low", "high")
    )
    check_value("agent", agent, TeamAgent)
    robots = len(env.task.groups[group])
    size = 2
    if agent == "sac":
        return SACGroup(group, robots, low, high, size, settings)
    return PPOGroup(
        group,
        robots,
        torch.maximum(low.abs(), high.abs()),
        size,
        settings,
        central=agent == "mappo",
    )


def team_policy(
    env: EnvBase, learners: Mapping[str, GroupLearner], scripts: Mapping[str, str]
) -> TensorDictSequential:
    """Policy of all robots, by the groups' learners or scripts: a name, "random", or several
    separated by commas for the copies in turn. Raises DescriptionError if a group has neither, or
    there is no such script."""
    parts = []
    for group in env.task.groups:
        if group in learners:
            parts.append(learners[group].policy)
            continue
        script = alternating([env.task.script(name) for name in scripts.get(group, "").split(",")])
        parts.append(TensorDictModule(script, [(group, "observation")], [(group, "action")]))
    return TensorDictSequential(*parts)
