"""Episodes and progress, as callbacks are told of them."""

from __future__ import annotations

from dataclasses import replace
from typing import Any

import pytest

from bricksrl.training import Callback, Episode, Phase, Progress
from bricksrl.training.callbacks import CallbackList

ONE = Episode(1, Phase.TRAIN, steps=10, length=10, return_=2.0, success=True, seconds=4.0)


def run(count: int) -> list[Episode]:
    """Episodes of 10 steps, of which the first took 4 s and each other one 2 s."""
    return [
        replace(ONE, episode=number, steps=10 * number, seconds=2.0 + 2.0 * number)
        for number in range(1, count + 1)
    ]


@pytest.mark.parametrize(
    ("count", "steps_per_s", "remaining_s"),
    [
        (1, 10 / 4, 9 * 4.0),
        (5, 50 / 12, 5 * 12 / 5),
        # From the sixth on the last five count alone.
        (6, 5.0, 4 * 2.0),
        (10, 5.0, 0.0),
    ],
)
def test_progress_is_that_of_the_last_episodes(
    count: int, steps_per_s: float, remaining_s: float
) -> None:
    progress = Progress.of(run(count), 10)
    assert progress.episodes_total == 10
    assert progress.steps_per_s == pytest.approx(steps_per_s)
    assert progress.remaining_s == pytest.approx(remaining_s)


def test_progress_of_no_time_is_a_number() -> None:
    progress = Progress.of([replace(ONE, seconds=0.0)], 2)
    assert progress.steps_per_s == pytest.approx(1e10) and progress.remaining_s < 1e-6


def test_episode_is_restored_from_plain_values() -> None:
    whole = replace(
        ONE,
        measures={"error": 1.0},
        link_lost=True,
        updates_per_step=2.0,
        evaluation=3.0,
        robot="a",
    )
    for episode in (ONE, whole):
        plain = episode.to_dict()
        assert plain["phase"] == "train" and type(plain["phase"]) is str
        assert Episode.from_dict(plain) == episode
    assert ONE.measures == {} and not ONE.link_lost and ONE.evaluation is None


def test_several_callbacks_are_told_everything_in_their_order() -> None:
    told: list[tuple[str, str, tuple[object, ...]]] = []

    class Noting(Callback):
        def __init__(self, name: str) -> None:
            self.name = name

        def __getattribute__(self, event: str) -> Any:
            if not event.startswith("on_"):
                return super().__getattribute__(event)
            name = super().__getattribute__("name")
            return lambda *content: told.append((name, event, content))

    events = [event for event in vars(Callback) if event.startswith("on_")]
    assert len(events) > 8
    both = CallbackList(Noting("first"), Noting("second"))
    for number, event in enumerate(events):
        getattr(both, event)(number, "content")
    assert told == [
        (name, event, (number, "content"))
        for number, event in enumerate(events)
        for name in ("first", "second")
    ]
