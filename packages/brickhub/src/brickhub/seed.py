"""Seeds: the range that all random generators accept, and derived seeds.

A run has one seed, and everything that is drawn in it follows from that seed. Its episodes have
seeds of their own, in three ranges that have nothing in common, so that whatever seeds a user
chooses, no agent is judged on episodes that it learned from, nor by those that chose it among
others:

=============  ======================  ===========================================================================
kind           seeds of episodes       episodes
=============  ======================  ===========================================================================
training       below 2**31             of `bricksrl train`, `record` and `team`
selection      from 2**31 on           of evaluations that choose: the best checkpoint, an early stop, `bricksrl tune`
evaluation     from 3 * 2**30 on       of `bricksrl evaluate` and whatever is reported at the end
=============  ======================  ===========================================================================

An evaluation follows from the seed of the run and its own: runs with different seeds meet different
episodes, so that an interval over runs is one over episodes too; runs with the same seed meet the
same ones, so that two agents can be compared in pairs; and the same evaluation of the same run is
the same again.
"""  # noqa: E501

import hashlib
from typing import Literal

from brickhub.errors import DescriptionError

LARGEST_SEED = 2**32 - 1
"""NumPy's and Optuna's older generators accept no larger seed."""


def check_seed(seed: int | None) -> None:
    """Check a seed; ``None`` stands for a random one. Raises DescriptionError if it is invalid."""
    if seed is None:
        return
    # NumPy's whole numbers are welcome too.
    is_whole = hasattr(seed, "__index__")
    if not (is_whole and 0 <= seed <= LARGEST_SEED):
        raise DescriptionError(f"seed is {seed}; give a whole number from 0 to {LARGEST_SEED}")


def derive_seed(
    seed: int,
    purpose: str,
    index: int = 0,
) -> int:
    """A pseudo-random seed in 0..2**31-1 for each purpose and index."""
    # Python's `hash` differs from one process to the next, so it is not used.
    name = f"{seed}/{purpose}/{index}"
    digest = hashlib.sha256(name.encode()).digest()
    return int.from_bytes(digest[:4], "little") >> 1


EpisodeKind = Literal["training", "selection", "evaluation"]
_FIRST_SEED = {"training": 0, "selection": 2**31, "evaluation": 3 * 2**30}
_PURPOSE = {"training": "episode", "selection": "selection", "evaluation": "evaluation"}


def episode_seed(
    kind: EpisodeKind,
    seed: int,
    number: int,
    again: int = 0,
) -> int:
    """The seed of episode ``number`` of a run or an evaluation with a seed; ``again``: how often it
    was tried before."""
    derived = derive_seed(seed, _PURPOSE[kind], number)
    if again:
        derived = derive_seed(derived, "again", again)
    if kind == "training":
        return derived
    # Shifting leaves half as many seeds, so that this range ends where the next one begins.
    return _FIRST_SEED[kind] + (derived >> 1)


def evaluation_seed(run_seed: int, seed: int) -> int:
    """The seed of an evaluation with a seed of its own, of a run with another."""
    return derive_seed(run_seed, "evaluation of a run", seed)
