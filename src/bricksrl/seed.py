"""What can be a seed: what every generator of random numbers takes that is at work here."""

from __future__ import annotations

from bricksrl.errors import DescriptionError

LARGEST_SEED = 2**32 - 1
"""NumPy's and Optuna's older generators take no larger one."""


def check_seed(seed: int | None) -> None:
    """Nothing happens for a seed, or for ``None``, another one every time.

    Raises:
        DescriptionError: it cannot be a seed.
    """
    if seed is not None and not (hasattr(seed, "__index__") and 0 <= seed <= LARGEST_SEED):
        raise DescriptionError(f"seed is {seed}; give a whole number from 0 to {LARGEST_SEED}")
