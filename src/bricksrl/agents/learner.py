"""Learner: the one thing that an algorithm is, put together from parts of TorchRL's, and how they take an update."""

from __future__ import annotations

import math
from collections import defaultdict
from collections.abc import Callable, Iterable
from dataclasses import dataclass, field
from typing import Any

import torch
from tensordict import TensorDictBase
from tensordict.nn import TensorDictModuleBase
from torch import Tensor
from torchrl.data import ReplayBuffer
from torchrl.envs import EnvBase
from torchrl.envs.utils import ExplorationType, set_exploration_type
from torchrl.objectives import LossModule

from bricksrl.agents.replay import EpisodicReplayBuffer, filled_part, rows_of
from bricksrl.agents.settings import OffPolicySettings, Settings
from bricksrl.errors import CheckpointError

MOST_ROWS = 8192
"""Transitions that are drawn at once for several updates; more would only take memory."""
ACTOR_LOSSES = ("loss_actor", "loss_alpha")
"""Losses that are left out in updates without the actor."""


def adam(parameters: Iterable[Tensor], settings: Settings, weight_decay: float = 0.0) -> torch.optim.Optimizer:
    """Adam with decoupled weight decay over all that gets a gradient, as settings ask for."""
    learned = [parameter for parameter in parameters if parameter.requires_grad]
    rates: dict[str, Any] = {"lr": settings.learning_rate, "betas": (settings.adam_beta, 0.999), "fused": True}
    return torch.optim.AdamW(learned, weight_decay=weight_decay, **rates)


class Means:
    """Means of what learning tells, by name."""

    def __init__(self) -> None:
        self._values: defaultdict[str, list[Tensor]] = defaultdict(list)

    def add(self, told: dict[str, Tensor]) -> None:
        """Count what one update told, or the means of several."""
        for name, value in told.items():
            self._values[name].append(value)

    def means(self) -> dict[str, Tensor]:
        """Over what was counted."""
        return {name: torch.stack(values).mean() for name, values in self._values.items()}

    def numbers(self) -> dict[str, float]:
        """The means, off their device."""
        return {name: float(value) for name, value in self.means().items()}


@dataclass
class Learner:
    """An algorithm, ready to act and to learn.

    Attributes:
        policy: reads what the environment shows, writes "action" in -1..1; explores under ``ExplorationType.RANDOM``.
        loss: any `LossModule`; ``None`` where nothing is learned.
        optimizer: of the loss's parameters.
        memory: any replay buffer; its sampler decides what a batch is.
        target: its ``step`` moves target networks after an update, such as that of TorchRL's ``SoftUpdate``.
        prepare: applied to collected frames ``[*copies, time]`` before they are remembered, such as `GAE`.
        updates_per_step: updates for each step of the environment; with ``on_policy`` passes over what was collected.
        on_policy: what was collected is forgotten after the passes.
        frames_per_batch: steps that are collected between two times of learning; 1 beside a robot.
        prefill_episodes: episodes of uniform actions at the start.
        actor_delay: only every n-th update descends the actor's losses too.
        target_delay: the targets move in every n-th update.
        descend: losses that are added up and descended; ``None`` for all whose names begin with "loss".
        clip_norm: limit of the gradient's norm.
        imitates: it learns from a dataset and from nothing else.
        chunk: actions that it predicts at once, and that are an action of its dataset; 0 for single actions.
        reset_policy: called when what the policy sees next does not follow from its last action.
        gradients: computes losses and gradients of a batch in place of autograd; see `bricksrl.agents.compiled`.
    """

    policy: TensorDictModuleBase
    loss: LossModule | None = None
    optimizer: torch.optim.Optimizer | None = None
    memory: ReplayBuffer | None = None
    target: Any = None
    prepare: Callable[[TensorDictBase], TensorDictBase] = lambda frames: frames
    updates_per_step: float = 1.0
    on_policy: bool = False
    frames_per_batch: int = 1
    prefill_episodes: int = 0
    actor_delay: int = 1
    target_delay: int = 1
    descend: tuple[str, ...] | None = None
    clip_norm: float | None = None
    imitates: bool = False
    chunk: int = 0
    reset_policy: Callable[[], None] = lambda: None
    gradients: Callable[[TensorDictBase, bool], TensorDictBase] | None = None
    updates: int = field(default=0, init=False)
    dataset: ReplayBuffer | None = field(default=None, init=False)
    _due: float = field(default=0.0, init=False)

    @property
    def device(self) -> torch.device:
        """Where the networks are."""
        tensors = self.parameters() or [*self.policy.parameters(), *self.policy.buffers()]
        return tensors[0].device if tensors else torch.device("cpu")

    @property
    def loss_names(self) -> tuple[str, ...]:
        """Names of what `learn` tells, as far as the loss declares them."""
        return () if self.loss is None else tuple(name for name in self.loss.out_keys if isinstance(name, str))

    @property
    def sees_images(self) -> bool:
        """Whether the policy reads images."""
        return "image" in self.policy.in_keys

    def parameters(self) -> list[Tensor]:
        """All that the optimiser moves."""
        groups: list[dict[str, Any]] = [] if self.optimizer is None else self.optimizer.param_groups
        return [parameter for group in groups for parameter in group["params"]]

    def remember(self, frames: TensorDictBase, robot: int = 0) -> None:
        """Keep collected frames ``[time]`` or ``[copies, time]``; those of several robots may come in turn."""
        if self.memory is None or self.imitates:
            return
        frames = frames.to(self.device)
        lost = frames["next"].get("link_lost", None)
        frames = self.prepare(frames)
        if isinstance(self.memory, EpisodicReplayBuffer):
            self.memory.extend(frames, robot=robot)
            return
        frames = frames.reshape(-1) if lost is None else frames[~lost.squeeze(-1)]
        if len(frames):
            self.memory.extend(frames)

    def end_episodes(self, robot: int | None = None) -> None:
        """What is remembered next, of this robot or of any, does not follow from what was remembered last."""
        if isinstance(self.memory, EpisodicReplayBuffer):
            self.memory.end_episodes(robot)

    def learn(self, steps: int = 1) -> dict[str, Tensor]:
        """Make the updates that are due for so many steps of the environment; returns the mean of each value they tell."""
        if self.on_policy and self.memory is not None:
            size = self.memory.batch_size or len(self.memory)
            told = self.make_updates(int(self.updates_per_step * math.ceil(len(self.memory) / size)))
            self.memory.empty()
            return told
        self._due += self.updates_per_step * steps
        count = int(self._due)
        self._due -= count
        return self.make_updates(count)

    def make_updates(self, count: int) -> dict[str, Tensor]:
        """So many updates; returns the mean of each value that they tell, nothing where there is nothing to learn from."""
        if self.loss is None or not self._sources():
            return {}
        told = Means()
        for batch in self.batches(count):
            told.add(self.update(batch))
        return told.means()

    def batches(self, count: int) -> Iterable[TensorDictBase]:
        """So many batches: half of each from the dataset where there is one (RLPD, Ball et al., 2023)."""
        sources = self._sources()
        if not isinstance(sources[0], EpisodicReplayBuffer):
            for _ in range(count):
                yield sources[0].sample()
            return
        size = sources[0].batch_size
        shares = [size] if len(sources) == 1 else [size - size // 2, size // 2]
        at_once = max(1, MOST_ROWS // size)
        for start in range(0, count, at_once):
            n = min(at_once, count - start)
            parts = [source.sample(n * share).view(n, share) for source, share in zip(sources, shares, strict=True)]
            yield from (parts[0] if len(parts) == 1 else torch.cat(parts, 1)).unbind(0)

    def update(self, batch: TensorDictBase) -> dict[str, Tensor]:
        """One step down the losses on a batch; returns them, and what else the loss tells, without gradients."""
        if self.loss is None or self.optimizer is None:
            return {}
        self.updates += 1
        whole = self.updates % self.actor_delay == 0
        if self.gradients is not None:
            losses = self.gradients(batch, whole)
        else:
            only_critics = not whole and hasattr(self.loss, "critic_losses")
            losses = self.loss.critic_losses(batch) if only_critics else self.loss(batch.to(self.device))
            wanted = self.descend or tuple(name for name in losses.keys() if name.startswith("loss"))  # noqa: SIM118  a TensorDict
            skipped = () if whole else ACTOR_LOSSES
            torch.stack([losses[name].sum() for name in wanted if name in losses and name not in skipped]).sum().backward()
        if self.clip_norm is not None:
            torch.nn.utils.clip_grad_norm_(self.parameters(), self.clip_norm)
        self.optimizer.step()
        self.optimizer.zero_grad()
        if self.target is not None and self.updates % self.target_delay == 0:
            self.target.step()
        return {name: value.detach() for name, value in losses.items() if isinstance(name, str) and value.numel() == 1}

    def act(self, state: TensorDictBase, *, explore: bool) -> Tensor:
        """An action ``[*batch, m]`` for what an environment shows; without ``explore`` the policy's best one."""
        kind = ExplorationType.RANDOM if explore else ExplorationType.DETERMINISTIC
        with torch.no_grad(), set_exploration_type(kind):
            action: Tensor = self.policy(state.select(*self.policy.in_keys))["action"]
        return action

    def policy_state(self) -> dict[str, Tensor]:
        """All tensors that acting depends on, copied to the CPU."""
        return {name: tensor.detach().to("cpu", copy=True) for name, tensor in self.policy.state_dict().items()}

    def study(self, dataset: ReplayBuffer) -> None:
        """Draw half of each batch from this memory from now on, all of it as long as the own one is empty."""
        self.dataset = dataset

    def _sources(self) -> list[Any]:
        return [source for source in (self.memory, self.dataset) if source is not None and len(source)]

    def state_dict(self) -> dict[str, Any]:
        """All that learning changes: tensors, numbers, strings, and dictionaries and lists of them."""
        state: dict[str, Any] = {"policy": dict(self.policy.state_dict()), "updates": self.updates, "due": self._due}
        if self.loss is not None and self.optimizer is not None:
            state |= {"loss": dict(self.loss.state_dict()), "optimizer": self.optimizer.state_dict()}
        if self.memory is None or self.on_policy or not len(self.memory):
            return state
        episodic = isinstance(self.memory, EpisodicReplayBuffer)
        return {**state, "memory": self.memory.state_dict() if episodic else filled_part(self.memory)}

    def load_state_dict(self, state: dict[str, Any]) -> None:
        """Go on from `state_dict`, on any device; what it knew before is forgotten.

        Raises:
            CheckpointError: the state belongs to another algorithm, other networks or another memory.
        """
        try:
            self.policy.load_state_dict(state["policy"])
            self.updates, self._due = int(state["updates"]), float(state["due"])
            if self.loss is not None and self.optimizer is not None:
                self._load_loss(self.loss, state["loss"])
                self.optimizer.load_state_dict(state["optimizer"])
            if self.memory is not None:
                self.memory.empty()
                if "memory" in state:
                    self._load_memory(self.memory, state["memory"])
        except (AssertionError, AttributeError, LookupError, OverflowError, RuntimeError, TypeError, ValueError) as error:
            reason = (str(error) or type(error).__name__).splitlines()[0]
            raise CheckpointError(f"the checkpoint does not fit this agent ({reason}); resume with the settings it had") from None

    def _load_loss(self, loss: LossModule, state: dict[str, Any]) -> None:
        if any(name.startswith("anchor.") for name in state):
            from bricksrl.agents.policy_transfer import anchor

            anchor(self)
        for name in state.keys() - loss.state_dict().keys():
            if getattr(loss, name, state) is None:  # losses of TorchRL's make some buffers when they first need them
                delattr(loss, name)
                loss.register_buffer(name, state[name])
        loss.load_state_dict(state)

    def _load_memory(self, memory: ReplayBuffer, state: dict[str, Any]) -> None:
        if state["writer"].get("_cursor", 0) not in range(memory.storage.max_size):
            raise ValueError("its memory goes on where there is none")
        if isinstance(memory, EpisodicReplayBuffer):
            memory.load_state_dict(state)
        else:
            memory.extend(rows_of(state, self.device))
            memory.writer.load_state_dict(state["writer"])


def off_policy_learner(
    env: EnvBase,
    settings: OffPolicySettings,
    policy: TensorDictModuleBase,
    loss: LossModule,
    target: Any = None,
    **numbers: Any,
) -> Learner:
    """The learner of a policy and a loss, with the optimiser, the replay buffer and the numbers that settings ask for."""
    learned = list(loss.parameters())
    return Learner(
        policy,
        loss,
        adam(learned, settings),
        EpisodicReplayBuffer.of(env, settings, learned[0].device),
        target,
        updates_per_step=settings.updates_per_step,
        prefill_episodes=settings.prefill_episodes,
        actor_delay=settings.actor_delay,
        **numbers,
    )
