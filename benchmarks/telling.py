"""A team that tells one another numbers over the air, beside one whose robots are deaf.

    python -m benchmarks telling --seeds 5

A guide sees the gate that a driver has to find (Guide-v0). For each seed MAPPO trains one team
whose hubs hear each other and one whose hubs do not, in the simulation, and both play in the arena
itself: virtual hubs in one MuJoCo world, the numbers go through the hubs' programs. The first team
plays deaf, too. The script and random actions are measured as well. ``--agents`` chooses other
algorithms; those that are not measured again stay in the result.
"""

from __future__ import annotations

import time
from pathlib import Path
from typing import Any

import torch

from benchmarks.session import Session
from bricksrl.envs.arenas import make_arena
from bricksrl.evaluation.statistics import FEWEST_SEEDS, wilson_interval
from bricksrl.training.teams.groups import TeamSettings, team_policy
from bricksrl.training.teams.team import TeamConfig, TeamEpisode, play_team, train_team

ENV = "Guide-v0"
GROUP = "agents"
FRAMES = 800_000
COPIES = 256
AGENTS = ["mappo", "ippo"]
SETTINGS = TeamSettings(gamma=0.9, gae_lambda=0.9, learning_rate=2e-3, steps=16)
"""What is told is worth something in the next step already, so the discount is small."""
EVALUATION_SEED = 7000

Played = list[tuple[bool, int]]
"""Success and length of each episode."""


def play(policy: Any, episodes: int, seed: int, *, deaf: bool) -> Played:
    """Play episodes of the arena."""
    env = make_arena(ENV, deaf=deaf)
    played: list[TeamEpisode] = play_team(env, policy, episodes, seed)
    env.close()
    return [(bool(episode.success), episode.length) for episode in played]


def train_and_play(
    agent: str,
    seed: int,
    episodes: int,
    frames: int,
    deaf: bool,
    path: Path,
) -> dict[str, Any]:
    """Train a team, save it to ``path``, and play in the arena; if it hears, also without."""
    torch.set_num_threads(1)
    started_s = time.process_time()
    config = TeamConfig(
        ENV,
        {GROUP: agent},
        frames=frames,
        copies=COPIES,
        seed=seed,
        deaf=deaf,
    )
    team = train_team(config, SETTINGS)
    cpu_s = time.process_time() - started_s
    path.parent.mkdir(parents=True, exist_ok=True)
    team.save(path)
    evaluation_seed = EVALUATION_SEED + seed
    outcome: dict[str, Any] = {
        "training_cpu_s": round(cpu_s, 1),
        "played": play(team.policy, episodes, evaluation_seed, deaf=deaf),
    }
    if not deaf:
        outcome["played_deaf"] = play(team.policy, episodes, evaluation_seed, deaf=True)
    return outcome


def rate(played: list[Played]) -> dict[str, Any]:
    """Successes of each seed, their share with its Wilson interval from five seeds on, and the mean
    length of an episode."""
    successes = [sum(success for success, _ in episodes) for episodes in played]
    lengths = [length for episodes in played for _, length in episodes]
    result: dict[str, Any] = {
        "successes": successes,
        "episodes": len(lengths),
        "rate": round(sum(successes) / len(lengths), 3),
        "steps_mean": round(sum(lengths) / len(lengths), 1),
    }
    if len(played) >= FEWEST_SEEDS:
        interval = wilson_interval(sum(successes), len(lengths))
        result["rate_95"] = [round(interval.low, 3), round(interval.high, 3)]
    return result


def summary(hearing: list[dict[str, Any]], deaf: list[dict[str, Any]]) -> dict[str, Any]:
    """Summary of all seeds of an algorithm."""
    return {
        "seeds": len(hearing),
        "training_cpu_s": [run["training_cpu_s"] for run in (*hearing, *deaf)],
        "hearing": rate([run["played"] for run in hearing]),
        "hearing_made_deaf": rate([run["played_deaf"] for run in hearing]),
        "deaf": rate([run["played"] for run in deaf]),
    }


def scripts(episodes: int) -> dict[str, Any]:
    """Rates of the script, hearing and deaf, and of random actions."""
    env = make_arena(ENV)
    rates = {}
    for script, deaf in (("follow", False), ("follow", True), ("random", False)):
        policy = team_policy(env, {}, {GROUP: script})
        name = f"{script}{'_deaf' if deaf else ''}"
        rates[name] = rate([play(policy, episodes, EVALUATION_SEED, deaf=deaf)])
    return rates


def main(session: Session) -> None:
    """Measure all and write the results."""
    args = session.parse(
        agents=AGENTS,
        seeds=5,
        episodes=20,
        frames=FRAMES,
    )
    agents: dict[str, Any] = session.known().get("agents", {})
    for agent in args.agents:
        runs: list[list[dict[str, Any]]] = []
        for deaf in (False, True):
            jobs: dict[str, tuple[Any, ...]] = {}
            for seed in range(args.seeds):
                name = f"{agent}-{seed}-{args.episodes}-{args.frames}{'-deaf' if deaf else ''}"
                path = session.folder / f"{name}.bin"
                jobs[name] = (agent, seed, args.episodes, args.frames, deaf, path)
            runs.append(list(session.outcomes(train_and_play, jobs, processes=1)))
        agents[agent] = summary(*runs)
    result = {"environment": ENV, "frames": args.frames, "copies": COPIES, "agents": agents}
    session.write({**result, "scripts": scripts(args.episodes)})
