"""Seeds: the range that all random generators accept, and derived seeds."""

import hashlib

from brickhub.errors import DescriptionError

LARGEST_SEED = 2**32 - 1
"""NumPy's and Optuna's older generators accept no larger seed."""


def check_seed(seed: int | None) -> None:
    """Check a seed; ``None`` stands for a random one. Raises DescriptionError if it is invalid."""
    if seed is not None and not (hasattr(seed, "__index__") and 0 <= seed <= LARGEST_SEED):
        raise DescriptionError(f"seed is {seed}; give a whole number from 0 to {LARGEST_SEED}")


def derive_seed(seed: int, purpose: str, index: int = 0) -> int:
    """A pseudo-random seed in 0..2**31-1 for each purpose and index."""
    digest = hashlib.sha256(f"{seed}/{purpose}/{index}".encode()).digest()
    return int.from_bytes(digest[:4], "little") >> 1
