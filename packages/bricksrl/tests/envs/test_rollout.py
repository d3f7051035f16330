"""Episodes: how one is played, and what is counted of it."""

from __future__ import annotations

from typing import Any

import pytest
import torch
from tensordict import TensorDict, TensorDictBase
from toys import Cart, LosingCart

from bricksrl.envs import make, rollout
from bricksrl.envs.rollout import (
    Rollout,
    cut_at_lost_links,
    longest_of,
    lost_links,
    play,
    play_episodes,
    with_outcome,
)
from bricksrl.envs.transforms import own_frames
from bricksrl.errors import HubError


def ahead(state: TensorDictBase) -> TensorDictBase:
    return state.set("action", torch.full((1,), 0.5))


def test_episode_is_played_to_its_end_and_says_who_acted() -> None:
    env, resets = Cart(max_steps=4), list[str]()
    by_hand = iter([None, torch.tensor([-0.25]), None, None])
    frames = list(
        play(
            env,
            ahead,
            driver=lambda _observation: next(by_hand),
            reset_policy=lambda: resets.append("reset"),
        )
    )
    assert [float(frame["action"]) for frame in frames] == [0.5, -0.25, 0.5, 0.5]
    assert [bool(frame["intervention"]) for frame in frames] == [False, True, False, False]
    assert resets == ["reset"] * 2, "at the start, and after what was not the policy's"
    assert env.resets == 1
    for before, after in zip(frames, frames[1:], strict=False):
        assert torch.equal(before["next", "observation"], after["observation"])
    alone = list(play(env, ahead))
    assert len(alone) == 4 and "intervention" not in alone[0]


def test_started_episode_is_not_reset_and_goes_on_while_it_is_to() -> None:
    env = Cart(max_steps=2)
    start, asked = env.reset(), iter([True, True, False])
    frames = list(play(env, ahead, start, goes_on=lambda: next(asked)))
    assert len(frames) == 4, "the first end is that of two steps, and each step after it is one"
    assert env.resets == 1


def test_repeated_action_is_by_hand_in_each_of_its_steps() -> None:
    env = make("WalkerSim-v0", seed=0, frame_skip=2)
    action = torch.zeros(4)
    frame = next(play(env, env.rand_action, driver=lambda _observation: action))
    steps = own_frames(env, frame)
    assert len(steps) == 2 and all(bool(step["intervention"]) for step in steps)
    plain = make("WalkerSim-v0", seed=0)
    frame = next(play(plain, plain.rand_action))
    assert own_frames(plain, frame) == [frame]


def test_rollout_counts_steps_until_the_link_breaks() -> None:
    env, collected = LosingCart(at=3), Rollout()
    assert (collected.action_size, collected.return_) == (0.0, 0.0)
    for _ in range(2):
        env.reset()
    frames = list(play(env, ahead))
    kept = [collected.add(frame, env) for frame in frames]
    assert [len(one) for one in kept] == [1, 1, 0] and collected.is_lost
    assert collected.action_sizes == [0.5, 0.5] and collected.action_size == 0.5
    assert collected.return_ == pytest.approx(sum(float(f["next", "reward"]) for f in frames[:2]))
    assert collected.judged(env) == (None, {})


def lost_frames(*lost: bool) -> TensorDict:
    """Frames ``[1, time]`` of which some have no outcome."""
    flags = torch.tensor(lost)[None, :, None]
    after = TensorDict({"link_lost": flags, "done": flags.clone()}, [1, len(lost)])
    return TensorDict({"step": torch.arange(len(lost))[None], "next": after}, [1, len(lost)])


def test_frames_before_a_lost_link_end_their_episode() -> None:
    frames = lost_frames(False, False, True, False)
    lost = lost_links(frames)
    assert lost is not None and lost.tolist() == [[False, False, True, False]]
    assert with_outcome(frames, lost)["step"].tolist() == [0, 1, 3]
    cut = cut_at_lost_links(frames)
    assert cut["next", "done"].flatten().tolist() == [False, True, True, False]
    assert not frames["next", "done"][0, 1], "what was given stays as it is"
    whole = lost_frames(False, False)
    assert cut_at_lost_links(whole) is whole
    without = whole.exclude(("next", "link_lost"))
    assert lost_links(without) is None
    assert with_outcome(without, None)["step"].tolist() == [0, 1]


def test_copies_play_as_many_episodes_as_are_asked_for() -> None:
    env = make("WalkerSim-v0", seed=0, batch_size=3)
    resets: list[Any] = []
    scores = list(play_episodes(env, env.rand_action, 5, 0, reset_policy=lambda: resets.append(1)))
    assert len(scores) == 5 and len(resets) == 2
    assert {score.length for score in scores} == {env.task.max_steps} == {longest_of(env)}
    assert all(0.3 < score.action_size < 0.7 for score in scores)
    assert all(score.success is not None and score.metrics for score in scores)
    assert len({score.return_ for score in scores}) == 5
    again = list(play_episodes(env, env.rand_action, 3, 0))
    assert len(again) == 3
    assert longest_of(Cart()) == 100, "where no task says it"


class CopiesThatWerePlayed:
    """Copies whose rounds are these frames, ``[copies, time]``; actions of the k-th step are
    ``k / 10``."""

    def __init__(self, *rounds: tuple[str, ...], counts: bool = False) -> None:
        self.rounds, self.counts = list(rounds), counts
        self.batch_size = torch.Size([len(rounds[0])])
        self.steps: list[int] = []

    def rollout(self, steps: int, _policy: Any, *, break_when_any_done: bool) -> TensorDict:
        """A letter a step: it goes on, ends, or the link is lost, which ends it too."""
        assert not break_when_any_done
        self.steps.append(steps)
        told = self.rounds.pop(0)
        copies, time = len(told), len(told[0])
        is_end = torch.tensor([[letter != "." for letter in one] for one in told])[..., None]
        is_lost = torch.tensor([[letter == "L" for letter in one] for one in told])[..., None]
        number = torch.arange(1.0, time + 1).expand(copies, time)[..., None]
        after = {"reward": number, "done": is_end, "link_lost": is_lost}
        if self.counts:
            after |= {"episode_reward": 100 * number, "step_count": (2 * number).int()}
        action = number.expand(copies, time, 2) / 10 * torch.tensor([1.0, -1.0])
        shape = [copies, time]
        return TensorDict({"action": action, "next": TensorDict(after, shape)}, shape)


@pytest.fixture
def seeds(monkeypatch: pytest.MonkeyPatch) -> list[int]:
    """Seeds of the rounds."""
    given: list[int] = []
    monkeypatch.setattr(rollout, "seed_episode", lambda _env, seed: given.append(seed))
    monkeypatch.setattr(rollout, "longest_of", lambda _env: 4)
    monkeypatch.setattr(rollout, "_judge_of_copies", lambda _env: None)
    return given


def scores(env: CopiesThatWerePlayed, episodes: int) -> list[tuple[float, int, float]]:
    played = rollout._play_copies(
        env,  # type: ignore[arg-type]
        lambda state: state,
        episodes,
        lambda number: 1000 + number,
        lambda: None,
    )
    return [(score.return_, score.length, score.action_size) for score in played]


def test_the_first_whole_episode_of_each_copy_counts(seeds: list[int]) -> None:
    env = CopiesThatWerePlayed((".E.E", "....", "..LE"), ("E...", "..E.", "...E"))
    size = pytest.approx
    assert scores(env, 4) == [
        (3.0, 2, size(0.15)),
        (10.0, 4, size(0.25)),
        (1.0, 1, size(0.1)),
        (6.0, 3, size(0.2)),
    ]
    assert seeds == [1001, 1004] and env.steps == [4, 4]


def test_counters_before_the_transforms_have_the_return_and_the_length(seeds: list[int]) -> None:
    env = CopiesThatWerePlayed((".E.E", "...."), counts=True)
    assert [(return_, length) for return_, length, _ in scores(env, 2)] == [(200.0, 4), (400.0, 8)]
    assert seeds == [1001]


def test_copies_that_are_all_lost_again_and_again_are_given_up(seeds: list[int]) -> None:
    lost = ("L...", ".L..")
    # A round in which one is whole begins the count anew.
    env = CopiesThatWerePlayed(*[lost] * 4, ("L...", "E..."), *[lost] * 5)
    with pytest.raises(HubError, match="the links to all 2 copies broke in 5 rounds"):
        scores(env, 9)
    assert not env.rounds and seeds[-1] == 1019
