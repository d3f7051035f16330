"""Seeds of episodes: what the table in the module's docstring promises."""

from __future__ import annotations

import itertools

from brickhub.seed import LARGEST_SEED, derive_seed, episode_seed, evaluation_seed

RANGES = {
    "training": range(2**31),
    "selection": range(2**31, 3 * 2**30),
    "evaluation": range(3 * 2**30, 2**32),
}
SEEDS = (0, 1, 2, LARGEST_SEED)


def test_each_kind_of_episode_has_a_range_of_its_own() -> None:
    for kind, seeds in RANGES.items():
        drawn = [episode_seed(kind, seed, number) for seed in SEEDS for number in range(50)]
        assert all(seed in seeds for seed in drawn)
        assert len(set(drawn)) == len(drawn)
        # Half of them lie in each half of the range: nothing of it is left out.
        middle = (seeds.start + seeds.stop) // 2
        assert 70 < sum(seed < middle for seed in drawn) < 130
    assert all(seed <= LARGEST_SEED for seeds in RANGES.values() for seed in (seeds[0], seeds[-1]))


def test_what_was_tried_before_is_another_episode() -> None:
    for kind, seeds in RANGES.items():
        again = [episode_seed(kind, 3, 7, times) for times in range(5)]
        assert len(set(again)) == 5
        assert again[0] == episode_seed(kind, 3, 7)
        assert all(seed in seeds for seed in again)


def test_derived_seeds_depend_on_everything_and_are_the_same_again() -> None:
    given = itertools.product(SEEDS, ("a", "b"), (0, 1, 10))
    derived = {key: derive_seed(*key) for key in given}
    assert len(set(derived.values())) == len(derived)
    assert all(0 <= seed < 2**31 for seed in derived.values())
    assert derive_seed(0, "a") == derived[0, "a", 0]
    # Known to other processes and computers.
    assert derive_seed(7, "episode", 3) == 1984908172
    runs = {evaluation_seed(run, seed) for run in SEEDS for seed in SEEDS}
    assert len(runs) == len(SEEDS) ** 2
