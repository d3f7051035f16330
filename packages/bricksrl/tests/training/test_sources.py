"""What one robot and copies report of their episodes."""

from __future__ import annotations

from types import SimpleNamespace
from typing import Any, cast

import pytest
import torch
from tensordict import TensorDict
from toys import Cart, LosingCart

from bricksrl.agents import make_learner
from bricksrl.envs import make
from bricksrl.errors import HubError, RunError
from bricksrl.training import Callback, Phase, sources
from bricksrl.training.sources import Copies, Ended, Moved, OneRobot, Playing, reconnect_of


def source(kind: Any, env: Any, **changes: Any) -> Any:
    actor = make_learner("random", Cart())
    learner = cast("Any", SimpleNamespace(actor=actor))
    signals = cast("Any", None)
    known = {"driver": None, "is_recorded": False, **changes}
    return kind(
        env=env,
        learner=learner,
        callback=Callback(),
        signals=signals,
        next_episode=lambda _: None,
        hub="virtual",
        patience_s=1.0,
        **known,
    )


def ahead(_observation: torch.Tensor) -> torch.Tensor:
    return torch.full((1,), 0.5)


def test_steps_of_one_robot_are_reported_and_its_episode() -> None:
    env = Cart(max_steps=3)
    robot = source(OneRobot, env, is_recorded=True, driver=ahead)
    playing = Playing(4, Phase.TRAIN, 7, "sac")
    *moved, ended = robot.play(playing, env.reset())
    assert [event.is_last for event in moved] == [False, False, True]
    assert all(isinstance(event, Moved) and event.own_frame is event.frame for event in moved)
    assert isinstance(ended, Ended) and ended.episode is not None and not ended.is_cut
    episode = ended.episode
    assert (episode.episode, episode.steps, episode.length) == (4, 3, 3)
    assert episode.return_ == pytest.approx(sum(step.reward for step in playing.steps))
    assert len(playing.steps) == 3 and playing.about is not None
    assert (playing.about.policy, playing.about.seed) == ("sac", 7)
    assert not robot.playing and not episode.link_lost


def test_measured_episode_has_to_be_complete_and_a_training_goes_on() -> None:
    def played(phase: Phase, at: int) -> Ended:
        env = LosingCart(at=at)
        for _ in range(2):
            env.reset()
        *_, ended = source(OneRobot, env, driver=ahead).play(
            Playing(1, phase, 0, "sac"), env.reset()
        )
        assert isinstance(ended, Ended)
        return ended

    for phase in (Phase.PREFILL, Phase.TRAIN):
        ended = played(phase, 3)
        assert ended.episode is not None and ended.episode.link_lost and ended.episode.length == 2
        assert played(phase, 1).episode is None, "there is nothing to keep"
    with pytest.raises(HubError, match="the hub did not answer"):
        played(Phase.OFFLINE, 3)
    whole = played(Phase.OFFLINE, 99)
    assert whole.episode is not None and not whole.episode.link_lost


def test_agent_that_learns_from_its_own_actions_refuses_a_hand() -> None:
    env = Cart()
    robot = source(OneRobot, env, driver=lambda _observation: torch.zeros(1))
    assert isinstance(next(robot.play(Playing(1, Phase.TRAIN, 0, "ppo"), env.reset())), Moved)
    robot.learner.actor.on_policy = True
    with pytest.raises(RunError, match="learns from its own actions only; let it drive"):
        next(robot.play(Playing(1, Phase.TRAIN, 0, "ppo"), env.reset()))


def frames(
    done: list[list[bool]], lost: list[list[bool]], returns: list[list[float]]
) -> TensorDict:
    """Frames ``[copies, time]`` with counters as the copies of a simulation have them."""
    batch = [len(done), len(done[0])]
    count = torch.arange(batch[1]).expand(batch)[..., None]
    after = {
        "done": torch.tensor(done)[..., None],
        "link_lost": torch.tensor(lost)[..., None],
        "episode_reward": torch.tensor(returns)[..., None],
        "step_count": count + 1,
    }
    return TensorDict({"step_count": count, "next": TensorDict(after, batch)}, batch)


@pytest.mark.parametrize(
    ("done", "lost", "length", "return_"),
    [
        ([[False, True], [True, False]], [[False] * 2] * 2, 2, 3.0),
        ([[False, True], [True, False]], [[False, True], [False] * 2], 1, 5.0),
        ([[False] * 2] * 2, [[False] * 2] * 2, 0, 0.0),
    ],
)
def test_round_of_copies_has_the_means_of_the_episodes_that_ended(
    monkeypatch: pytest.MonkeyPatch,
    done: list[list[bool]],
    lost: list[list[bool]],
    length: int,
    return_: float,
) -> None:
    batch = frames(done, lost, [[9.0, 1.0], [5.0, 9.0]])
    monkeypatch.setattr(sources, "collect_round", lambda *_: iter([batch, batch]))
    copies = source(Copies, make("WalkerSim-v0", batch_size=2))
    first, second, ended = copies.play(Playing(3, Phase.TRAIN, 0, "sac"), cast("Any", None))
    assert first.frame is batch and second.playing.length == 4
    assert ended.episode.length == length and ended.episode.return_ == return_
    assert (ended.episode.steps, ended.episode.episode, ended.episode.success) == (8, 3, None)


def test_only_a_single_robot_is_reconnected_from_here() -> None:
    losing = LosingCart(at=1)
    assert reconnect_of(losing) is losing.reconnect
    assert reconnect_of(Cart()) is None
    assert reconnect_of(make("WalkerSim-v0", batch_size=2)) is None
