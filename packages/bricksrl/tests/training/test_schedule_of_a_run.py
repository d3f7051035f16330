"""Which episodes a run plays, and when it is over, without playing them."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path
from typing import Any

import pytest
import torch
from tensordict import TensorDict

from brickhub.seed import episode_seed
from bricksrl.data import About
from bricksrl.errors import DescriptionError
from bricksrl.training import Callback, Episode, Phase, TrainConfig
from bricksrl.training.learner_side import LearningPace
from bricksrl.training.loop import STRIDE, Loop
from bricksrl.training.signals import InterruptedEpisodeError
from bricksrl.training.sources import Ended, Moved, Playing

ONE = Episode(1, Phase.TRAIN, steps=10, length=10, return_=2.0, success=True)


class Noting:
    """Stands for what a run tells, and notes it."""

    def __init__(self, log: list[Any], **known: Any) -> None:
        self.log = log
        vars(self).update(known)

    def __getattr__(self, name: str) -> Any:
        return lambda *given, **_named: self.log.append((name, *given))


def loop_of(config: TrainConfig, log: list[Any] | None = None) -> Any:
    """A run that has played nothing yet."""
    log = [] if log is None else log
    loop: Any = Loop.__new__(Loop)
    loop.config, loop.prefill_episodes, loop.episodes = config, 2, []
    loop._started, loop._numbers_again, loop._last_end_s = 0, [], 0.0
    loop.recorded, loop.best, loop.is_evaluation_due = 0, None, False
    loop.callback, loop._recorder = Callback(), None
    loop.actor = Noting(log, updates_per_step=2.0)
    loop.learner = Noting(log, actor=loop.actor, pace=LearningPace(10, 5))
    loop.signals = Noting(log, requested=False, held_back=torch.no_grad)
    loop.folder = Noting(log, checkpoint_path=Path("checkpoint"))
    loop._state = dict
    return loop


def test_first_episodes_are_random_and_seeds_follow_the_number() -> None:
    config = TrainConfig("RunAway-v0", episodes=4, seed=7)
    loop = loop_of(config)
    played = [loop._next_episode(0) for _ in range(4)]
    assert [one.number for one in played] == [1, 2, 3, 4]
    assert [one.phase for one in played] == [Phase.PREFILL] * 2 + [Phase.TRAIN] * 2
    assert [one.policy for one in played] == ["random"] * 2 + ["sac"] * 2
    assert [one.seed for one in played] == [episode_seed("training", 7, n) for n in range(1, 5)]
    loop.episodes = [ONE]
    assert loop._next_episode(2) is not None
    assert loop._next_episode(3) is None, "those being played are the last ones"
    loop.episodes = [ONE] * 4
    assert loop._next_episode(0) is None


def test_updates_from_data_are_shared_out_exactly() -> None:
    log: list[Any] = []
    config = TrainConfig("RunAway-v0", "bc", episodes=3, updates=100, data="somewhere")
    loop = loop_of(config, log)
    assert [loop._updates_before(number) for number in (1, 2, 3)] == [33, 33, 34]
    playing = loop._next_episode(0)
    assert playing.phase is Phase.OFFLINE
    assert log == [("make_updates", STRIDE), ("make_updates", 33 - STRIDE)]
    assert len(playing.metrics) == 2
    loop.signals.requested = True
    with pytest.raises(InterruptedEpisodeError):
        loop._next_episode(0)
    assert len(log) == 3, "a stop waits for one stride"


def ended(returns: list[float], **changes: Any) -> list[Episode]:
    return [replace(ONE, return_=return_, **changes) for return_ in returns]


def test_run_is_over_after_its_episodes_or_at_its_return() -> None:
    loop = loop_of(TrainConfig("RunAway-v0", episodes=8))
    loop.episodes = ended([9.0] * 7)
    assert not loop._is_over()
    loop.episodes = ended([0.0] * 8)
    assert loop._is_over()
    loop = loop_of(TrainConfig("RunAway-v0", episodes=9, stop_at=3.0))
    assert not loop._is_over()
    for returns, is_over in (
        ([3.0] * 4, False),
        ([3.0] * 5, True),
        ([-9.0, 1.0, 5.0, 3.0, 3.0, 3.0], True),
        ([9.0, 2.9, 3.0, 3.0, 3.0, 3.0], False),
    ):
        loop.episodes = ended(returns)
        assert loop._is_over() is is_over, returns
    # Neither random episodes nor those that a lost link has cut short say how good the agent is.
    loop.episodes = ended([9.0], phase=Phase.PREFILL) + ended([3.0] * 4)
    assert not loop._is_over()
    loop.episodes = ended([3.0] * 4) + ended([9.0], link_lost=True)
    assert not loop._is_over()
    loop.episodes += ended([3.0])
    assert loop._is_over()


def test_evaluations_decide_where_there_are_any() -> None:
    loop = loop_of(TrainConfig("RunAway-v0", episodes=9, stop_at=3.0, eval_every=1))
    for evaluation, is_over in ((None, False), (2.9, False), (3.0, True)):
        loop.episodes = [*ended([9.0] * 5), replace(ONE, evaluation=evaluation)]
        assert loop._is_over() is is_over


def test_episode_counts_with_the_steps_and_time_before_it() -> None:
    log: list[Any] = []
    loop = loop_of(TrainConfig("RunAway-v0", episodes=9, eval_every=2), log)
    loop.episodes = [replace(ONE, seconds=100.0)]
    playing = Playing(5, Phase.TRAIN, 0, "sac")
    playing.metrics += [{"loss": torch.tensor(1.0)}, {"loss": torch.tensor(3.0)}]
    loop._keep(playing, replace(ONE, episode=5, steps=4, length=4, measures={"error": 0.5}))
    (_, kept) = loop.episodes
    assert (kept.episode, kept.steps, kept.length) == (2, 14, 4)
    assert kept.measures == {"error": 0.5, "loss": 2.0}
    assert kept.updates_per_step == 1.0, "half of the updates are made so far"
    assert 100.0 <= kept.seconds < 101.0 and loop.is_evaluation_due
    assert [name for name, *_ in log] == ["append", "save"]
    loop._keep(playing, replace(ONE, measures={}))
    assert not loop.is_evaluation_due, "each second one is evaluated"
    loop._keep(playing, replace(ONE, link_lost=True))
    assert not loop.is_evaluation_due, "the robot may not be back yet"
    with pytest.raises(DescriptionError, match=r"have the name 'loss', as a metric of the task"):
        loop._keep(playing, replace(ONE, measures={"loss": 1.0}))


class Recorder:
    """Notes what is recorded."""

    def __init__(self) -> None:
        self.rows: list[tuple[Any, About]] = []
        self.whole = 3

    def write(self, steps: Any, about: About) -> None:
        self.rows.append((steps, about))


def test_episode_is_recorded_as_it_ended() -> None:
    log: list[Any] = []
    loop = loop_of(TrainConfig("RunAway-v0", episodes=9), log)
    loop._recorder = Recorder()
    loop._keep = loop._report = lambda *_: None
    playing = Playing(1, Phase.TRAIN, 0, "sac", robot=4, about=About(policy="sac"))
    for episode, is_cut, success, is_whole in (
        (ONE, False, True, True),
        (replace(ONE, link_lost=True), False, True, False),
        (ONE, True, None, False),
    ):
        loop._ended(Ended(playing, episode, is_cut))
        _, about = loop._recorder.rows[-1]
        assert (about.policy, about.success, about.whole) == ("sac", success, is_whole)
    assert loop.recorded == 3 and log == [("end_episodes", 4)] * 3
    with pytest.raises(DescriptionError, match="the return of episode 1 is nan: a reward of"):
        loop._ended(Ended(playing, replace(ONE, return_=float("nan"))))
    playing.about = None
    loop._ended(Ended(playing, ONE))
    assert len(loop._recorder.rows) == 3, "what never began is not recorded"


def test_only_complete_steps_of_training_are_learned_from() -> None:
    log: list[Any] = []
    loop = loop_of(TrainConfig("RunAway-v0", episodes=9), log)
    loop.callback = Noting(log)
    step, batch = TensorDict({}, []), TensorDict({}, [3, 5])

    def moved(phase: Phase, frame: TensorDict, *, is_lost: bool = False) -> list[str]:
        log.clear()
        playing = Playing(1, phase, 0, "sac", robot=2, length=1)
        loop._moved(Moved(playing, frame, frame, is_lost))
        return [name for name, *_ in log]

    assert moved(Phase.OFFLINE, step) == []
    assert moved(Phase.PREFILL, step) == ["on_transition", "remember", "on_step"]
    assert moved(Phase.TRAIN, step) == ["on_transition", "remember", "learn", "on_step"]
    assert ("learn", 1) in log
    assert moved(Phase.TRAIN, step, is_lost=True) == ["remember", "on_step"]
    assert moved(Phase.TRAIN, batch) == ["remember", "learn", "on_step"]
    assert ("learn", 5) in log
