"""Training of several seeds: one program with stacked networks, compared with parallel processes.

    python -m benchmarks seeds

Part one: updates of three networks of two layers of 256 (two critics and an actor, as in SAC) on
batches of 256, for five seeds: one after the other, and as one batched matrix product for all; on
one thread and on all. The products are most of an update. Part two: five seeds of SAC on
`WalkerSim-v0`, each in a process, as many in parallel as there are cores, and one at a time.
"""

from __future__ import annotations

import os
import statistics
import tempfile
import time
from collections.abc import Callable
from pathlib import Path
from typing import Any

import torch
from torch import Tensor

from benchmarks.session import Session
from bricksrl.evaluation.multi_seed import train_seeds
from bricksrl.training import TrainConfig

SEEDS, NETWORKS, INPUTS, HIDDEN, BATCH = 5, 3, 12, 256, 256
ROUNDS, UPDATES = 7, 10


def updates_of(stacked: int) -> Callable[[], None]:
    """``UPDATES`` updates of ``stacked`` networks."""
    shapes = [(stacked, a, b) for a, b in ((INPUTS, HIDDEN), (HIDDEN, HIDDEN), (HIDDEN, 1))]
    weights = [(torch.randn(shape) / shape[1] ** 0.5).requires_grad_() for shape in shapes]
    optimiser = torch.optim.Adam(weights, fused=True)
    inputs, target = torch.randn(stacked, BATCH, INPUTS), torch.randn(stacked, BATCH, 1)

    def forward() -> Tensor:
        x = inputs
        for weight in weights[:-1]:
            x = torch.bmm(x, weight).relu()
        return torch.bmm(x, weights[-1])

    def update() -> None:
        for _ in range(UPDATES):
            loss = (forward() - target).square().mean((1, 2)).sum()
            optimiser.zero_grad()
            torch.autograd.backward(loss)
            optimiser.step()

    return update


def stacked_or_not(threads: int) -> dict[str, float]:
    """Wall milliseconds of an update of all seeds: one after the other, and stacked."""
    torch.set_num_threads(threads)
    singles, together = [updates_of(NETWORKS) for _ in range(SEEDS)], updates_of(SEEDS * NETWORKS)
    times_ms: dict[str, list[float]] = {"one_after_the_other_ms": [], "stacked_ms": []}
    for _ in range(ROUNDS):
        for name, work in (("one_after_the_other_ms", singles), ("stacked_ms", [together])):
            started_s = time.perf_counter()
            for update in work:
                update()
            times_ms[name].append((time.perf_counter() - started_s) * 1e3 / UPDATES)
    return {name: round(statistics.median(values), 2) for name, values in times_ms.items()}


def processes(jobs: int, episodes: int) -> float:
    """Wall seconds for all seeds."""
    with tempfile.TemporaryDirectory() as folder:
        config = TrainConfig(
            "WalkerSim-v0", episodes=episodes, record=False, run_dir=Path(folder) / "all"
        )
        started_s = time.perf_counter()
        train_seeds(config, SEEDS, jobs=jobs)
        return time.perf_counter() - started_s


def main(session: Session) -> None:
    """Measure both and write the results."""
    args = session.parse(episodes=10)
    cores = os.cpu_count() or 1
    updates: dict[str, Any] = {
        f"{threads}_threads": stacked_or_not(threads) for threads in sorted({1, cores})
    }
    wall_s = {
        f"{jobs}_at_a_time_s": round(processes(jobs, args.episodes), 1)
        for jobs in sorted({1, cores})
    }
    setup = {
        "seeds": SEEDS,
        "networks": NETWORKS,
        "hidden": HIDDEN,
        "batch_size": BATCH,
        "episodes": args.episodes,
    }
    print(updates, wall_s)
    session.write({"setup": setup, "updates": updates, "processes": wall_s})
