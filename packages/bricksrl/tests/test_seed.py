"""Seed validation; commands are in ``cli/test_app.py``."""

from __future__ import annotations

from collections.abc import Callable
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from brickhub.seed import LARGEST_SEED, check_seed
from bricksrl import TrainConfig, evaluate, make
from bricksrl.data.collect import collect, random_policy
from bricksrl.data.edit import split
from bricksrl.errors import DescriptionError
from bricksrl.evaluation.tuning import Tuning, tune
from bricktwin.twin.system_id import fit

NOWHERE = Path("nowhere")
NOBODY: Any = None


@pytest.mark.parametrize("seed", [0, LARGEST_SEED, np.int64(7), None])
def test_seeds(seed: int | None) -> None:
    check_seed(seed)
    make("WalkerSim-v0", seed=seed).close()


@pytest.mark.parametrize(
    "use",
    [
        lambda seed: make("RunAway-v0", seed=seed),
        lambda seed: make("WalkerSim-v0", seed=seed),
        lambda seed: TrainConfig("WalkerSim-v0", seed=seed),
        lambda seed: evaluate(NOWHERE, seed=seed),
        lambda seed: tune(Tuning("WalkerSim-v0", "sac"), NOWHERE, 1, seed=seed),
        lambda seed: random_policy(NOBODY, seed),
        lambda seed: collect(NOBODY, NOBODY, NOBODY, 1, name="random", seed=seed),
        lambda seed: split(NOWHERE, NOWHERE, NOWHERE, 0.5, seed),
        lambda seed: fit(NOBODY, seed=seed),
    ],
)
@pytest.mark.parametrize("seed", [-1, LARGEST_SEED + 1, 0.5])
def test_invalid_seeds(use: Callable[[Any], object], seed: float) -> None:
    with pytest.raises(
        DescriptionError, match=f"^seed is {seed}; give a whole number from 0 to 4294967295$"
    ):
        use(seed)
