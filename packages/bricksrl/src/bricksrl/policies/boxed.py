"""Policies that come with BricksRL, trained by ``python -m benchmarks policies``. Importing this loads no torch."""

from __future__ import annotations

from pathlib import Path

from brickhub.tables import read_table
from bricksrl.policies.plain import PlainPolicy

FOLDER = Path(__file__).with_name("trained")
TRAINED = {row["env"]: row for row in read_table(__package__, "trained/policies")}
"""Settings and mean return of each policy, by its environment."""


def path_of(env_id: str) -> Path:
    """File of the policy of an environment."""
    return FOLDER / f"{env_id}.npz"


def boxed_policy(env_id: str) -> PlainPolicy | None:
    """The policy of an environment; ``None`` where none comes with BricksRL."""
    return PlainPolicy.load(path_of(env_id)) if env_id in TRAINED else None
