"""Arena: trained catchers against a random and a scripted runner, and a film of one.

    python -m benchmarks arena --seeds 5 --film docs/images/tag.mp4

Each catcher learns Tag-v0 in the kinematic simulation, half of whose copies have the scripted
runner and half the random one (a catcher trained against only one of them does not catch the
other). It is then evaluated in the arena itself, two virtual hubs in one MuJoCo world, in some
episodes per seed against each runner, with other starts than in training. The scripted and a random
catcher are measured too. Agents that are not measured again stay in the result.
"""

from __future__ import annotations

import time
from pathlib import Path
from typing import Any

import torch

from benchmarks.session import Session
from bricksrl.envs.arenas import make_arena
from bricksrl.evaluation.film import film_arena
from bricksrl.evaluation.statistics import FEWEST_SEEDS, wilson_interval
from bricksrl.training.teams.groups import TeamSettings, team_policy
from bricksrl.training.teams.team import TeamConfig, load_team, play_team, train_team

ENV, FRAMES, COPIES = "Tag-v0", 300_000, 256
SETTINGS = {
    "ippo": TeamSettings(),
    "mappo": TeamSettings(),
    "sac": TeamSettings(updates_per_step=8.0),
}
FRAMES_OF = {"ippo": FRAMES, "mappo": FRAMES, "sac": 100_000}
RUNNERS = ("flee", "random")
EVALUATION_SEED = 7000


Played = list[tuple[bool, int]]
"""Success and length of each episode."""


def rate(played: Played, *, seeds: int) -> dict[str, Any]:
    """Share of episodes that the catcher won, with its Wilson interval from five seeds on, and
    their mean length."""
    successes = [success for success, _ in played]
    result: dict[str, Any] = {"won": sum(successes), "episodes": len(successes)}
    result["rate"] = round(sum(successes) / len(successes), 3)
    if seeds >= FEWEST_SEEDS:
        interval = wilson_interval(sum(successes), len(successes))
        result["rate_95"] = [round(interval.low, 3), round(interval.high, 3)]
    result["steps_mean"] = round(sum(length for _, length in played) / len(played), 1)
    return result


def play(env: Any, policy: Any, episodes: int, seed: int) -> Played:
    """Play episodes of the arena."""
    return [
        (bool(episode.success), episode.length)
        for episode in play_team(env, policy, episodes, seed)
    ]


def train_and_play(
    agent: str, seed: int, episodes: int, path: Path, film: Path | None
) -> dict[str, Any]:
    """Train a catcher, save it to ``path``, play against each runner, and film three episodes."""
    started_s = time.process_time()
    config = TeamConfig(
        ENV, {"catcher": agent}, {"runner": ",".join(RUNNERS)}, FRAMES_OF[agent], COPIES, seed
    )
    path.parent.mkdir(parents=True, exist_ok=True)
    train_team(config, SETTINGS[agent]).save(path)
    cpu_s, env = time.process_time() - started_s, make_arena(ENV)
    played = {
        runner: play(
            env, load_team(path, {"runner": runner}).policy, episodes, EVALUATION_SEED + seed
        )
        for runner in RUNNERS
    }
    if film is not None:
        film_arena(env, load_team(path).policy, film, 3, EVALUATION_SEED)
    env.close()
    return {"training_cpu_s": round(cpu_s, 1), "played": played}


def summary(runs: list[dict[str, Any]]) -> dict[str, Any]:
    """Summary of all seeds of an algorithm."""
    played = {
        runner: [episode for run in runs for episode in run["played"][runner]] for runner in RUNNERS
    }
    rates = {
        f"against_{runner}": rate(episodes, seeds=len(runs)) for runner, episodes in played.items()
    }
    return {"seeds": len(runs), "training_cpu_s": [run["training_cpu_s"] for run in runs], **rates}


def scripts(episodes: int) -> dict[str, Any]:
    """Rates of the scripted and of a random catcher against each runner."""
    env = make_arena(ENV)
    rates: dict[str, Any] = {}
    for catcher in ("chase", "random"):
        for runner in RUNNERS:
            policy = team_policy(env, {}, {"catcher": catcher, "runner": runner})
            played = play(env, policy, episodes, EVALUATION_SEED)
            rates[f"{catcher}_against_{runner}"] = rate(played, seeds=1)
    env.close()
    return rates


def main(session: Session) -> None:
    """Measure all and write the results."""
    parser = session.parser
    parser.add_argument("--film", type=Path)
    args = session.parse(agents=list(SETTINGS), seeds=5, episodes=20)
    torch.set_num_threads(1)
    agents: dict[str, Any] = session.known().get("agents", {})
    for agent in args.agents:
        jobs: dict[str, tuple[Any, ...]] = {}
        for seed in range(args.seeds):
            film = args.film if agent == args.agents[0] and seed == 0 else None
            name = f"{agent}-{seed}-{args.episodes}{'-filmed' if film else ''}"
            jobs[name] = (agent, seed, args.episodes, session.folder / f"{agent}-{seed}.bin", film)
        agents[agent] = summary(list(session.outcomes(train_and_play, jobs, processes=1)))
    result = {"environment": ENV, "frames": FRAMES_OF, "copies": COPIES, "agents": agents}
    session.write({**result, "scripts": scripts(args.episodes)})
