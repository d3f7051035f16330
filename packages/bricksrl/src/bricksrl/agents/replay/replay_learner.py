"""Learning from a replay buffer: each batch is drawn from all that was collected, and from a
dataset if there is one."""

import math
from collections.abc import Callable, Iterator
from dataclasses import dataclass, field
from typing import Any

from tensordict import TensorDictBase
from tensordict.nn import TensorDictModuleBase
from torchrl.data import ReplayBuffer
from torchrl.envs import EnvBase
from torchrl.objectives import LossModule

from bricksrl.agents.features.observed import reward_unit
from bricksrl.agents.gradient_descent import GradientDescent, GradientLearner, adam
from bricksrl.agents.replay.batches import batches_of
from bricksrl.agents.replay.buffer import TransitionReplayBuffer, make_replay_buffer
from bricksrl.agents.replay.memory_state import load_memory_state, memory_state
from bricksrl.agents.settings import CriticSettings, OffPolicySettings
from bricksrl.envs.rollout import cut_at_lost_links, lost_links, with_outcome


@dataclass
class ReplayLearner(GradientLearner):
    """A learner with a replay buffer.

    Attributes:
        memory: any replay buffer; its sampler defines a batch.
        updates_per_step: updates per environment step.
        prefill_episodes: initial episodes of uniform actions.
        scale_rewards: the rewards of the initial random episodes define the unit of those that are
            learned (`reward_unit`).
        begin: called with the stored transitions before the first update.
        dataset: provides half of each batch, all of it while the memory is empty (RLPD, Ball et
            al., 2023).
        due: fraction of an update that is left from the last steps.
    """

    uses_dataset = True

    memory: ReplayBuffer
    updates_per_step: float = 1.0
    prefill_episodes: int = 0
    scale_rewards: bool = False
    begin: Callable[[TensorDictBase], None] | None = None
    dataset: TransitionReplayBuffer | None = field(default=None, init=False)
    due: float = field(default=0.0, init=False)
    reward_unit: float = field(default=1.0, init=False)

    def remember(
        self,
        frames: TensorDictBase,
        robot: int = 0,
    ) -> None:
        frames = frames.to(self.device)
        self.see(frames)
        # Ours leaves out steps without an outcome, and needs them to see where links end.
        if isinstance(self.memory, TransitionReplayBuffer):
            self.memory.extend(frames, robot=robot)
            return
        rows = with_outcome(cut_at_lost_links(frames), lost_links(frames))
        if len(rows):
            self.memory.extend(rows)

    def use_dataset(self, frames: TensorDictBase) -> None:
        if not isinstance(self.memory, TransitionReplayBuffer):
            # A user's memory has batches of its own kind, which no other buffer can make.
            self.remember(frames)
            return
        self.see(frames)
        # Of the same kind as the memory, so that each batch can be half of both; a ring of one row
        # would have no next.
        self.dataset = self.memory.empty_like(max(2, len(frames)))
        self.dataset.extend(frames)

    def end_episodes(self, robot: int | None = None) -> None:
        if isinstance(self.memory, TransitionReplayBuffer):
            self.memory.end_episodes(robot)

    def learn(self, steps: int = 1) -> dict[str, Any]:
        # Before the first update, and never again: values of two units do not mix.
        if self.scale_rewards and not self.updates and len(self.memory):
            self.reward_unit = reward_unit(self.memory[:]["next", "reward"])
        # The fraction waits for the next step, as half an update a step is one in two steps.
        self.due, count = math.modf(self.due + self.updates_per_step * steps)
        return self.make_updates(int(count))

    def make_updates(self, count: int) -> dict[str, Any]:
        sources = self._sources()
        if self.begin is not None and sources and not self.updates:
            self.begin(self._in_units(sources[0][:]))
        return super().make_updates(count)

    def batches(self, count: int) -> Iterator[TensorDictBase]:
        first, *others = self._sources() or [None]
        if first is None:
            return
        if not isinstance(first, TransitionReplayBuffer):
            # What a batch is, its sampler says: one after the other.
            for _ in range(count):
                yield first.sample()
            return
        size = first.batch_size
        # Half from what was collected, half from the dataset (RLPD, Ball et al., 2023).
        half = size // 2 if others else 0
        shares = [(first, size - half)]
        if half:
            shares.append((others[0], half))
        for rows in batches_of(shares, count):
            yield from self._in_units(rows).unbind(0)

    def _sources(self) -> list[Any]:
        """What batches are drawn from: what was collected first, then the dataset."""
        sources = (self.memory, self.dataset)
        return [source for source in sources if source is not None and len(source)]

    def _in_units(self, rows: TensorDictBase) -> TensorDictBase:
        """Transitions ``[*batch]`` with rewards in the unit that they are learned in."""
        # Rows of a file are locked; a copy of the table alone shares its tensors.
        rows = rows.clone(False)
        rows["next", "reward"] = rows["next", "reward"] / self.reward_unit
        return rows

    def state_dict(self) -> dict[str, Any]:
        state = {**super().state_dict(), "due": self.due, "reward_unit": self.reward_unit}
        if len(self.memory):
            state["memory"] = memory_state(self.memory)
        return state

    def _load(self, state: dict[str, Any]) -> None:
        super()._load(state)
        self.due = float(state["due"])
        self.reward_unit = float(state["reward_unit"])
        self.memory.empty()
        if "memory" in state:
            load_memory_state(self.memory, state["memory"], self.device)


def off_policy_learner(
    env: EnvBase,
    settings: OffPolicySettings,
    policy: TensorDictModuleBase,
    loss: LossModule,
    target: Any = None,
    *,
    target_delay: int = 1,
    begin: Callable[[TensorDictBase], None] | None = None,
) -> ReplayLearner:
    """A learner with the optimiser and replay buffer of the settings. ``target``, ``target_delay``:
    of `GradientDescent`; ``begin``: of `ReplayLearner`."""
    learned = list(loss.parameters())
    descent = GradientDescent(
        loss,
        adam(learned, settings),
        target,
        actor_delay=settings.actor_delay,
        target_delay=target_delay,
        reset_every=settings.reset_every if isinstance(settings, CriticSettings) else 0,
    )
    return ReplayLearner(
        policy,
        descent,
        make_replay_buffer(env, settings, learned[0].device),
        updates_per_step=settings.updates_per_step,
        prefill_episodes=settings.prefill_episodes,
        scale_rewards=settings.scale_rewards,
        begin=begin,
    )
