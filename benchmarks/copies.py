"""Learning from many simulated copies: CPU seconds until the deterministic policy reaches a return
on WalkerSim-v0.

    python -m benchmarks copies [--seeds 5] [--limit 120]

PPO with 4,096 copies to -12, SAC with 256 copies to -10.5, one thread, each run in its own process,
start-up included. After each round (as many steps of all copies as an episode has) the policy is
evaluated on deterministic episodes, which is included in the time. A run that does not reach the
return within ``--limit`` CPU seconds counts with this limit. Beside them, what PPO reaches with as
many episodes as `bricksrl train` chooses by itself for so many copies, and the time that it takes.
"""

from __future__ import annotations

import statistics
import tempfile
import time
from pathlib import Path
from typing import Any

from benchmarks.session import Session

ENV = "WalkerSim-v0"
GOALS = {"ppo": (4096, -12.0), "sac": (256, -10.5)}
"""Copies, and the mean return to reach."""
EVALUATED = 40


def run(agent: str, seed: int, limit_s: float) -> list[list[float]]:
    """CPU seconds, steps of all copies and mean return after each round."""
    from benchmarks.stopping import StopWhen
    from bricksrl.training import Episode, TrainConfig, train

    copies, goal = GOALS[agent]
    rounds: list[list[float]] = []

    def is_over(episode: Episode) -> bool:
        value = float("nan") if episode.evaluation is None else episode.evaluation
        rounds.append([round(time.process_time(), 1), episode.steps, round(value, 2)])
        return value >= goal or time.process_time() > limit_s

    with tempfile.TemporaryDirectory() as folder:
        callback = StopWhen(is_over)
        config = TrainConfig(
            ENV,
            agent,
            1000,
            seed,
            num_envs=copies,
            eval_every=1,
            eval_episodes=EVALUATED,
            record=False,
            run_dir=Path(folder) / "run",
        )
        train(config, callback, stop=callback.stop)
    return rounds


def default_run(seed: int) -> list[float]:
    """CPU seconds of PPO's run of default length, start-up included, and the mean return of its
    policy in deterministic episodes."""
    from bricksrl.envs.registry import training_episodes
    from bricksrl.evaluation.evaluator import evaluate
    from bricksrl.training import TrainConfig, train

    copies, _ = GOALS["ppo"]
    with tempfile.TemporaryDirectory() as folder:
        run_dir = Path(folder) / "run"
        episodes = training_episodes(ENV, copies)
        train(TrainConfig(ENV, "ppo", episodes, seed, num_envs=copies, run_dir=run_dir))
        cpu_s = time.process_time()
        result = evaluate(run_dir, episodes=EVALUATED, save=False)
    return [round(cpu_s, 1), round(result.return_mean, 2)]


def main(session: Session) -> None:
    """Run all seeds and write the results."""
    parser = session.parser
    parser.add_argument("--limit", type=float, default=120.0, help="CPU seconds of a run at most")
    args = session.parse(agents=list(GOALS), seeds=5, default_seeds=10)
    agents: dict[str, Any] = {}
    for agent in args.agents:
        copies, goal = GOALS[agent]
        jobs = {
            f"{agent}-{seed}-{args.limit:g}": (agent, seed, args.limit)
            for seed in range(args.seeds)
        }
        runs = list(session.outcomes(run, jobs, processes=1, fresh=True))
        times = [rounds[-1][0] if rounds[-1][2] >= goal else args.limit for rounds in runs]
        agents[agent] = {
            "copies": copies,
            "goal": goal,
            "cpu_s_median": statistics.median(times),
            "cpu_s": times,
            "reached": sum(rounds[-1][2] >= goal for rounds in runs),
            "rounds": runs,
        }
        result = agents[agent]
        print(
            f"{agent}: {result['cpu_s_median']} CPU s to {goal}, {result['reached']} of {len(runs)}"
        )
    default_runs = {f"default-{seed}": (seed,) for seed in range(args.default_seeds)}
    defaults = list(session.outcomes(default_run, default_runs, processes=1, fresh=True))
    default = {
        "cpu_s": [cpu_s for cpu_s, _ in defaults],
        "returns": [mean for _, mean in defaults],
    }
    print(f"PPO's default run: {default}")
    setup = {"env": ENV, "evaluated": EVALUATED, "limit_s": args.limit}
    session.write({"setup": setup, "agents": agents, "default": default})
