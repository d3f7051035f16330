"""Figures and claims of the paper."""

from __future__ import annotations

from typing import Any

import pytest
from matplotlib.figure import Figure

from benchmarks.claims import claims
from benchmarks.figures import curve


def cell(agent: str, seeds: int, column: str = "RunAway-v0", last: float = 20.0) -> dict[str, Any]:
    returns = [[-1.0, 0.0, 5.0, last - seed] for seed in range(seeds)]
    condition = {
        "returns": [one[-1] for one in returns],
        "return_iqm": last,
        "metrics": {"action_size": 0.5, "final_distance_mm": last},
    }
    curves = [{"return": one} for one in returns]
    return {
        "row": agent,
        "column": column,
        "curves": curves,
        "conditions": {"20 episodes": condition},
        "paper": {"return": [8, 1]},
    }


@pytest.mark.parametrize(("seeds", "bands"), [(5, 1), (3, 0)])
def test_a_curve_has_an_interval_from_five_seeds_on(seeds: int, bands: int) -> None:
    axes = Figure().add_subplot()
    assert curve("RunAway-v0")(axes, [cell("sac", seeds)])
    assert len(axes.collections) == bands
    assert not curve("Spinning-v0")(axes, [cell("sac", seeds)])


def test_a_claim_holds_does_not_or_was_not_run() -> None:
    agents = ("td3", "sac", "droq")
    said = claims([cell(agent, 5) for agent in agents])
    assert (
        "| `paper_2wheeler` | all learn RunAway-v0 in 40 episodes | TD3 20, SAC 20, DroQ 20 "
        "| holds |"
    ) in said
    assert "not run in full" in claims([cell("sac", 5)]).splitlines()[2]
    assert (
        "does not hold" in claims([cell(agent, 5, last=-0.5) for agent in agents]).splitlines()[2]
    )
