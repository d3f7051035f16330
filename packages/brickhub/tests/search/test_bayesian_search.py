"""Policy search: what it asks for whatever it is told, and what it finds."""

from __future__ import annotations

import json
import math
import random
from collections.abc import Iterable, Sequence
from dataclasses import replace

import pytest
from described import REACHING, ROBO_ARM, RUN_AWAY, TWO_WHEELER, WALKER, WALKING

from brickhub.entry import Entry
from brickhub.errors import DescriptionError
from brickhub.search.bayesian_search import BayesianSearch, spread, structure_for, trial_score
from brickhub.search.feedback import Feedback
from brickhub.search.oscillators import Oscillators

ENTRIES = (Entry("speed", -1.0, 1.0), Entry("phase", 0.0, 360.0, "deg", wraps=True))
PAIRED = replace(WALKER, mirrored=(("left_front", "right_front"), ("left_back", "right_back")))


def hill(numbers: tuple[float, ...]) -> float:
    """Highest, 1, at a speed of -0.5 and a phase of 350 degrees, which is near 10 too."""
    speed, phase = numbers
    return math.cos(math.radians(phase - 350.0)) - (speed + 0.5) ** 2


def told(seed: int, count: int) -> BayesianSearch:
    """A search after trials of all kinds: noisy, lost, fallen, not finite, by hand."""
    rng = random.Random(seed)
    search = BayesianSearch(ENTRIES, seed=seed)
    for _ in range(count):
        score = hill(search.ask()) + 0.1 * rng.gauss(0.0, 1.0)
        kind = rng.random()
        if kind < 0.1:
            search.tell(rng.choice([None, math.nan, math.inf, -math.inf]))
        elif kind < 0.2:
            search.tell(score, has_failed=True)
        elif kind < 0.3:
            by_hand = (rng.uniform(-1.0, 1.0), rng.choice([0.0, 360.0]))
            search.tell(hill(by_hand), numbers=by_hand)
        elif kind < 0.32:
            search.begin_elsewhere()
        else:
            search.tell(score)
        for number, entry in zip(search.ask(), ENTRIES, strict=True):
            assert entry.low <= number <= entry.high
    return search


@pytest.mark.parametrize("seed", range(3))
def test_whatever_is_told_it_asks_within_the_ranges_and_goes_on_as_if_never_stopped(
    seed: int,
) -> None:
    search = told(seed, 14)
    assert told(seed, 14).state() == search.state()
    again = BayesianSearch(ENTRIES)
    again.load_state(json.loads(json.dumps(search.state())))
    for one in (search, again):
        for _ in range(3):
            one.tell(hill(one.ask()))
    assert again.state() == search.state()
    assert again.best == search.best


def test_thirty_noisy_trials_find_the_top() -> None:
    for seed in range(2):
        rng = random.Random(seed)
        search = BayesianSearch(ENTRIES, seed=seed)
        for _ in range(30):
            search.tell(hill(search.ask()) + 0.1 * rng.gauss(0.0, 1.0))
        assert hill(search.best) > 0.9
        assert len({trial.numbers for trial in search.trials}) == 30


def test_a_lost_trial_is_asked_for_again_and_counts_for_nothing() -> None:
    search = BayesianSearch(ENTRIES)
    search.tell(1.0)
    asked, state = search.ask(), search.state()
    for score in (None, math.nan, math.inf):
        search.tell(score)
        assert (search.ask(), search.state()) == (asked, state)


def test_a_fall_is_no_better_than_the_worst_trial() -> None:
    search = BayesianSearch(ENTRIES)
    for score, has_failed in ((0.5, False), (2.0, True), (-3.0, True)):
        search.tell(score, has_failed=has_failed)
    assert [trial.score for trial in search.trials] == [0.5, 0.5, -3.0]


def test_elsewhere_the_best_known_numbers_are_tried_first() -> None:
    search = BayesianSearch(ENTRIES)
    for numbers, score in (((0.0, 10.0), 1.0), ((-0.5, 350.0), 3.0), ((1.0, 90.0), 2.0)):
        search.tell(score, numbers=numbers)
    before = search.state()
    search.begin_elsewhere()
    assert search.ask() == search.best == (-0.5, 350.0)
    changed = {"world": before["world"] + 1, "start": [[-0.5, 350.0]], "asked": [-0.5, 350.0]}
    assert search.state() == {**before, **changed}
    search.tell(0.0)
    assert [trial.world for trial in search.trials] == [0, 0, 0, 1]


def test_what_a_person_tries_counts_and_is_within_the_ranges() -> None:
    search = BayesianSearch(ENTRIES)
    search.tell(5.0, numbers=(-0.5, 350.0))
    assert search.best == (-0.5, 350.0)
    for numbers, said in (
        ((2.0, 0.0), "'speed' is 2.0; give -1 to 1"),
        ((0.0, math.nan), "'phase' is nan"),
        ((0.0,), "1 numbers; give 2"),
    ):
        with pytest.raises(DescriptionError, match=said):
            search.tell(1.0, numbers=numbers)
    assert len(search.trials) == 1


def test_equal_scores_and_one_number_are_no_trouble() -> None:
    search = BayesianSearch([Entry("all", -1.0, 1.0)])
    for _ in range(20):
        search.tell(1.0)
    assert search.expected(search.best)[0] == pytest.approx(1.0)
    with pytest.raises(DescriptionError, match="there are no numbers to search"):
        BayesianSearch([])


@pytest.mark.parametrize("change", [{"scales": [0.0]}, {"numbers": [[9.0, 0.0]]}, {"seed": None}])
def test_a_state_of_something_else_is_refused(change: dict[str, object]) -> None:
    search = told(0, 6)
    kept = search.state()
    with pytest.raises(DescriptionError, match="this is no state of a search for these numbers"):
        search.load_state({**kept, **change})
    assert search.state() == kept


def test_first_trials_have_a_row_and_a_column_of_their_own() -> None:
    numbers = spread(ENTRIES, 8, random.Random(0))
    for entry, column in zip(ENTRIES, zip(*numbers, strict=True), strict=True):
        shares = [(number - entry.low) / (entry.high - entry.low) for number in column]
        assert sorted(int(8 * share) for share in shares) == list(range(8))


def test_a_score_counts_the_middle_of_what_is_left_once_the_robot_has_settled() -> None:
    assert trial_score([-9.0, -9.0, 1.0, 2.0, 4.0], settle_steps=2) == 2.25
    assert trial_score([3.0], settle_steps=2) == 3.0
    assert math.isnan(trial_score([]))


def test_legs_get_a_gait_and_everything_else_linear_feedback() -> None:
    walks = structure_for(PAIRED, WALKING)
    assert isinstance(walks, Oscillators)
    assert [entry.name for entry in walks.numbers] == ["speed", "left_back_phase"]
    drives, reaches = structure_for(TWO_WHEELER, RUN_AWAY), structure_for(ROBO_ARM, REACHING)
    assert isinstance(drives, Feedback) and isinstance(reaches, Feedback)
    # sine and cosine of both wheels, pitch, roll, distance, offset
    assert len(drives.numbers) == 8
    assert len(reaches.act([50.0, 40.0, -70.0, -90.0], [0.9] * len(reaches.numbers))) == 4


def test_legs_come_to_their_phases_whatever_their_start() -> None:
    structure = structure_for(PAIRED, WALKING)
    angles = [10.0, 200.0, 90.0, 300.0]
    for _ in range(30):
        actions = structure.act([*angles, 0.0, 0.0, 2000.0], (-0.2, 140.0))
        # each leg turns by -100 to 0 degrees
        pairs = zip(angles, actions, strict=True)
        angles = [(angle + 50.0 * (action - 1.0)) % 360.0 for angle, action in pairs]
    apart = [(angle - angles[0] + 1e-3) % 360.0 for angle in angles]
    assert apart == pytest.approx([0.0, 180.0, 140.0, 320.0], abs=0.1)


def test_first_trials_fill_the_ranges_before_anything_is_proposed() -> None:
    search = BayesianSearch(ENTRIES, seed=4)
    asked = []
    for _ in range(6):
        asked.append(search.ask())
        search.tell(hill(search.ask()))
    for entry, column in zip(ENTRIES, zip(*asked, strict=True), strict=True):
        shares = [(number - entry.low) / (entry.high - entry.low) for number in column]
        assert sorted(int(6 * share) for share in shares) == list(range(6))
    # What comes next is proposed: none of the first ones.
    assert search.ask() not in asked


def test_candidates_are_as_many_beside_the_best_as_anywhere() -> None:
    search = BayesianSearch(ENTRIES, seed=4)
    candidates = list(search.candidates((0.0, 350.0)))
    assert len(candidates) == 600
    beside, anywhere = candidates[:300], candidates[300:]
    speeds = [speed for speed, _ in beside]
    # A fifth of the range of 2: hardly anything is clamped.
    assert math.sqrt(sum(speed**2 for speed in speeds) / 300) == pytest.approx(0.4, abs=0.05)
    turns = [(phase - 350.0 + 180.0) % 360.0 - 180.0 for _, phase in beside]
    assert math.sqrt(sum(turn**2 for turn in turns) / 300) == pytest.approx(72.0, abs=9.0)
    # Beyond its end an angle begins anew.
    assert any(phase < 90.0 for _, phase in beside)
    for entry, column in zip(ENTRIES, zip(*anywhere, strict=True), strict=True):
        shares = sorted((number - entry.low) / (entry.high - entry.low) for number in column)
        evenly = [(place + 0.5) / 300 for place in range(300)]
        assert shares == pytest.approx(evenly, abs=0.1)
    assert candidates == list(search.candidates((0.0, 350.0)))
    search.tell(1.0)
    assert candidates != list(search.candidates((0.0, 350.0)))


def test_number_beside_an_end_stops_there() -> None:
    search = BayesianSearch(ENTRIES, seed=4)
    speeds = [speed for speed, _ in list(search.candidates((1.0, 0.0)))[:300]]
    assert max(speeds) == 1.0
    assert 100 < speeds.count(1.0) < 200


@pytest.mark.parametrize(
    ("gain", "deviation", "is_replaced"),
    [(0.29, 1.0, False), (0.3, 1.0, False), (0.31, 1.0, True), (0.61, 2.0, True)],
)
def test_best_numbers_are_replaced_by_what_is_better_beyond_a_doubt(
    gain: float, deviation: float, is_replaced: bool, monkeypatch: pytest.MonkeyPatch
) -> None:
    search = BayesianSearch(ENTRIES)
    search.tell(1.0, numbers=(0.0, 10.0))
    assert search.best == (0.0, 10.0)
    monkeypatch.setattr(search.process, "gain", lambda numbers, other: (gain, deviation))
    search.tell(9.0, numbers=(0.5, 200.0))
    assert search.best == ((0.5, 200.0) if is_replaced else (0.0, 10.0))


def test_proposals_are_optimistic_by_two_deviations(monkeypatch: pytest.MonkeyPatch) -> None:
    heard = []

    def first(candidates: Iterable[Sequence[float]], optimism: float) -> Sequence[float]:
        heard.append(optimism)
        return next(iter(candidates))

    for options in ({}, {"optimism": 0.5}):
        search = BayesianSearch(ENTRIES, random_trials=1, **options)
        monkeypatch.setattr(search.process, "most_promising", first)
        search.tell(1.0)
    assert heard == [2.0, 0.5]


def test_in_another_world_only_its_own_trials_are_likely() -> None:
    search = BayesianSearch(ENTRIES)
    search.tell(5.0, numbers=(0.2, 100.0))
    search.begin_elsewhere()
    search.begin_elsewhere()
    assert search.world == 2
    search.tell(-1.0, numbers=(-0.7, 300.0))
    assert search.trials[-1].world == 2
    # What was best elsewhere may be so here, too, and one trial does not say otherwise.
    assert search.best in ((0.2, 100.0), (-0.7, 300.0))
    # The best known was the only one to begin with; now something is proposed.
    assert search.ask() != (0.2, 100.0)


def test_a_first_fall_has_no_worse_trial() -> None:
    search = BayesianSearch(ENTRIES)
    search.tell(0.7, has_failed=True)
    assert [trial.score for trial in search.trials] == [0.7]


@pytest.mark.parametrize(
    ("rewards", "settle_steps", "score"),
    [
        ([5.0], 0, 5.0),
        ([1.0, 3.0], 0, 2.0),
        ([0.0, 0.0, 4.0, 0.0], 0, 8.0 / 6.0),
        ([9.0, 1.0, 3.0], 1, 2.0),
        # What ended while it settled has these rewards only.
        ([1.0, 3.0], 2, 2.0),
        ([1.0, 3.0], 5, 2.0),
    ],
)
def test_score_by_bartletts_window(rewards: list[float], settle_steps: int, score: float) -> None:
    assert trial_score(rewards, settle_steps) == pytest.approx(score)


@pytest.mark.parametrize(
    "name", ["numbers", "scores", "worlds", "world", "start", "asked", "best", "scales", "fitted"]
)
def test_state_that_lacks_something_is_refused(name: str) -> None:
    search = told(0, 6)
    kept = search.state()
    cut = {key: value for key, value in kept.items() if key != name}
    with pytest.raises(DescriptionError, match=f"{name}.*begin a new one"):
        search.load_state(cut)
    assert search.state() == kept


@pytest.mark.parametrize(
    "change",
    [
        {"start": [[0.0, 400.0]]},
        {"asked": [2.0, 0.0]},
        {"best": [0.0]},
        {"scores": [1.0]},
        {"worlds": []},
        {"world": "home"},
        {"fitted": None},
    ],
)
def test_state_that_does_not_suit_itself_is_refused(change: dict[str, object]) -> None:
    search = told(0, 6)
    with pytest.raises(DescriptionError, match="this is no state of a search for these numbers"):
        search.load_state({**search.state(), **change})
