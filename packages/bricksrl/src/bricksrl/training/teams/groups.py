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
"""Transitions of an update of MAPPO and IPPO, unless the settings say other."""
_SAC_BATCH = 256
"""Batch size of independent SAC."""
_LEAST_SCALE = 0.05
"""Least scale of MAPPO's and IPPO's actions, so that no group stops exploring."""


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

    def __init__(
        self,
        net: nn.Module,
        scale: Tensor,
    ) -> None:
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
        # All robots of a group share one network, so that each learns from what the others meet.
        options: dict[str, Any] = {
            "n_agents": robots,
            "share_params": True,
            "activation_class": nn.Tanh,
            "num_cells": settings.hidden,
        }

        # The policy sees what the robot itself observes, even where the critic sees everything.
        action_net = MultiAgentMLP(
            n,
            2 * size,
            centralized=False,
            **options,
        )
        body = nn.Sequential(
            _Scaled(action_net, scale), NormalParamExtractor(scale_lb=_LEAST_SCALE)
        )
        observation_key = (group, "observation")
        distribution_keys = [(group, "loc"), (group, "scale")]
        self.policy = ProbabilisticActor(
            TensorDictModule(body, [observation_key], distribution_keys),
            in_keys=distribution_keys,
            out_keys=[(group, "action")],
            distribution_class=TanhNormal,
            return_log_prob=True,
            log_prob_key=(group, "action_log_prob"),
        )
        value_net = MultiAgentMLP(
            n,
            1,
            centralized=central,
            **options,
        )
        value_key = (group, "state_value")
        critic = TensorDictModule(_Scaled(value_net, scale), [observation_key], [value_key])

        make = MAPPOLoss if central else IPPOLoss
        with warnings.catch_warnings(action="ignore"):
            self.loss = make(
                self.policy,
                critic,
                clip_epsilon=settings.clip_epsilon,
                entropy_coeff=settings.entropy_coeff,
                normalize_advantage=True,
            )
        # Loss and advantage look for these names at the root, but a team has them in its groups.
        names = ("reward", "done", "terminated", "advantage", "value_target")
        keys = {name: (group, name) for name in names}
        self.loss.set_keys(
            **keys,
            action=(group, "action"),
            sample_log_prob=(group, "action_log_prob"),
            value=value_key,
        )
        self._advantage = GAE(
            gamma=settings.gamma,
            lmbda=settings.gae_lambda,
            value_network=critic,
        )
        self._advantage.set_keys(**keys, value=value_key)
        self._optimizer = torch.optim.Adam(self.loss.parameters(), lr=settings.learning_rate)

    def learn(self, frames: TensorDictBase) -> dict[str, Tensor]:
        group = self._group
        after = frames["next"]
        # Robots share the end of the episode, and the loss wants it for each of them.
        shape = after[group, "reward"].shape  # [copies, time, robots, 1]
        for name in ("done", "terminated"):
            ends = after[name].unsqueeze(-2).expand(shape)
            after[group, name] = ends.clone()
            frames[group, name] = torch.zeros_like(ends)

        # This comes before the rows are shuffled, because an advantage is a sum over time.
        with torch.no_grad():
            frames = self._advantage(frames)
        rows = frames.reshape(-1)
        size = min(self._settings.batch_size or _PPO_BATCH, len(rows))
        metrics: dict[str, list[Tensor]] = {}
        for _ in range(self._settings.passes):
            order = torch.randperm(len(rows), device=rows.device)
            for indices in order.split(size):
                losses = self.loss(rows[indices])
                self._descend(losses)
                for name, value in losses.items():
                    metrics.setdefault(name, []).append(value.detach().mean())
        return {name: torch.stack(values).mean() for name, values in metrics.items()}

    def _descend(self, losses: TensorDictBase) -> None:
        """One gradient step."""
        # The other entries, such as the entropy, are only reported.
        minimised = [value.sum() for name, value in losses.items() if name.startswith("loss_")]
        torch.stack(minimised).sum().backward()
        torch.nn.utils.clip_grad_norm_(self.loss.parameters(), self._settings.max_grad_norm)
        self._optimizer.step()
        self._optimizer.zero_grad()


class SACGroup:
    """A group of independent SAC learners with shared networks."""

    def __init__(
        self,
        group: str,
        robots: int,
        low: Tensor,
        high: Tensor,
        size: int,
        settings: TeamSettings,
    ) -> None:
        from bricksrl.agents.sac import SACSettings, build

        # To the algorithm, each robot is an environment of its own.
        observation = Bounded(
            low,
            high,
            low.shape,
            dtype=torch.float32,
        )
        flag = Unbounded((1,), dtype=torch.bool)
        specs = {
            "observation_spec": Composite(observation=observation),
            "action_spec": Bounded(-1.0, 1.0, (size,)),
            "reward_spec": Unbounded((1,)),
            "done_spec": Composite(
                done=flag,
                terminated=flag.clone(),
                truncated=flag.clone(),
            ),
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
        # This fraction of an update is left from the last steps.
        self._updates_due = 0.0
        policy = _RobotPolicy(self._learner.policy)
        self.policy = TensorDictModule(policy, [(group, "observation")], [(group, "action")])

    def learn(self, frames: TensorDictBase) -> dict[str, Tensor]:
        self._learner.remember(self._as_copies(frames))
        steps = frames.batch_size[1]
        self._updates_due += self._settings.updates_per_step * steps
        count = int(self._updates_due)
        self._updates_due = self._updates_due % 1.0
        return self._learner.make_updates(count)

    def _as_copies(self, frames: TensorDictBase) -> TensorDict:
        """Frames ``[copies, time]`` with each robot as a copy, ``[copies * robots, time]``."""
        group = self._group
        copies, time = frames.batch_size

        def per_robot(part: TensorDictBase, name: str) -> Tensor:
            if (group, name) in part.keys(True):
                value = part[group, name]  # [copies, time, robots, n]
            else:
                # Entries of the whole arena, such as the end of the episode, are repeated for each
                # robot.
                value = part[name].unsqueeze(-2)
            n = value.shape[-1]
            of_all = value.expand(copies, time, self._robots, n)
            # The steps of each robot stay in the order of time, as the memory reads them.
            in_time: Tensor = of_all.transpose(1, 2).reshape(-1, time, n)
            return in_time

        batch = [copies * self._robots, time]
        current = {name: per_robot(frames, name) for name in ("observation", "action")}
        outcome = {
            name: per_robot(frames["next"], name)
            for name in ("observation", "reward", "terminated", "done", "link_lost")
        }
        return TensorDict({**current, "next": TensorDict(outcome, batch)}, batch)


class _RobotPolicy(nn.Module):
    """Policy of one robot, observations to actions."""

    def __init__(self, policy: Any) -> None:
        super().__init__()
        self.policy = policy

    def forward(self, observation: Tensor) -> Tensor:
        state = TensorDict({"observation": observation}, observation.shape[:-1])
        action: Tensor = self.policy(state)["action"]
        return action


GroupLearner = PPOGroup | SACGroup
"""A learning group. ``policy``: ``(group, "observation")`` to ``(group, "action")``; explores under
``ExplorationType.RANDOM``. ``learn``: from frames ``[copies, time]``; returns mean metrics."""


def alternating(scripts: Sequence[Callable[[Tensor], Tensor]]) -> Callable[[Tensor], Tensor]:
    """Script ``k`` modulo their number for copy ``k``; the first one for a single environment."""

    def act(observation: Tensor) -> Tensor:
        # A single environment gives [robots, n], without the dimension of copies.
        if observation.ndim < 3:
            return scripts[0](observation)
        copies = torch.arange(len(observation), device=observation.device)
        # All scripts act in all copies, because they are batched functions: [scripts, copies,
        # robots, m].
        actions = torch.stack([script(observation) for script in scripts])
        return actions[copies % len(scripts), copies]

    return act


def make_group(
    env: EnvBase,
    group: str,
    agent: TeamAgent,
    settings: TeamSettings,
) -> GroupLearner:
    """The learner of a group. Initialized from torch's global generator. Raises DescriptionError if
    there is no such group or agent."""
    if group not in env.task.groups:
        raise DescriptionError(
            f"{env.task.id} has no group '{group}'; it has {', '.join(env.task.groups)}"
        )
    check_value("agent", agent, TeamAgent)
    low = torch.tensor([entry.low for entry in env.task.entries])
    high = torch.tensor([entry.high for entry in env.task.entries])
    robots = len(env.task.groups[group])
    size = env.task.action_size
    if agent == "sac":
        return SACGroup(
            group,
            robots,
            low,
            high,
            size,
            settings,
        )
    scale = torch.maximum(low.abs(), high.abs())
    return PPOGroup(
        group,
        robots,
        scale,
        size,
        settings,
        central=agent == "mappo",
    )


def team_policy(
    env: EnvBase,
    learners: Mapping[str, GroupLearner],
    scripts: Mapping[str, str],
) -> TensorDictSequential:
    """Policy of all robots, by the groups' learners or scripts: a name, "random", or several
    separated by commas for the copies in turn. Raises DescriptionError if a group has neither, or
    there is no such script."""
    parts = []
    for group in env.task.groups:
        if group in learners:
            parts.append(learners[group].policy)
            continue
        # An empty text means no script, so a group that is named nowhere has none.
        names = scripts.get(group, "").split(",")
        script = alternating([env.task.script(name) for name in names])
        parts.append(TensorDictModule(script, [(group, "observation")], [(group, "action")]))
    return TensorDictSequential(*parts)
