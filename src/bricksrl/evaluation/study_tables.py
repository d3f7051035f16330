"""Definitions of the studies: their trainings and evaluations."""

from __future__ import annotations

from collections.abc import Callable, Mapping
from dataclasses import dataclass, field
from typing import Any

import numpy as np

from bricksrl.envs.registry import training_episodes
from bricksrl.errors import UnknownNameError
from bricksrl.twin.physics import Physics, RandomPhysics

DRAWN_TWINS = 20
_DRAW_SEED = 20


@dataclass(frozen=True)
class Condition:
    """Environment of an evaluation.

    Attributes:
        env: environment, if it differs from that of the training.
        named: fields of `EnvOptions` that differ from the nominal twin.
        episodes: episodes per seed.
    """

    name: str
    env: str | None = None
    named: Mapping[str, Any] = field(default_factory=dict)
    episodes: int = 20


@dataclass(frozen=True)
class Cell:
    """One training, run with several seeds, and its evaluations.

    Attributes:
        row, column: place in the table.
        config: fields of `TrainConfig`, without seed and folder.
    """

    row: str
    column: str
    config: Mapping[str, Any]
    conditions: tuple[Condition, ...]


@dataclass(frozen=True)
class Study:
    """A table of trainings.

    Attributes:
        hours, quick_minutes: approximate duration on two cores.
        cells: makes the cells of the study, or of its quick form, a smoke test of a few episodes.
    """

    name: str
    title: str
    hours: float
    quick_minutes: float
    seeds: int
    cells: Callable[[bool], tuple[Cell, ...]]


ON_THE_ROBOT = ("RunAway-v0", "Spinning-v0", "Walker-v0", "RoboArm-v0", "RoboArm_mixed-v0")
IN_SIMULATION = {"WalkerSim-v0": "Walker-v0", "RoboArmSim-v0": "RoboArm-v0"}
PAPERS_AGENTS = ("td3", "sac", "droq", "random")


def _episodes(env: str, quick: bool) -> int:
    return 3 if quick else training_episodes(env)


def _judged(quick: bool, env: str | None = None) -> tuple[Condition, ...]:
    """Conditions with 5 episodes, as in the paper, and with 20."""
    return tuple(Condition(f"{count} episodes", env, episodes=2 if quick else count) for count in (5, 20))


def _agents(quick: bool) -> tuple[Cell, ...]:
    robots = ("RunAway-v0", "Walker-v0") if quick else ON_THE_ROBOT
    cells = [
        Cell(agent, env, {"env": env, "agent": agent, "episodes": _episodes(env, quick)}, _judged(quick))
        for env in robots
        for agent in PAPERS_AGENTS
    ]
    for env, there in list(IN_SIMULATION.items())[: 1 if quick else None]:
        for agent in PAPERS_AGENTS:
            config = {"env": env, "agent": agent, "episodes": _episodes(env, quick)}
            cells.append(Cell(agent, f"{there} from {env}", config, _judged(quick, there)))
    return tuple(cells)


def drawn_twins(count: int = DRAWN_TWINS) -> list[Physics]:
    """Randomly drawn physics, the same at every call."""
    rng = np.random.default_rng(_DRAW_SEED)
    return [RandomPhysics().sample(rng) for _ in range(count)]


OUTSIDE = {
    "slippery floor": Physics(friction_scale=0.4),
    "carpet": Physics(friction_scale=2.0, motor_friction_scale=2.0),
    "heavy": Physics(mass_scale=1.5),
    "flat battery": Physics(battery_v=6.4),
    "slow link": Physics(link_interval_ms=100.0),
}
"""Physics outside of the ranges of domain randomization."""


def _sim_to_robot(quick: bool) -> tuple[Cell, ...]:
    drawn, episodes = drawn_twins(2 if quick else DRAWN_TWINS), 1 if quick else 5
    trained = {"WalkerSim-v0": "Walker-v0", "WalkerSim-v1": "Walker-v0", "RoboArmSim-v0": "RoboArm-v0", "Walker-v1": "Walker-v1"}
    cells = []
    for env, there in list(trained.items())[: 1 if quick else None]:
        conditions = [Condition("nominal twin", there, episodes=2 if quick else 20)]
        conditions += [Condition("drawn twins", there, {"physics": one}, episodes) for one in drawn]
        conditions += [Condition(name, there, {"physics": one}, episodes) for name, one in OUTSIDE.items()]
        options = {"randomize": True} if env == there else {}
        cells.append(Cell("sac", env, {"env": env, "episodes": _episodes(env, quick), **options}, tuple(conditions)))
    return tuple(cells)


def _communication(quick: bool) -> tuple[Cell, ...]:
    cells = []
    for interval_ms in (15.0,) if quick else (7.5, 15.0, 30.0, 45.0):
        for streaming in (False, True):
            config = {"env": "Walker-v0", "episodes": _episodes("Walker-v0", quick), "streaming": streaming}
            config["physics"] = Physics(link_interval_ms=interval_ms)
            row = "streaming" if streaming else "lock-step"
            cells.append(Cell(row, f"{interval_ms:g} ms", config, (Condition("as trained", episodes=2 if quick else 20),)))
    return tuple(cells)


def _robot_time(quick: bool) -> tuple[Cell, ...]:
    robots = ("RunAway-v0",) if quick else ("RunAway-v0", "Spinning-v0", "Walker-v0", "RoboArm-v0")
    after = (Condition("20 episodes", episodes=2 if quick else 20),)
    return tuple(Cell("sac", env, {"env": env, "episodes": _episodes(env, quick)}, after) for env in robots)


STUDIES = {
    one.name: one
    for one in (
        Study("agents", "Agents of the paper, on the robot and from simulation", 60.0, 15.0, 5, _agents),
        Study("sim-to-robot", "From simulation to robots with other physics", 6.0, 4.0, 5, _sim_to_robot),
        Study("communication", "The link's interval, in lock-step and streaming", 12.0, 4.0, 5, _communication),
        Study("robot-time", "Robot minutes and wall minutes to a working policy", 12.0, 2.0, 5, _robot_time),
    )
}
"""Studies by name."""


def get_study(name: str) -> Study:
    """The study of that name.

    Raises:
        UnknownNameError: there is no such study.
    """
    if name not in STUDIES:
        raise UnknownNameError(f"there is no study '{name}'; choose {', '.join(STUDIES)}")
    return STUDIES[name]
