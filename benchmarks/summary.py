"""Summary of the results, one line each, for the README; written by `benchmarks/tables.py`."""

from __future__ import annotations

import json
import statistics
from collections.abc import Callable
from typing import Any, TypeAlias

import numpy as np

from benchmarks.formatting import number, table
from benchmarks.session import RESULTS
from bricksrl.errors import percent
from bricksrl.evaluation.statistics import interquartile_mean

Result: TypeAlias = dict[str, Any]
AGENTS = {"sac": "SAC", "td3": "TD3", "droq": "DroQ", "crossq": "CrossQ"}
_EPISODE_STEPS = 100


def robot_arm(result: Result) -> str:
    """Robot steps until all 40 evaluated episodes of all seeds reach the goal."""
    arm = result["environments"]["RoboArmSim-v0"]
    steps = (
        next(
            f"{name} {mark['mark']}" for mark in arm[agent]["summary"] if mark["success_mean"] == 1
        )
        for agent, name in AGENTS.items()
    )
    return ", ".join(steps)


def walker(result: Result) -> str:
    """Returns after 5 and 25 episodes."""
    agents = result["environments"]["WalkerSim-v0"]
    parts = []
    for episodes in (5, 25):
        means = {
            name: mark["return_mean"]
            for agent, name in AGENTS.items()
            for mark in agents[agent]["summary"]
            if mark["mark"] == episodes * _EPISODE_STEPS
        }
        parts.append(
            f"after {episodes}: "
            f"{', '.join(f'{name} {number(mean)}' for name, mean in means.items())}"
        )
    return "; ".join(parts)


def race(result: Result) -> str:
    """Median CPU seconds, robot steps and number of seeds of the contestants with the same
    settings."""
    names = {
        "ours_sac": "SAC",
        "ours_td3": "TD3",
        "sb3_sac_like_ours": "Stable-Baselines3's SAC",
        "sbx_sac_like_ours": "SBX's SAC",
    }
    parts = []
    for key, name in names.items():
        entry = result["contestants"][key]
        parts.append(
            f"{name} {entry['cpu_s']:.1f} s, {entry['steps']:.0f} steps (n={len(entry['runs'])})"
        )
    return f"{'; '.join(parts[:2])}; with the same features and settings {'; '.join(parts[2:])}"


def robot_time(result: Result) -> str:
    """Robot minutes (interquartile mean) to the return of the paper's best agent, and the paper's
    training time."""
    cells = []
    for cell in result["cells"]:
        minutes = interquartile_mean(np.array(cell["robot_s"])) / 60
        cells.append(
            f"{cell['column'].removesuffix('-v0')} {minutes:.1f} ({cell['paper']['minutes']:.0f})"
        )
    return ", ".join(cells)


def camera(result: Result) -> str:
    """Median success rates."""
    marks = {
        mark["episodes"]: mark["success_median"] for mark in result["agents"]["sac"]["summary"]
    }
    return f"{percent(marks[50])} and {percent(marks[100])}"


def teachers(result: Result) -> str:
    """Least and last returns in shares of the gait's, in the worst run with demonstrations."""
    runs = [run for run in result["runs"] if run["way"] == "demonstrations"]
    least, last = (min(run[key] for run in runs) for key in ("least_of_gait", "last_of_gait"))
    return f"{percent(least)} of the gait at least, {percent(last)} at the end"


def realtime_learning(result: Result) -> str:
    """Share of the updates asked for that SAC made."""
    sac = result["agents"]["sac"]
    return (
        f"{100 * sac['updates_per_step_reached'] / sac['updates_per_step_asked']:.1f} % of "
        "those asked for"
    )


def realtime_factor(result: Result) -> str:
    """Times real time, and times the cost of the physics."""
    cells = [
        f"{env.removesuffix('-v0')} {entry['realtime_factor']:.0f} ({entry['ratio']:.2f})"
        for env, entry in result["environments"].items()
        if env.endswith("-v0")
    ]
    return ", ".join(cells)


def simulation_speed(result: Result) -> str:
    """Steps per second of the best batch."""
    return f"{min(result['best_steps_per_s'].values()) / 1e6:.0f} million steps per second"


def fleet(result: Result) -> str:
    """Times as fast."""
    return ", ".join(
        f"{times:g} times as fast to {count} in a row"
        for count, times in result["times_as_fast"].items()
    )


def arena(result: Result) -> str:
    """Rate of won episodes and CPU seconds of the best agent."""
    entry = result["agents"]["mappo"]
    script, random = (percent(entry[f"against_{runner}"]["rate"]) for runner in ("flee", "random"))
    cpu_s = statistics.median(entry["training_cpu_s"])
    return f"{script} against the script, {random} against a random runner, after {cpu_s:.0f} s"


def telling(result: Result) -> str:
    """Rates of the hearing and the deaf teams of MAPPO."""
    entry = result["agents"]["mappo"]
    hearing = percent(entry["hearing"]["rate"])
    return f"{hearing} of the episodes; deaf {percent(entry['deaf']['rate'])}"


def sim_to_robot(result: Result) -> str:
    """Speed and return on other robots."""
    conditions = result["cells"][0]["conditions"]
    parts = []
    for name in ("nominal twin", "drawn twins"):
        entry = conditions[name]
        parts.append(
            f"{name}: {entry['metrics']['forward_speed_m_s']:.3f} m/s, return "
            f"{number(entry['return_iqm'])}"
        )
    return "; ".join(parts)


LINK_RATES = "{lock_step[15 ms][p50_ms]:.0f} ms, which is two connection intervals of 15 ms"
LINK_FAULTS = (
    "the motors ran for {longest_silent_drive_ms} ms at most (watchdog: {watchdog_ms} ms); "
    "training continued after each"
)
ROWS: tuple[tuple[str, str, str | Callable[[Result], str], str], ...] = (
    (
        "learning",
        "robot steps until 40 of 40 episodes reach the goal in `RoboArmSim-v0`, ten seeds",
        robot_arm,
        "",
    ),
    ("learning", "return in `WalkerSim-v0` after so many episodes, ten seeds", walker, ""),
    (
        "race",
        "CPU time until a return of -20 in `WalkerSim-v0`, start-up included, median",
        race,
        "",
    ),
    (
        "study_robot-time",
        (
            "robot minutes until five consecutive episodes reach the return of the paper's best "
            "agent (the paper's training time)"
        ),
        robot_time,
        "python -m benchmarks robot-time",
    ),
    (
        "study_sim-to-robot",
        "walking on virtual robots after training in `WalkerSim-v0` alone, five seeds",
        sim_to_robot,
        "python -m benchmarks sim-to-robot",
    ),
    (
        "camera_learning",
        "success rate of the camera task after 50 and 100 episodes, median of five seeds",
        camera,
        "",
    ),
    (
        "teachers",
        (
            "SAC on the Walker with a gait's demonstrations, in 1,000 robot steps, the worst of "
            "five seeds"
        ),
        teachers,
        "",
    ),
    (
        "realtime_learning",
        "updates done while the robot moves (`Walker-v0 --realtime`)",
        realtime_learning,
        "",
    ),
    (
        "fleet",
        "four robots with one learner instead of one robot, until perfect episodes of RunAway",
        fleet,
        "",
    ),
    ("arena", "Tag: episodes that the catcher wins after training (MAPPO, CPU time)", arena, ""),
    ("telling", "a team finds the gate: hubs that hear one another, and deaf ones", telling, ""),
    (
        "realtime_factor",
        (
            "speed of the virtual robots on one core, times real time (total cost over that of the "
            "physics)"
        ),
        realtime_factor,
        "",
    ),
    ("simulation_speed", "speed of the batched simulations", simulation_speed, ""),
    ("link_rates", "one exchange over a simulated radio link", LINK_RATES, ""),
    (
        "link_faults",
        "1,000 faults injected into that link, including killed processes",
        LINK_FAULTS,
        "",
    ),
)
"""Name of the result, what it is, its text or a function that makes it, and its command if not the
script of that name."""


def summary() -> str:
    """The table of all rows whose results exist."""
    rows = [
        [
            what,
            text.format(**found) if isinstance(text, str) else text(found),
            f"`{command or f'python -m benchmarks {name}'}`",
        ]
        for name, what, text, command in ROWS
        if (path := RESULTS / f"{name}.json").exists()
        and (found := json.loads(path.read_text(encoding="utf-8")))
    ]
    return table(["what", "result", "command"], rows)
