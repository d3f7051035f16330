"""Fleet: four virtual robots in real time compared with one, and a link that is cut for half a
minute.

    python -m benchmarks fleet --seeds 10

Each run is `bricksrl train RunAway-v0 --realtime` with SAC's default settings, with one robot and
with four. Measured is the wall time from the first robot's first step to the end of three, and of
ten, consecutive episodes with a return of 20 of 20. Start-up of the processes is not included: all
robots begin together. Three in a row may be luck, and take a single robot three episodes but four
robots only one. The result also has the steps of the robot with the most steps until then, which
depend on no clock; with ``--simulated`` only these are measured, in simulated time. In another run
of four robots, the first robot's link is cut for 30 seconds. Its result has the numbers of frames
in the replay buffer and the dataset, and of links between frames of the buffer that are not
successive steps of one robot.
"""

from __future__ import annotations

import tempfile
import threading
import time
from collections import Counter
from pathlib import Path
from typing import Any

import numpy as np

from benchmarks.machine import describe
from benchmarks.session import Session
from bricksrl.evaluation.statistics import (
    FEWEST_SEEDS,
    interquartile_mean,
    stratified_bootstrap_interval,
)
from bricksrl.training import Callback, Episode, Progress, RobotState, TrainConfig, train

ENV, GOAL, IN_A_ROW = "RunAway-v0", 20.0, (3, 10)
CUT_S, CUT_AFTER = 30.0, 4


class UntilSolved(Callback):
    """Callback that records when enough episodes in a row were perfect, and ends the run after the
    largest number."""

    def __init__(self) -> None:
        self.in_a_row = 0
        self.steps: Counter[str] = Counter()
        self.solved: dict[int, dict[str, Any]] = {}
        self.stop = threading.Event()

    def on_episode(self, episode: Episode, progress: Progress) -> None:
        self.steps[episode.robot] += episode.length
        self.in_a_row = self.in_a_row + 1 if episode.return_ == GOAL else 0
        if self.in_a_row in IN_A_ROW and self.in_a_row not in self.solved:
            steps_of_a_robot = max(self.steps.values())
            self.solved[self.in_a_row] = {
                "solved_s": round(episode.seconds, 1),
                "steps_of_a_robot": steps_of_a_robot,
                "steps": episode.steps,
            }
        if self.in_a_row == max(IN_A_ROW):
            self.stop.set()


def race(robots: int, seed: int, episodes: int, realtime: bool) -> dict[str, Any]:
    """Result of one run, which ends soon after it is solved."""
    notes = UntilSolved()
    with tempfile.TemporaryDirectory() as folder:
        config = TrainConfig(
            ENV,
            episodes=episodes,
            robots=robots,
            realtime=realtime,
            seed=seed,
            run_dir=Path(folder) / "run",
        )
        result = train(config, notes, stop=notes.stop)
    solved = {}
    for count in IN_A_ROW:
        result_of_count = notes.solved.get(
            count, {"solved_s": None, "steps_of_a_robot": None, "steps": None}
        )
        solved[str(count)] = result_of_count if realtime else {**result_of_count, "solved_s": None}
    return {
        "seed": seed,
        "in_a_row": solved,
        "episodes": len(result.episodes),
        "updates_per_step": result.updates_per_step,
    }


class Cut(Callback):
    """Callback that cuts the first robot's link after some episodes, and records when it left and
    came back."""

    def __init__(self) -> None:
        self.fleet: Any = None
        self.cut_s: float | None = None
        self.left: list[float] = []
        self.back: list[float] = []
        self.elsewhere = 0
        self.stop = threading.Event()

    def on_env(self, env: Any) -> None:
        self.fleet = env

    def on_robot(self, robot: str, state: RobotState, reason: str) -> None:
        if robot != "virtual-1" or self.cut_s is None:
            return
        since_s = round(time.monotonic() - self.cut_s, 1)
        if state is RobotState.LEFT:
            self.left.append(since_s)
        elif state is RobotState.ACTING and self.left:
            self.back.append(since_s)

    def on_episode(self, episode: Episode, progress: Progress) -> None:
        if episode.episode == CUT_AFTER:
            self.cut_s = time.monotonic()
            self.fleet.tell(self.fleet.members[0], "cut", CUT_S)
        if self.left and not self.back and episode.robot != "virtual-1":
            self.elsewhere += 1
        if self.back and episode.robot == "virtual-1":
            self.stop.set()  # it came back and has played an episode


def with_a_cut(episodes: int) -> dict[str, Any]:
    """Result of a run of four robots, one of which is out of reach for a while."""
    import torch

    from bricksrl.data.reader import load
    from bricksrl.training.checkpoint import load_checkpoint

    notes = Cut()
    with tempfile.TemporaryDirectory() as folder:
        path = Path(folder) / "run"
        result = train(
            TrainConfig(ENV, episodes=episodes, robots=4, realtime=True, run_dir=path),
            notes,
            stop=notes.stop,
        )
        data = load(path / "data")
        memory = load_checkpoint(path / "checkpoint.bin")["agent"]["memory"]
    rows = memory["rows"]
    buffered = Counter(
        map(_key, zip(rows["observation"], rows["action"], rows["next.observation"], strict=True))
    )
    recorded = Counter(
        map(_key, zip(data.observation, data.action, data.next_observation, strict=True))
    )
    ended = sum(episode.length for episode in result.episodes)
    wrong_links = [
        index
        for index, after in enumerate(memory.get("successor", torch.empty(0)).tolist())
        if after < len(rows["action"])
        and not torch.equal(rows["next.observation"][index], rows["observation"][after])
    ]
    return {
        "episodes": len(result.episodes),
        "left_s_after_the_cut": notes.left[:1],
        "back_s_after_the_cut": notes.back[:1],
        "episodes_of_the_others_meanwhile": notes.elsewhere,
        "episodes_by_robot": dict(Counter(row.about.robot for row in data.rows)),
        "frames_of_ended_episodes": ended,
        "frames_in_the_dataset": len(data),
        "frames_in_the_replay_buffer": len(rows["action"]),
        "frames_of_ended_episodes_missing_in_the_dataset": max(0, ended - len(data)),
        "frames_in_the_buffer_that_the_dataset_lacks": (buffered - recorded).total(),
        "frames_linked_with_another_robots": len(wrong_links),
    }


def _key(parts: Any) -> tuple[float, ...]:
    import torch

    return tuple(torch.cat(parts).tolist())


def summary_of(runs: list[dict[str, Any]], count: int) -> dict[str, Any]:
    """Time and steps until ``count`` perfect episodes in a row; with an interval if five or more
    runs were all solved."""
    solved = [run["in_a_row"][str(count)] for run in runs]
    summary: dict[str, Any] = {"solved": sum(run["steps"] is not None for run in solved)}
    for name in ("solved_s", "steps_of_a_robot"):
        values = [run[name] for run in solved if run[name] is not None]
        if values:
            summary[f"{name}_iqm"] = round(float(interquartile_mean(np.array(values))), 1)
        if len(values) >= FEWEST_SEEDS and len(values) == len(runs):
            interval = stratified_bootstrap_interval([values])
            summary[f"{name}_95"] = [round(interval.low, 1), round(interval.high, 1)]
    return summary


def races(session: Session, seeds: int, episodes: int, *, realtime: bool) -> dict[str, Any]:
    """Results of one robot and of four, with all seeds in turn, and the speedup."""
    kind = "realtime" if realtime else "simulated"
    jobs = {
        f"{kind}-{seed}-{robots}-{episodes}": (robots, seed, episodes, realtime)
        for seed in range(seeds)
        for robots in (1, 4)
    }
    outcomes = list(session.outcomes(race, jobs, processes=1))
    results: dict[str, Any] = {}
    for name, runs in (("1_robot", outcomes[::2]), ("4_robots", outcomes[1::2])):
        results[name] = {
            "runs": runs,
            "in_a_row": {str(count): summary_of(runs, count) for count in IN_A_ROW},
        }
    for ratio, value in (
        ("times_as_fast", "solved_s_iqm"),
        ("times_fewer_steps_of_a_robot", "steps_of_a_robot_iqm"),
    ):
        results[ratio] = {}
        for count in map(str, IN_A_ROW):
            one_robot, four_robots = (
                results[name]["in_a_row"][count].get(value) for name in ("1_robot", "4_robots")
            )
            results[ratio][count] = (
                None
                if one_robot is None or four_robots is None
                else round(one_robot / four_robots, 2)
            )
    return results


def main(session: Session) -> None:
    """Measure all and write the results."""
    parser = session.parser
    parser.add_argument("--episodes", type=int, default=60, help="at most, of each run")
    parser.add_argument(
        "--cut-episodes", type=int, default=150, help="at most, of the run with a cut"
    )
    parser.add_argument(
        "--simulated",
        action="store_true",
        help="in simulated time: the steps only, added to the results",
    )
    args = session.parse(seeds=10)
    known = session.known()
    if args.simulated:
        session.write(
            {
                **known,
                "simulated": {
                    **races(session, args.seeds, args.episodes, realtime=False),
                    **describe(),
                },
            }
        )
        return
    results: dict[str, Any] = {
        "environment": ENV,
        "agent": "sac",
        "goal": f"{IN_A_ROW} episodes in a row of {GOAL:g}",
    }
    results |= {name: known[name] for name in ("simulated",) if name in known}
    results |= races(session, args.seeds, args.episodes, realtime=True)
    (results["cut"],) = session.outcomes(
        with_a_cut, {f"cut-{args.cut_episodes}": (args.cut_episodes,)}, processes=1
    )
    print(results["times_as_fast"], results["cut"], flush=True)
    session.write(results)
