"""Peak memory of a short training run, and of an agent with a full replay buffer.

    python -m benchmarks memory

Each runs in its own process; MiB of resident memory. A full buffer has a million transitions, and
is saved once.
"""

from __future__ import annotations

import multiprocessing
import sys
import tempfile
from collections.abc import Callable
from multiprocessing.connection import Connection
from pathlib import Path

from benchmarks.session import Session

ENV = "WalkerSim-v0"


def short_run() -> None:
    """Three episodes with the last checkpoint."""
    from bricksrl.training import TrainConfig, train

    with tempfile.TemporaryDirectory() as folder:
        train(TrainConfig(ENV, "sac", 3, run_dir=Path(folder) / "run"))


def full_buffer() -> None:
    """A full default buffer, an update from it, and its checkpoint."""
    import torch

    import bricksrl
    from bricksrl.agents import make_learner
    from bricksrl.training.checkpoint import save_checkpoint

    env = bricksrl.make(ENV)
    learner = make_learner("sac", env)
    step = env.rand_step(env.reset())
    frames = step.expand(100).clone()
    frames["next", "done"][-1] = True
    for _ in range(10_000):
        learner.remember(frames)
    learner.make_updates(1)
    with tempfile.TemporaryDirectory() as folder:
        save_checkpoint(
            Path(folder) / "checkpoint.bin",
            {"agent": learner.state_dict(), "generator": torch.get_rng_state()},
        )


def peak(work: Callable[[], None], connection: Connection) -> None:
    """Run ``work``, and send the peak of resident memory in MiB."""
    import resource  # Windows has none

    work()
    unit = 1 if sys.platform == "darwin" else 1024
    connection.send(resource.getrusage(resource.RUSAGE_SELF).ru_maxrss * unit / 2**20)


def main(session: Session) -> None:
    """Measure both and write them."""
    session.parse()
    context = multiprocessing.get_context("spawn")
    peaks: dict[str, int] = {}
    for work in (short_run, full_buffer):
        receiver, sender = context.Pipe()
        process = context.Process(target=peak, args=(work, sender))
        process.start()
        peaks[f"{work.__name__}_mib"] = round(receiver.recv())
        process.join()
        print(work.__name__, peaks[f"{work.__name__}_mib"], "MiB", flush=True)
    session.write({"environment": ENV, "peak": peaks})
