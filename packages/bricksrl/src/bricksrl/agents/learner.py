"""Learner: an algorithm assembled from TorchRL's parts, and its update."""

import copy
import math
from collections import deque
from collections.abc import Callable, Iterable
from dataclasses import dataclass, field
from typing import Any

import torch
from tensordict import TensorDict, TensorDictBase
from tensordict.nn import TensorDictModuleBase
from torch import Tensor, nn
from torchrl.data import ReplayBuffer
from torchrl.envs import EnvBase
from torchrl.envs.utils import ExplorationType, set_exploration_type
from torchrl.objectives import LossModule

from bricksrl.agents.encoder import Encoder
from bricksrl.agents.features import reward_unit
from bricksrl.agents.replay.buffer import TransitionReplayBuffer, make_replay_buffer
from bricksrl.agents.settings import CriticSettings, OffPolicySettings, Settings
from bricksrl.envs.rollout import cut_at_lost_links, lost_links, with_outcome
from bricksrl.errors import CheckpointError, message_of

MAX_ROWS = 8192
"""Maximum number of transitions drawn at once for several updates."""
ACTOR_LOSSES = ("loss_actor", "loss_alpha")
"""Losses omitted in updates without the actor."""


def adam(
    parameters: Iterable[Tensor],
    settings: Settings,
    weight_decay: float = 0.0,
) -> torch.optim.Optimizer:
    """Adam with decoupled weight decay over all parameters with gradients."""
    learned = [parameter for parameter in parameters if parameter.requires_grad]
    betas = (settings.adam_beta, 0.999)
    return torch.optim.AdamW(
        learned,
        lr=settings.learning_rate,
        betas=betas,
        weight_decay=weight_decay,
        fused=True,
    )


def means(metrics: Iterable[dict[str, Tensor]]) -> dict[str, Tensor]:
    """Mean of each metric over the updates that report it."""
    updates = list(metrics)
    # An actor's losses are not in each update, where it learns less often than its critics.
    values: dict[str, list[Tensor]] = {}
    for update in updates:
        for name, value in update.items():
            values.setdefault(name, []).append(value)
    return {name: torch.stack(of_name).mean() for name, of_name in values.items()}


@dataclass
class Learner:
    """An algorithm that acts and learns.

    Attributes:
        policy: reads the observation, writes "action" in -1..1; explores under
            ``ExplorationType.RANDOM``; may have ``reset``. Kept as a copy that shares its tensors
            and acts without dropout.
        loss: any `LossModule`; ``None`` if nothing is learned.
        optimizer: of the loss's parameters.
        memory: any replay buffer; its sampler defines a batch.
        target: its ``step`` moves target networks after an update, as TorchRL's ``SoftUpdate``.
        prepare: applied to collected frames ``[*copies, time]`` before they are stored, such as
            `GAE`.
        updates_per_step: updates per environment step; with ``on_policy`` passes over the frames.
        on_policy: frames are discarded after the passes.
        frames_per_batch: steps collected between updates; 1 for a robot.
        prefill_episodes: initial episodes of uniform actions.
        actor_delay: every n-th update includes the actor's losses.
        target_delay: every n-th update moves the targets.
        reset_every: updates after which networks, targets and optimiser start anew; 0 for never.
        descend: losses to minimise; ``None`` for all names that begin with "loss".
        scale_rewards: the rewards of the initial random episodes define the unit of those that are
            learned (`reward_unit`).
        clip_norm: limit of the gradient's norm.
        imitates: learns from a dataset only.
        chunk: length of predicted action chunks; 0 for single actions.
        begin: called with the stored transitions before the first update.
        gradients: replaces autograd; see `bricksrl.agents.compiled`.
        dataset: provides half of each batch, all of it while the memory is empty (RLPD, Ball et
            al., 2023).
        base: frozen policy that the learned one's actions are added to.
        weights: newest weights of a policy trained elsewhere, for the next action; may be set from
            any thread.
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
    reset_every: int = 0
    descend: tuple[str, ...] | None = None
    scale_rewards: bool = False
    clip_norm: float | None = None
    imitates: bool = False
    chunk: int = 0
    begin: Callable[[TensorDictBase], None] | None = None
    gradients: Callable[[TensorDictBase, bool], TensorDictBase] | None = None
    updates: int = field(default=0, init=False)
    dataset: ReplayBuffer | None = field(default=None, init=False)
    base: nn.Module | None = field(default=None, init=False)
    weights: deque[dict[str, Tensor]] = field(default_factory=lambda: deque(maxlen=1), init=False)
    due: float = field(default=0.0, init=False)
    reward_unit: float = field(default=1.0, init=False)
    _copy: TensorDictModuleBase | None = field(default=None, init=False)

    def __post_init__(self) -> None:
        # Without dropout and by running statistics, while the loss trains the original: a memo of
        # what is not to be copied makes the two share their tensors.
        tensors = [*self.policy.parameters(), *self.policy.buffers()]
        shared = {id(tensor): tensor for tensor in tensors}
        self.policy = copy.deepcopy(self.policy, shared).eval()

    @property
    def device(self) -> torch.device:
        """Device of the networks."""
        # A policy that learns nothing, such as a random one, may still have tensors.
        tensors = self.parameters() or [*self.policy.parameters(), *self.policy.buffers()]
        return tensors[0].device if tensors else torch.device("cpu")

    def parameters(self) -> list[Tensor]:
        """Parameters of the optimiser."""
        if self.optimizer is None:
            return []
        groups = self.optimizer.param_groups
        return [parameter for group in groups for parameter in group["params"]]

    def act_on(self, device: torch.device | str | None) -> None:
        """Act on an environment's device (``None`` is the CPU), with a copy of the policy if the
        networks are on another."""
        if torch.device(device or "cpu").type != self.device.type:
            self._copy = copy.deepcopy(self.policy).to(device or "cpu")

    @property
    def acting(self) -> TensorDictModuleBase:
        """The acting policy."""
        return self.policy if self._copy is None else self._copy

    def reset_policy(self) -> None:
        """Discard the acting policy's state, if any: the next observation does not follow from its
        last action."""
        if hasattr(self.acting, "reset"):
            self.acting.reset()

    def explore(self, tensordict: TensorDictBase) -> TensorDictBase:
        """Write an exploratory "action"; the argument's name marks a policy for TorchRL."""
        return self._act(tensordict, ExplorationType.RANDOM)

    def exploit(self, tensordict: TensorDictBase) -> TensorDictBase:
        """Write the best "action"."""
        return self._act(tensordict, ExplorationType.DETERMINISTIC)

    def _act(
        self,
        tensordict: TensorDictBase,
        exploration: ExplorationType,
    ) -> TensorDictBase:
        # Between two actions, so that no action is of half new weights.
        if self.weights:
            self.acting.load_state_dict(self.weights.pop())
        with torch.no_grad(), set_exploration_type(exploration):
            acted: TensorDictBase = self.acting(tensordict)
        return acted

    def remember(
        self,
        frames: TensorDictBase,
        robot: int = 0,
    ) -> None:
        """Store frames ``[time]`` or ``[copies, time]``; robots may alternate."""
        if self.memory is None or self.imitates:
            return
        frames = frames.to(self.device)
        self.see(frames)
        # Ours leaves out steps without an outcome, and needs them to see where links end.
        if isinstance(self.memory, TransitionReplayBuffer):
            self.memory.extend(self.prepare(frames), robot=robot)
            return
        # An estimate over time, such as GAE, must not reach across a lost link.
        prepared = self.prepare(cut_at_lost_links(frames))
        rows = with_outcome(prepared, lost_links(frames))
        if len(rows):
            self.memory.extend(rows)

    def see(self, frames: TensorDictBase) -> None:
        """Note the range of the observations in frames that are learned on: what is acted on is
        held within it."""
        frozen = set() if self.base is None else set(self.base.modules())
        for module in self.policy.modules():
            if isinstance(module, Encoder) and module not in frozen:
                module.see(frames)
                module.see(frames["next"])

    def end_episodes(self, robot: int | None = None) -> None:
        """End the current episode of a robot, or of all: the next frame does not follow from the
        last."""
        if isinstance(self.memory, TransitionReplayBuffer):
            self.memory.end_episodes(robot)

    def begin_elsewhere(self) -> None:
        """Go on with another robot, or in another world."""
        self.end_episodes()

    def learn(self, steps: int = 1) -> dict[str, Tensor]:
        """Make the updates due for ``steps`` environment steps. Returns mean metrics."""
        if self.on_policy and self.memory is not None:
            size = self.memory.batch_size or len(self.memory)
            batches_a_pass = math.ceil(len(self.memory) / size)
            metrics = self.make_updates(int(self.updates_per_step * batches_a_pass))
            # What was collected by the policy before these updates is not learned from again
            self.memory.empty()
            return metrics
        # Before the first update, and never again: values of two units do not mix.
        is_first = not self.updates and self.memory is not None and len(self.memory)
        if self.scale_rewards and is_first and self.memory is not None:
            self.reward_unit = reward_unit(self.memory[:]["next", "reward"])
        # The fraction waits for the next step, as half an update a step is one in two steps.
        self.due, count = math.modf(self.due + self.updates_per_step * steps)
        return self.make_updates(int(count))

    def make_updates(self, count: int) -> dict[str, Tensor]:
        """Make ``count`` updates. Returns mean metrics, empty without data."""
        sources = self._sources()
        if self.loss is None or not sources:
            return {}
        if self.begin is not None and not self.updates:
            self.begin(self.in_units(sources[0][:]))
        metrics = means(map(self.update, self.batches(count)))
        # The copy on the environment's device acts next.
        if self._copy is not None:
            self._copy.load_state_dict(self.policy.state_dict())
        return metrics

    def batches(self, count: int) -> Iterable[TensorDictBase]:
        """``count`` batches; several are drawn at once, which is faster."""
        sources = self._sources()
        if not isinstance(sources[0], TransitionReplayBuffer):
            # What a batch is, its sampler says: one after the other.
            for _ in range(count):
                yield sources[0].sample()
            return
        size = sources[0].batch_size
        # Half from what was collected, half from the dataset (RLPD, Ball et al., 2023).
        half = size // 2 if len(sources) > 1 else 0
        sizes = (size - half, half)
        shares = [(source, share) for source, share in zip(sources, sizes, strict=False) if share]
        at_once = max(1, MAX_ROWS // size)
        for start in range(0, count, at_once):
            n = min(at_once, count - start)
            parts = []
            for source, share in shares:
                drawn = source.sample(n * share, batches=n)
                parts.append(drawn.view(n, share))
            rows = parts[0] if len(parts) == 1 else torch.cat(parts, 1)  # [n, size]
            yield from self.in_units(rows).unbind(0)

    def in_units(self, rows: TensorDictBase) -> TensorDictBase:
        """Transitions ``[*batch]`` with rewards in the unit that they are learned in."""
        # Rows of a file are locked; a copy of the table alone shares its tensors.
        rows = rows.clone(False)
        rows["next", "reward"] = rows["next", "reward"] / self.reward_unit
        return rows

    def update(self, batch: TensorDictBase) -> dict[str, Tensor]:
        """One gradient step on a batch. Returns detached losses and metrics."""
        if self.loss is None or self.optimizer is None:
            return {}
        self.updates += 1
        with_actor = self.updates % self.actor_delay == 0
        if self.gradients is not None:
            losses = self.gradients(batch, with_actor)
        else:
            # Ours can leave the actor's losses out; TorchRL's compute all, and some are dropped.
            if not with_actor and hasattr(self.loss, "critic_losses"):
                losses = self.loss.critic_losses(batch)
            else:
                losses = self.loss(batch.to(self.device))
            names = self.descend
            if not names:
                # By keys: a TensorDict itself is iterated over by rows.
                names = tuple(name for name in losses.keys() if name.startswith("loss"))  # noqa: SIM118
            skipped = () if with_actor else ACTOR_LOSSES
            minimised = [
                losses[name].sum() for name in names if name in losses and name not in skipped
            ]
            torch.stack(minimised).sum().backward()
        if self.clip_norm is not None:
            torch.nn.utils.clip_grad_norm_(self.parameters(), self.clip_norm)
        self.optimizer.step()
        self.optimizer.zero_grad()
        if self.target is not None and self.updates % self.target_delay == 0:
            self.target.step()
        if self.reset_every and self.updates % self.reset_every == 0:
            self._restart()
        return {
            name: value.detach()
            for name, value in losses.items()
            if isinstance(name, str) and value.numel() == 1
        }

    def _restart(self) -> None:
        """Draw the weights of all layers anew that are learned; what is frozen, such as a base, an
        anchor or a part of a user's network, and what was measured, such as ranges and the
        temperature, stays."""
        learned = {id(tensor) for tensor in self.parameters() if tensor.requires_grad}
        modules = [] if self.loss is None else self.loss.modules()
        for module in modules:
            is_learned = any(id(tensor) in learned for tensor in module.parameters(recurse=False))
            if not is_learned or not hasattr(module, "reset_parameters"):
                continue
            # `reset_parameters` draws all of a layer's tensors, also one that is frozen.
            frozen = [
                (tensor, tensor.detach().clone())
                for tensor in module.parameters()
                if id(tensor) not in learned
            ]
            module.reset_parameters()
            with torch.no_grad():
                for tensor, before in frozen:
                    tensor.copy_(before)
        # Targets begin as their networks do, and Adam's moments are of weights that are gone.
        if self.target is not None:
            self.target.init_()
        if self.optimizer is not None:
            self.optimizer.state.clear()

    def policy_state(self) -> dict[str, Tensor]:
        """Copy of the policy's tensors on the CPU."""
        return {
            name: tensor.detach().to("cpu", copy=True)
            for name, tensor in self.policy.state_dict().items()
        }

    def _sources(self) -> list[Any]:
        """What batches are drawn from: what was collected first, then the dataset."""
        sources = (self.memory, self.dataset)
        return [source for source in sources if source is not None and len(source)]

    def state_dict(self) -> dict[str, Any]:
        """Everything that learning changes: nested tensors, numbers, strings, lists."""
        state: dict[str, Any] = {
            "updates": self.updates,
            "due": self.due,
            "reward_unit": self.reward_unit,
            "policy": dict(self.policy.state_dict()),
        }
        if self.loss is not None and self.optimizer is not None:
            state["loss"] = dict(self.loss.state_dict())
            state["optimizer"] = self.optimizer.state_dict()
        # On-policy it is empty between two steps of the run.
        if self.memory is not None and not self.on_policy and len(self.memory):
            state["memory"] = memory_state(self.memory)
        return state

    def load_state_dict(self, state: dict[str, Any]) -> None:
        """Restore `state_dict`, on any device. Raises CheckpointError if the state is of another
        algorithm, network or buffer."""
        try:
            self.policy.load_state_dict(state["policy"])
            self.updates = int(state["updates"])
            self.due = float(state["due"])
            self.reward_unit = float(state["reward_unit"])
            if self.loss is not None and self.optimizer is not None:
                load_loss(self.loss, state["loss"])
                load_optimizer(self.optimizer, state["optimizer"])
            if self.memory is not None:
                self.memory.empty()
                if "memory" in state:
                    load_memory_state(self.memory, state["memory"], self.device)
        # A state of another network may have any value where torch expects one of its own, and
        # torch promises no list of errors.
        except Exception as error:  # noqa: BLE001
            reason = message_of(error, typed=True)
            raise CheckpointError(
                f"the checkpoint does not fit this agent ({reason}); resume with the settings it "
                "had"
            ) from None


def load_loss(loss: LossModule, state: dict[str, Any]) -> None:
    """Restore a loss's ``state_dict``. Raises RuntimeError if it is of another loss."""
    # TorchRL's losses create their estimator, and some buffers, when they are first used: a state
    # does not load into what is not there yet.
    if any(name.startswith("_value_estimator.") for name in state):
        _ = loss.value_estimator
    for name in state.keys() - loss.state_dict().keys():
        if getattr(loss, name, state) is None:
            delattr(loss, name)
            loss.register_buffer(name, state[name])
    loss.load_state_dict(state)


def load_optimizer(optimizer: torch.optim.Optimizer, state: dict[str, Any]) -> None:
    """Restore an optimiser's ``state_dict``. Raises KeyError, TypeError or ValueError if it is of
    another one."""
    kinds = [_kinds(group) for group in optimizer.param_groups]
    # It takes whatever it is given, and the first update would fail on it.
    optimizer.load_state_dict(state)
    if [_kinds(group) for group in optimizer.param_groups] != kinds:
        raise TypeError("its options are of other types")
    # What another optimiser of a user keeps is not known.
    if not isinstance(optimizer, torch.optim.Adam):
        return
    for parameter, kept in optimizer.state.items():
        shapes = [kept[name].shape for name in ("exp_avg", "exp_avg_sq")]
        if shapes != [parameter.shape] * 2 or kept["step"].ndim:
            raise ValueError("its moments are of other shapes")


def _kinds(group: dict[str, Any]) -> dict[str, type]:
    """Types of an optimiser's options; all numbers are of one, as a schedule makes floats of
    whole ones."""
    is_number = {name: type(value) in (int, float) for name, value in group.items()}
    return {name: float if is_number[name] else type(value) for name, value in group.items()}


def memory_state(memory: ReplayBuffer) -> dict[str, Any]:
    """The filled part of a replay buffer and its write position, independent of the device."""
    size = len(memory)
    rows: dict[str, Any] = {}
    # TorchRL's own state has the whole capacity, of which a run fills little.
    if size:
        rows = dict(memory[range(size)].flatten_keys(".").items())
    state: dict[str, Any] = {"rows": rows, "writer": dict(memory.writer.state_dict())}
    # Which row follows which: the steps of several robots alternate.
    if isinstance(memory, TransitionReplayBuffer):
        state |= memory.links()
    return state


def load_memory_state(
    memory: ReplayBuffer,
    state: dict[str, Any],
    device: torch.device | str = "cpu",
) -> None:
    """Restore `memory_state`. Raises ValueError, KeyError or RuntimeError if the state is of
    another buffer."""
    rows = dict(state["rows"])
    capacity = memory.storage.max_size
    # All columns have as many rows as the first; a state without columns is that of an empty one.
    first_column = next(iter(rows.values()), ())
    size = len(first_column)
    position = state["writer"].get("_cursor", 0)
    if size > capacity or position not in range(capacity):
        raise ValueError(f"{size} transitions do not fit into a buffer of {capacity}")
    memory.empty()
    is_ours = isinstance(memory, TransitionReplayBuffer)
    if size:
        transitions = TensorDict(rows, [size], device=device).unflatten_keys(".")
        # Of no robot: which row follows which is in the state.
        options = {"robot": None} if is_ours else {}
        memory.extend(transitions, **options)
    # After the rows, whose writing moves it.
    memory.writer.load_state_dict(state["writer"])
    if is_ours:
        memory.load_links(state)


def off_policy_learner(
    env: EnvBase,
    settings: OffPolicySettings,
    policy: TensorDictModuleBase,
    loss: LossModule,
    target: Any = None,
    **options: Any,
) -> Learner:
    """A learner with the optimiser and replay buffer of the settings."""
    learned = list(loss.parameters())
    memory = make_replay_buffer(env, settings, learned[0].device)
    # Settings whose names are those of the learner's fields.
    for name in ("updates_per_step", "prefill_episodes", "actor_delay", "scale_rewards"):
        options[name] = getattr(settings, name)
    options["reset_every"] = settings.reset_every if isinstance(settings, CriticSettings) else 0
    return Learner(
        policy,
        loss,
        adam(learned, settings),
        memory,
        target,
        **options,
    )
