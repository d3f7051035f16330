"""What the paper's figures show, beside the same figures drawn from the study `paper`: the table of
docs/paper.md."""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass
from math import inf
from statistics import fmean, median
from typing import Any, TypeAlias

from benchmarks import paper
from benchmarks.figures import AGENTS, smoothed
from benchmarks.formatting import number, table

Cells: TypeAlias = Mapping[tuple[str, str], dict[str, Any]]
"""Cells of the study by agent and environment."""
Answer: TypeAlias = tuple[str, bool | None]
"""What was measured, and whether the claim holds; ``None`` where cells are missing."""
_SIM, _ARM_SIM = "Walker-v0 from WalkerSim-v0", "RoboArm-v0 from RoboArmSim-v0"
LEARNED_RANDOM = 10
"""Episodes of random actions before an agent learns, in the paper's settings."""


@dataclass(frozen=True)
class Claim:
    """A claim of a figure of the paper.

    Attributes:
        figure: name of ours, see `benchmarks.figures`.
        answer: measures it.
    """

    figure: str
    says: str
    answer: Callable[[Cells], Answer]


def _last(cell: Mapping[str, Any]) -> dict[str, Any]:
    condition: dict[str, Any] = list(cell["conditions"].values())[-1]
    return condition


def _each(cells: Cells, column: str) -> dict[str, dict[str, Any]]:
    return {
        agent: cells[agent, column] for agent in ("td3", "sac", "droq") if (agent, column) in cells
    }


def _named(values: Mapping[str, float]) -> str:
    return ", ".join(f"{AGENTS[agent]} {number(value)}" for agent, value in values.items())


def all_learn(column: str) -> Callable[[Cells], Answer]:
    """Whether each agent is nearer to the paper's best return than to its random one."""

    def answer(cells: Cells) -> Answer:
        env = column.rpartition(" ")[2]
        returns = {agent: _last(cell)["return_iqm"] for agent, cell in _each(cells, column).items()}
        known = paper.RETURNS[env]
        half = (max(mean for mean, _ in known.values()) + known["random"][0]) / 2
        holds = all(value > half for value in returns.values())
        return _named(returns), holds if len(returns) == 3 else None

    return answer


def _strategies(metric: str, higher: str, lower: str) -> Callable[[Cells], Answer]:
    def answer(cells: Cells) -> Answer:
        values = {
            agent: _last(cell)["metrics"][metric]
            for agent, cell in _each(cells, "RunAway-v0").items()
        }
        return _named(values), values[higher] > values[lower] if {
            higher,
            lower,
        } <= values.keys() else None

    return answer


def episodes_to(cell: Mapping[str, Any], goal: float) -> float:
    """Median over the seeds: episodes until the mean of five reached ``goal``; infinite if most
    never did."""
    return median(
        next(
            (n for n, value in enumerate(smoothed(one["return"]), 1) if value >= goal and n >= 5),
            inf,
        )
        for one in cell["curves"]
    )


def _sooner(cells: Cells) -> Answer:
    goal = paper.RETURNS["Walker-v0"]["droq"][0]
    counts = {agent: episodes_to(cell, goal) for agent, cell in _each(cells, "Walker-v0").items()}
    text = f"episodes to {number(goal)}, {LEARNED_RANDOM} random ones included: {_named(counts)}"
    return text, counts["droq"] < min(counts["td3"], counts["sac"]) if len(counts) == 3 else None


def _better_in_simulation(cells: Cells) -> Answer:
    on_robot, in_simulation = (
        {
            agent: fmean(fmean(one["return"][-5:]) for one in cell["curves"])
            for agent, cell in _each(cells, column).items()
        }
        for column in ("Walker-v0", _SIM)
    )
    both = in_simulation.keys() & on_robot.keys()
    text = f"last five episodes, simulation: {_named(in_simulation)}; robot: {_named(on_robot)}"
    return text, all(in_simulation[agent] > on_robot[agent] for agent in both) if both else None


def _camera(cells: Cells) -> Answer:
    rates = {
        agent: 100 * _last(cell)["success_rate"]
        for agent, cell in _each(cells, "RoboArm_mixed-v0").items()
    }
    text = f"success in %: {_named(rates)}"
    return text, rates["sac"] > 50 and rates["td3"] < 50 if {"sac", "td3"} <= rates.keys() else None


def _fewer_steps(cells: Cells) -> Answer:
    cell = cells.get(("sac", "RoboArm_mixed-v0"))
    if cell is None:
        return "", None
    first, last = (
        fmean(fmean(one["episode_steps"][part]) for one in cell["curves"])
        for part in (slice(25), slice(-25, None))
    )
    return (
        f"SAC, steps of the first and the last 25 episodes: {number(first)}, {number(last)}",
        last < first,
    )


def _slower_is_sooner(cells: Cells) -> Answer:
    goal = paper.RETURNS["Walker-v0"]["droq"][0]
    columns = {"2 Hz": "Walker-v0, 2 Hz", "4 Hz": "Walker-v0", "11 Hz": "Walker-v0, 11 Hz"}
    counts = {
        name: episodes_to(cells["droq", column], goal)
        for name, column in columns.items()
        if ("droq", column) in cells
    }
    reached = {
        name: number(count) if count < inf else "not reached" for name, count in counts.items()
    }
    text = f"episodes to {number(goal)}: " + ", ".join(
        f"{name} {text}" for name, text in reached.items()
    )
    return text, counts["2 Hz"] < counts["11 Hz"] if {"2 Hz", "11 Hz"} <= counts.keys() else None


def _transferred(column: str) -> Callable[[Cells], Answer]:
    def answer(cells: Cells) -> Answer:
        medians = {
            agent: median(_last(cell)["returns"]) for agent, cell in _each(cells, column).items()
        }
        theirs = {agent: cells[agent, column]["paper"]["return"][0] for agent in medians}
        text = f"medians over the seeds: {_named(medians)}; in the paper: {_named(theirs)}"
        return text, all(medians[agent] >= theirs[agent] for agent in medians) if medians else None

    return answer


CLAIMS = (
    Claim("2wheeler", "all learn RunAway-v0 in 40 episodes", all_learn("RunAway-v0")),
    Claim("2wheeler", "all learn Spinning-v0 in 15", all_learn("Spinning-v0")),
    Claim("walker", "all learn to walk in 75 (here DroQ in 27)", all_learn("Walker-v0")),
    Claim("walker", "DroQ needs far fewer episodes", _sooner),
    Claim("walker", "learning in simulation ends higher than on the robot", _better_in_simulation),
    Claim("robo_arm", "all learn to reach on the robot", all_learn("RoboArm-v0")),
    Claim("robo_arm", "all learn to reach in simulation", all_learn(_ARM_SIM)),
    Claim("camera", "SAC learns, TD3 fails", _camera),
    Claim("camera", "episodes become shorter", _fewer_steps),
    Claim("rates", "DroQ learns sooner at 2 Hz than at 11 Hz", _slower_is_sooner),
    Claim(
        "strategies", "TD3 acts more strongly than DroQ", _strategies("action_size", "td3", "droq")
    ),
    Claim(
        "strategies",
        "TD3 gets farther from the wall than DroQ",
        _strategies("final_distance_mm", "td3", "droq"),
    ),
    Claim("sim_to_robot", "what learned in WalkerSim-v0 walks", _transferred(_SIM)),
    Claim("sim_to_robot", "what learned in RoboArmSim-v0 reaches", _transferred(_ARM_SIM)),
)
"""All claims, in the order of the figures."""


def claims(cells: Sequence[dict[str, Any]]) -> str:
    """Table of the claims, with what the cells of the study say."""
    known = {(cell["row"], cell["column"]): cell for cell in cells}
    rows = []
    for claim in CLAIMS:
        text, holds = claim.answer(known)
        verdict = "not run in full" if holds is None else "holds" if holds else "does not hold"
        rows.append([f"`paper_{claim.figure}`", claim.says, text, verdict])
    return table(["figure", "the paper", "here", ""], rows)
