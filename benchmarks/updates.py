"""Cost of an update: our agents, TorchRL's losses, Stable-Baselines3 and SBX, in CPU time and wall
time.

    python -m benchmarks updates [--agents sac td3] [--contestants ours sb3] [--rounds 9]

Every contestant runs in its own process with one thread, and all take turns for ``--rounds``
rounds; medians of the times and of the ratios in each round. An update is one of the critics; DroQ
and REDQ make 20 of them for one of the actor. `contestants` describes each contestant. The time to
the first update includes the imports, and SBX's compilation.
"""

from __future__ import annotations

import importlib.util
import multiprocessing
import os
import statistics
import time
from importlib import metadata
from multiprocessing.connection import Connection
from multiprocessing.process import BaseProcess
from typing import Any

from benchmarks.machine import ONE_THREAD
from benchmarks.session import Session

AGENTS = ("sac", "td3", "droq", "redq", "crossq")
NEEDS = {"sb3": "stable_baselines3", "sbx": "sbx"}


def work(name: str, agent: str, connection: Connection) -> None:
    """A contestant's process: builds its agent, updates once, then at each request; sends the
    times."""
    from benchmarks.contestants import CONTESTANTS, UPDATES

    if hasattr(os, "sched_setaffinity"):
        # what starts threads all the same shares one core with them
        os.sched_setaffinity(0, {min(os.sched_getaffinity(0))})
    update = CONTESTANTS[name][0](agent)
    update()
    connection.send(time.process_time())
    while connection.recv():
        cpu_s, wall_s = time.process_time(), time.perf_counter()
        update()
        spent = time.process_time() - cpu_s, time.perf_counter() - wall_s
        connection.send([1e3 * s / UPDATES for s in spent])


class Contestant:
    """A contestant in its process."""

    def __init__(self, name: str, agent: str) -> None:
        self.name, self.agent = name, agent
        context = multiprocessing.get_context("spawn")
        self._connection, child = context.Pipe()
        started_s = time.perf_counter()
        self._process: BaseProcess = context.Process(
            target=work, args=(name, agent, child), daemon=True
        )
        self._process.start()
        child.close()
        cpu_s = self._connection.recv()
        self.first = {"cpu_s": round(cpu_s, 2), "wall_s": round(time.perf_counter() - started_s, 2)}
        self.rounds: list[tuple[float, float]] = []

    def take_turn(self) -> None:
        """Update, and record CPU and wall milliseconds of one update."""
        self._connection.send(True)
        self.rounds.append(tuple(self._connection.recv()))

    def end(self) -> None:
        """End the process."""
        self._connection.send(False)
        self._process.join(30)

    def summary(self) -> dict[str, Any]:
        """Medians."""
        cpu_ms, wall_ms = (
            round(statistics.median(values), 2) for values in zip(*self.rounds, strict=True)
        )
        return {"cpu_ms": cpu_ms, "wall_ms": wall_ms, "to_first_update": self.first}


def available() -> list[str]:
    """Contestants that can run here; prints why the others cannot."""
    from benchmarks.contestants import CONTESTANTS

    names = []
    for name in CONTESTANTS:
        if name in NEEDS and importlib.util.find_spec(NEEDS[name]) is None:
            print(
                f'{name} is left out: {NEEDS[name]} is missing; pip install "bricksrl[benchmarks]"'
            )
            continue
        names.append(name)
    return names


def race(agent: str, names: list[str], rounds: int) -> dict[str, Any]:
    """Times of all contestants that have the agent, in turns."""
    from benchmarks.contestants import CONTESTANTS

    contestants = [Contestant(name, agent) for name in names if agent in CONTESTANTS[name][1]]
    for _ in range(rounds):
        for contestant in contestants:
            contestant.take_turn()
    for contestant in contestants:
        contestant.end()
    summaries: dict[str, Any] = {
        contestant.name: contestant.summary() for contestant in contestants
    }
    ours = contestants[0].rounds
    for contestant in contestants[1:]:
        for index, unit in enumerate(("cpu", "wall")):
            ratios = [
                other[index] / own[index]
                for other, own in zip(contestant.rounds, ours, strict=True)
            ]
            summaries[contestant.name][f"{unit}_times_ours"] = round(statistics.median(ratios), 2)
    return summaries


def overhead_share(agent: str) -> float:
    """Share of the CPU time of our updates for drawing, relabelling and splitting batches."""
    import torch

    from benchmarks.contestants import UPDATES, learner_of

    torch.set_num_threads(1)
    learner, shares = learner_of(agent), []
    for _ in range(9):
        started_s = time.process_time()
        batches = list(learner.batches(UPDATES))
        drawn_s = time.process_time()
        for batch in batches:
            learner.descent.step(batch)
        shares.append((drawn_s - started_s) / (time.process_time() - started_s))
    return round(statistics.median(shares), 3)


def main(session: Session) -> None:
    """Race all agents and write the medians."""

    parser = session.parser
    parser.add_argument("--agents", nargs="+", default=AGENTS, choices=AGENTS)
    parser.add_argument("--contestants", nargs="+", help="all that can run here, unless given")
    args = session.parse(rounds=9)
    os.environ.update(ONE_THREAD)  # before torch or JAX is loaded, here and in the processes
    from benchmarks.contestants import ACTION, BATCH, HIDDEN, OBSERVATION

    names = [
        name
        for name in available()
        if args.contestants is None or name in ("ours", *args.contestants)
    ]
    agents: dict[str, Any] = {}
    for agent in args.agents:
        agents[agent] = race(agent, names, args.rounds)
        agents[agent]["ours"]["around_an_update"] = overhead_share(agent)
        for name, result in agents[agent].items():
            times = f"{result['cpu_times_ours']} times ours" if "cpu_times_ours" in result else ""
            first = result["to_first_update"]
            print(
                f"{agent:7}{name:15}{result['cpu_ms']:8.2f} ms CPU  {first['wall_s']:7.1f} s to "
                f"the first  {times}",
                flush=True,
            )
    setup = {
        "hidden": HIDDEN,
        "batch_size": BATCH,
        "observation": OBSERVATION,
        "action": ACTION,
        "rounds": args.rounds,
    }
    others = {
        name: metadata.version(name)
        for name in ("stable-baselines3", "sbx-rl", "jax")
        if _installed(name)
    }
    session.write({"setup": setup, "agents": agents, "compared_with": others})


def _installed(name: str) -> bool:
    try:
        metadata.version(name)
    except metadata.PackageNotFoundError:
        return False
    return True
