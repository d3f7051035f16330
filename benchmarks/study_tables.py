"""Definitions of the studies: their trainings and evaluations."""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, field, replace
from typing import Any

import numpy as np

from benchmarks import paper
from benchmarks.session import Benchmark
from brickhub.hub.link.profiles import PROFILES
from bricksrl.envs.registry import training_episodes
from bricktwin.twin.physics import Physics, RandomPhysics

DRAWN_TWINS = 20
LEARN_ON_TWINS = 3
"""Number of drawn twins on which an agent is trained further."""
_DRAW_SEED = 20
_STEPS = ("episode_steps",)
_WALK = ("forward_speed_m_s",)
_STRATEGY = ("final_distance_mm", "action_size", "largest_pitch_deg", "episode_steps")


@dataclass(frozen=True)
class Condition:
    """Environment of an evaluation.

    Attributes:
        env: environment, if it differs from that of the training.
        named: fields of `EnvOptions` that differ from the nominal twin.
        episodes: number of evaluated episodes per seed.
        learn_episodes: number of further training episodes there, before the evaluation.
    """

    name: str
    env: str | None = None
    named: Mapping[str, Any] = field(default_factory=dict)
    episodes: int = 20
    learn_episodes: int = 0


@dataclass(frozen=True)
class Cell:
    """One training, run with several seeds, and its evaluations.

    Attributes:
        row, column: position in the table.
        config: fields of `TrainConfig`; seed and folder are set by the study. ``preset`` names the
            agent's settings.
        paper: the paper's numbers: "return" (mean and standard deviation), "success" (rate),
            "minutes" of a training.
    """

    row: str
    column: str
    config: Mapping[str, Any]
    conditions: tuple[Condition, ...]
    paper: Mapping[str, Any] = field(default_factory=dict)


@dataclass(frozen=True)
class Study(Benchmark):
    """Table of trainings.

    Attributes:
        cells: returns the cells of the study, or of its quick form, a smoke test with few episodes.
        metrics: metrics of the evaluated episodes that its page shows.
        note: how to read its table.
        heads: what the rows and the columns of its cells are.
    """

    cells: Callable[[bool], tuple[Cell, ...]] = field(kw_only=True)
    seeds: int = 5
    metrics: tuple[str, ...] = ()
    note: str = ""
    heads: tuple[str, str] = ("agent", "environment")

    @property
    def module(self) -> str:
        return "study"

    @property
    def result(self) -> str:
        return f"study_{self.name}"


_PAPER = (
    "Success on RunAway-v0, where the paper has none, is a final distance of 1 m; the "
    "greatest return, 20, needs less."
)
_STOPPED = (
    "Training stops as soon as five consecutive episodes reach, on average, the return of the "
    "paper's best agent. Some do so by "
    "luck: the policy is then worse than that return when it is evaluated, as some of the camera "
    "task are."
)
_RATES = (
    "An episode takes the same time at every rate, and has more steps at a higher one: "
    "compare speeds, not returns."
)
ON_THE_ROBOT = ("RunAway-v0", "Spinning-v0", "Walker-v0", "RoboArm-v0", "RoboArm_mixed-v0")
IN_SIMULATION = {"WalkerSim-v0": "Walker-v0", "RoboArmSim-v0": "RoboArm-v0"}
PAPER_AGENTS = ("td3", "sac", "droq", "random")
DROQ_EPISODES = {
    "Walker-v0": 27,
    "WalkerSim-v0": 27,
    "RoboArm-v0": 120,
    "RoboArmSim-v0": 120,
    "RoboArm_mixed-v0": 60,
}
"""Episodes of DroQ with the paper's settings where the paper's would take hours; on the Walker its
curve is flat by then."""


def _episodes(env: str, quick: bool) -> int:
    return 2 if quick else training_episodes(env)


def _played(count: int, quick: bool, env: str | None = None) -> Condition:
    """Condition of a number of episodes."""
    return Condition(f"{count} episodes", env, episodes=2 if quick else count)


def _cell(
    agent: str,
    env: str,
    quick: bool,
    conditions: tuple[Condition, ...],
    column: str = "",
    **config: Any,
) -> Cell:
    """Cell of an agent that the paper trained in this environment, with the paper's numbers."""
    numbers: dict[str, Any] = {
        "return": paper.RETURNS[env][agent],
        "success": paper.SUCCESS.get(env, {}).get(agent),
    }
    known = {name: value for name, value in numbers.items() if value is not None}
    return Cell(
        agent,
        column or env,
        {"env": env, "agent": agent, "episodes": _episodes(env, quick), **config},
        conditions,
        known,
    )


def _agents(quick: bool, agents: Sequence[str] = PAPER_AGENTS, **config: Any) -> tuple[Cell, ...]:
    """Agents of the paper, evaluated with 5 episodes, as in the paper, and with 20."""
    test_envs = {env: env for env in ON_THE_ROBOT} | IN_SIMULATION
    if quick:
        test_envs = {env: test_envs[env] for env in ("RunAway-v0", "WalkerSim-v0")}
    return tuple(
        _cell(
            agent,
            env,
            quick,
            (_played(5, quick, test_env), _played(20, quick, test_env)),
            env if env == test_env else f"{test_env} from {env}",
            **config,
        )
        for env, test_env in test_envs.items()
        for agent in agents
    )


def _paper_settings(quick: bool) -> tuple[Cell, ...]:
    """The paper's agents with its settings; the Walker at the paper's 2 Hz too, and DroQ at 11 Hz,
    for as many steps."""
    agents = ("sac",) if quick else ("td3", "sac", "droq")
    rates = {"2 Hz": (500, agents), "11 Hz": (91, ("droq",))}
    at_rates = tuple(
        _cell(
            agent,
            "Walker-v0",
            quick,
            (_played(5, quick), _played(20, quick)),
            f"Walker-v0, {name}",
            preset="paper",
            options={"step_ms": step_ms, "max_steps": 100},
        )
        for name, (step_ms, of) in rates.items()
        for agent in (() if quick else of)
    )
    cells = _agents(quick, agents, preset="paper") + at_rates + (() if quick else _longer())
    return tuple(
        _shortened(cell) if cell.row == "droq" and cell.config["env"] in DROQ_EPISODES else cell
        for cell in cells
    )


def _longer() -> tuple[Cell, ...]:
    """Cells below the paper's with twice its episodes: do TD3's seeds that turn one way only learn
    the other, and does SAC's return, which still rises, become the paper's?"""
    spun, reached = (
        (_played(5, False, env), _played(20, False, env)) for env in (None, "RoboArm-v0")
    )
    arm = "RoboArm-v0 from RoboArmSim-v0, 500 episodes"
    return (
        _cell(
            "td3",
            "Spinning-v0",
            False,
            spun,
            "Spinning-v0, 30 episodes",
            preset="paper",
            episodes=30,
        ),
        _cell("sac", "RoboArmSim-v0", False, reached, arm, preset="paper", episodes=500),
    )


def _shortened(cell: Cell) -> Cell:
    """A cell of DroQ, which makes 20 updates a step, with fewer episodes, and compiled."""
    return replace(
        cell, config={**cell.config, "episodes": DROQ_EPISODES[cell.config["env"]], "compile": True}
    )


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
    "5 degrees uphill": Physics(slope_deg=5.0),
    "one motor at 70 %": Physics(motor_1_scale=0.7),
    "100 g on one side": Physics(side_load_g=100.0),
}
"""Physics outside the ranges of domain randomization."""


def _sim_to_robot(quick: bool) -> tuple[Cell, ...]:
    drawn, episodes = drawn_twins(2 if quick else DRAWN_TWINS), 1 if quick else 5
    tested = {
        "WalkerSim-v0": "Walker-v0",
        "WalkerSim-v1": "Walker-v0",
        "RoboArmSim-v0": "RoboArm-v0",
        "Walker-v1": "Walker-v1",
    }
    cells = []
    for env, test_env in list(tested.items())[: 1 if quick else None]:
        fixed_base = test_env == "RoboArm-v0"
        outside = [
            (name, physics)
            for name, physics in OUTSIDE.items()
            if not (fixed_base and physics.side_load_g)
        ]
        loads = {"side_load_g": 0.0} if fixed_base else {}
        twins = [*(("drawn twins", replace(physics, **loads)) for physics in drawn), *outside]
        conditions = [Condition("nominal twin", test_env, episodes=2 if quick else 20)]
        conditions += [
            Condition(name, test_env, {"physics": physics}, episodes) for name, physics in twins
        ]
        for learn_episodes in (1,) if quick else (2, 5):
            continued = [*twins[:LEARN_ON_TWINS], *outside][: 2 if quick else None]
            conditions += [
                Condition(
                    f"{name}, {learn_episodes} episodes later",
                    test_env,
                    {"physics": physics},
                    episodes,
                    learn_episodes,
                )
                for name, physics in continued
            ]
        options = {"randomize": True} if env == test_env else {}
        cells.append(
            Cell(
                "sac",
                env,
                {"env": env, "episodes": _episodes(env, quick), **options},
                tuple(conditions),
            )
        )
    return tuple(cells)


def _drawn_worlds(quick: bool) -> tuple[Cell, ...]:
    """A Walker that learned in drawn worlds, in others, and in the nominal one over each link."""
    drawn = drawn_twins(2 if quick else DRAWN_TWINS)
    worlds = [
        Condition(f"world {n}", named={"physics": one, "link": "linux"}, episodes=2)
        for n, one in enumerate(drawn, 1)
    ]
    links = [Condition(f"nominal, {link}", named={"link": link}, episodes=5) for link in PROFILES]
    config = {"env": "Walker-v1", "episodes": 2 if quick else 40, "randomize": True}
    return (Cell("sac", "Walker-v1", config, (*worlds, *links)),)


def _communication(quick: bool) -> tuple[Cell, ...]:
    """Step rates over a link of 15 ms, and link intervals at 4 Hz, each in lock-step and
    streaming."""
    rates_hz = {4.0: 250} if quick else {2.0: 500, 4.0: 250, 11.0: 91, 30.0: 33}
    intervals_ms = (45.0,) if quick else (7.5, 30.0, 45.0)
    variants: dict[str, dict[str, Any]] = {
        f"{hz:g} Hz": {"options": {"step_ms": step_ms}} for hz, step_ms in rates_hz.items()
    }
    variants |= {
        f"4 Hz, {ms:g} ms": {"physics": Physics(link_interval_ms=ms)} for ms in intervals_ms
    }
    config = {"env": "Walker-v0", "episodes": 2 if quick else 20}
    conditions = (Condition("as trained", episodes=2 if quick else 20),)
    return tuple(
        Cell(row, column, {**config, "streaming": row == "streaming", **variant}, conditions)
        for column, variant in variants.items()
        for row in ("lock-step", "streaming")
    )


def _strategies(quick: bool) -> tuple[Cell, ...]:
    return tuple(
        _cell(agent, "RunAway-v0", quick, (_played(20, quick),)) for agent in ("td3", "sac", "droq")
    )


def _robot_time(quick: bool) -> tuple[Cell, ...]:
    """SAC, trained until the mean return of five consecutive episodes reaches that of the paper's
    best agent."""
    cells = []
    for env in ("RunAway-v0",) if quick else ON_THE_ROBOT:
        goal = max(mean for mean, _ in paper.RETURNS[env].values())
        cell = _cell("sac", env, quick, (_played(20, quick),), stop_at=goal)
        cells.append(replace(cell, paper={**cell.paper, "minutes": paper.MINUTES[env]}))
    return tuple(cells)


STUDIES = (
    Study(
        "agents",
        "Agents of the paper, on the robot and from simulation",
        360,
        5,
        cells=_agents,
        metrics=_STEPS,
        note=_PAPER,
    ),
    Study(
        "paper",
        "The paper's settings, on the robot and from simulation",
        1200,
        5,
        cells=_paper_settings,
        metrics=_STEPS,
        note=_PAPER,
    ),
    Study(
        "sim-to-robot",
        "From simulation to robots with other physics",
        720,
        4,
        cells=_sim_to_robot,
        metrics=_WALK,
    ),
    Study(
        "communication",
        "Steps a second and the link's interval, streaming or not",
        180,
        4,
        cells=_communication,
        metrics=_WALK,
        note=_RATES,
        heads=("exchange", "rate and interval of the link"),
    ),
    Study(
        "drawn-worlds",
        "The Walker in drawn worlds and over each link",
        20,
        2,
        cells=_drawn_worlds,
        metrics=_WALK,
    ),
    Study("strategies", "Strategies on RunAway-v0", 30, 2, cells=_strategies, metrics=_STRATEGY),
    Study(
        "robot-time",
        "Robot minutes to a working policy",
        30,
        2,
        cells=_robot_time,
        metrics=_STEPS,
        note=_STOPPED,
    ),
)
"""All studies."""
