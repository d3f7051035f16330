"""Sources of the steps of a run: one robot, or copies of a simulation; `fleet.schedule` has several
robots.

A source yields each step that was made, and each episode that has ended; while it waits, the run
learns.
"""

import math
import time
import warnings
from abc import ABC, abstractmethod
from collections.abc import Callable, Iterator
from dataclasses import dataclass, field
from typing import Any

import torch
from tensordict import TensorDictBase
from torch import Tensor
from torchrl.envs import EnvBase
from torchrl.envs.utils import ExplorationType
from torchrl.modules import RandomPolicy

from bricksrl.data import About, Step
from bricksrl.data.collect import about, step_of
from bricksrl.envs.connection import Reconnect
from bricksrl.envs.env_interface import interface_of
from bricksrl.envs.rollout import Driver, Rollout, longest_of, play, seed_episode
from bricksrl.errors import RunError
from bricksrl.training.callbacks import Callback, Episode, Phase
from bricksrl.training.learner_side import LearnerSide
from bricksrl.training.signals import StopSignals


@dataclass
class Playing:
    """An episode that is being played.

    Attributes:
        number: in order of start; with the run's seed it determines the episode.
        seed: of the episode.
        policy: source of the actions, for the dataset.
        robot: place in the replay buffer.
        length: complete steps.
        metrics: of the updates made meanwhile.
        about, steps: for the dataset; ``None`` and empty without one.
    """

    number: int
    phase: Phase
    seed: int
    policy: str
    robot: int = 0
    length: int = 0
    return_: float = 0.0
    metrics: list[dict[str, Tensor]] = field(default_factory=list)
    about: About | None = None
    steps: list[Step] = field(default_factory=list)
    started_s: float = field(default_factory=time.perf_counter)


@dataclass(frozen=True)
class Moved:
    """A step of a robot, as ``EnvBase.step`` returns it, or a batch ``[copies, time]``; its outcome
    is void if the link broke. ``own_frame``: the last one that the environment itself made in it,
    without transforms."""

    playing: Playing
    frame: TensorDictBase
    own_frame: TensorDictBase
    is_lost: bool = False
    is_last: bool = False
    """Whether `Ended` follows at once."""


@dataclass(frozen=True)
class Ended:
    """The end of an episode; ``None`` if the link broke in its first step. ``is_cut``: by a
    pause."""

    playing: Playing
    episode: Episode | None
    is_cut: bool = False


NextEpisode = Callable[[int], Playing | None]
"""The next episode to play, if so many are being played; ``None`` if these are the last ones."""


@dataclass
class Source(ABC):
    """Source of a run's steps.

    Attributes:
        hub: address of the robot, for the dataset.
        patience_s: how long a lost robot is retried.
        is_recorded: whether steps go into the run's dataset.
        playing: the current episode of each robot.
    """

    env: EnvBase
    learner: LearnerSide
    callback: Callback
    signals: StopSignals
    driver: Driver | None
    next_episode: NextEpisode
    hub: str
    patience_s: float
    is_recorded: bool
    playing: dict[int, Playing] = field(default_factory=dict)

    _begun: tuple[Playing, TensorDictBase] | None = None

    def start(self) -> None:
        """Reach a robot and place it for its first episode. Raises HubError if there is none."""
        self._begun = self._begin()

    def events(self) -> Iterator[Moved | Ended | None]:
        """Events, episode by episode; ``None`` from time to time if nothing happens."""
        # The first episode may already have begun in `start`.
        begun = self._begun or self._begin()
        while begun is not None:
            self._begun = None
            yield from self.play(*begun)
            begun = self._begin()

    def _begin(self) -> tuple[Playing, TensorDictBase] | None:
        """The next episode, which depends on config, number and actions only, and the output of its
        reset."""
        playing = self.next_episode(0)
        if playing is None:
            return None
        reconnect = reconnect_of(self.env)
        if reconnect is not None:
            # This is set for each episode, because an evaluation before it leaves an `on_error` of
            # its own.
            reconnect.patience_s = self.patience_s
            reconnect.wait = self.signals.wait
            reconnect.on_error = lambda error: self.callback.on_link_lost(
                playing.number, playing.length, error
            )
        # A reset may wait for a hub or a person, and breaking it off loses nothing.
        with self.signals.at_once():
            seed_episode(self.env, playing.seed)
            state = self.env.reset()
        # The time of a reset does not count as the agent's, but that of updates from data made
        # before it does.
        if playing.phase is not Phase.OFFLINE:
            playing.started_s = time.perf_counter()
        return playing, state

    @abstractmethod
    def play(
        self,
        playing: Playing,
        start: TensorDictBase,
    ) -> Iterator[Moved | Ended]:
        """Play an episode from the output of its reset."""


class OneRobot(Source):
    """A robot of this process."""

    def play(
        self,
        playing: Playing,
        start: TensorDictBase,
    ) -> Iterator[Moved | Ended]:
        self.playing[0] = playing
        phase = playing.phase
        if self.is_recorded:
            playing.about = about(
                self.env,
                playing.policy,
                seed=playing.seed,
                hub=self.hub,
            )
        rollout = Rollout()
        actor = self.learner.actor
        policies = {
            Phase.PREFILL: RandomPolicy(self.env.action_spec),
            Phase.TRAIN: actor.explore,
            Phase.OFFLINE: actor.exploit,
        }
        frames = play(
            self.env,
            policies[phase],
            start,
            driver=self.driver,
            reset_policy=actor.reset_policy,
        )
        is_cut = False
        for frame in frames:
            # A transform that repeats an action gives several frames, and a link that broke in the
            # first one gives none.
            own_frames = rollout.add(frame, self.env)
            playing.length = len(rollout.rewards)
            is_by_hand = bool(frame.get("intervention", False))
            if is_by_hand and actor.on_policy:
                raise RunError(
                    "this agent learns from its own actions only; let it drive, or take an "
                    "off-policy one such as sac"
                )
            if self.is_recorded:
                playing.steps += [step_of(own_frame, self.env) for own_frame in own_frames]
            # This is read before an evaluation, which may follow the last step and has pauses of
            # its own.
            is_cut = interface_of(self.env).is_cut
            own_frame = own_frames[-1] if own_frames else frame
            is_last = bool(frame["next", "done"])
            yield Moved(
                playing,
                frame,
                own_frame,
                rollout.is_lost,
                is_last,
            )

        # A measurement has to be complete. It is not repeated, because its updates are made once.
        if rollout.is_lost and phase is Phase.OFFLINE:
            raise interface_of(self.env).link_error
        success, measures = rollout.judged(self.env)
        # The run adds its total of steps. An episode by itself has as many as it is long.
        episode = Episode(
            playing.number,
            phase,
            steps=playing.length,
            length=playing.length,
            return_=rollout.return_,
            success=success,
            measures=measures,
            link_lost=rollout.is_lost,
        )
        yield Ended(self.playing.pop(0), episode if playing.length else None, is_cut)


def reconnect_of(env: EnvBase) -> Reconnect | None:
    """Reconnection of a single robot; attributes of copies in processes cannot be set from here."""
    if env.batch_size:
        return None
    return interface_of(env).reconnect


class Copies(Source):
    """Copies of a simulation or of a virtual robot. An episode is a round: as many steps of all as
    one has at most."""

    def play(
        self,
        playing: Playing,
        start: TensorDictBase,
    ) -> Iterator[Moved | Ended]:
        # Sums over all copies stay on their device, because reading one at each batch would wait
        # for it.
        device = self.env.device
        episodes_ended = torch.zeros((), device=device)
        lengths = torch.zeros((), device=device)
        returns = torch.zeros((), device=device)
        steps = torch.zeros((), device=device)
        actor = self.learner.actor
        is_random = playing.phase is Phase.PREFILL
        policy = RandomPolicy(self.env.action_spec) if is_random else actor.acting
        batches = collect_round(
            self.env,
            policy,
            longest_of(self.env),
            actor.frames_per_batch,
        )
        for frames in batches:  # [copies, time]
            playing.length += frames.shape[-1]
            yield Moved(playing, frames, frames)
            after = frames["next"]
            # An episode that a lost link cut short says nothing about the agent.
            no_losses = torch.zeros_like(after["done"])
            lost = after.get("link_lost", no_losses)
            done = after["done"] & ~lost  # [copies, time, 1]
            episodes_ended += done.sum()
            returns += (after["episode_reward"] * done).sum()
            lengths += (after["step_count"] * done).sum()
            # The robots' own steps are counted: where actions are repeated, a frame is several of
            # them.
            steps += (after["step_count"] - frames["step_count"]).sum()
        # No episode may have ended in this round, for example because all links broke.
        count = max(1.0, float(episodes_ended))
        episode = Episode(
            playing.number,
            playing.phase,
            steps=int(steps),
            length=round(float(lengths) / count),
            return_=float(returns) / count,
            success=None,
        )
        yield Ended(playing, episode)


def collect_round(
    env: EnvBase,
    policy: Any,
    steps: int,
    steps_per_batch: int,
) -> Iterator[TensorDictBase]:
    """Frames ``[copies, steps_per_batch]``, at least ``steps`` per copy from a reset on; ended
    copies restart. ``policy``: a TensorDict module on the environment's device; it explores."""
    # TorchRL's own import raises these warnings.
    with warnings.catch_warnings(action="ignore", category=DeprecationWarning):
        from torchrl.collectors import Collector

    copies = env.batch_size.numel()
    batches = math.ceil(steps / steps_per_batch)
    frames_per_batch = steps_per_batch * copies
    # There is one collector for each round. It begins by resetting all copies, so that a run
    # resumes exactly.
    collector = Collector(
        env,
        policy,
        frames_per_batch=frames_per_batch,
        total_frames=batches * frames_per_batch,
        exploration_type=ExplorationType.RANDOM,
        auto_register_policy_transforms=False,
    )
    try:
        yield from collector
    finally:
        # A collector would close its environment by itself, which the next round needs.
        collector.shutdown(close_env=False)
