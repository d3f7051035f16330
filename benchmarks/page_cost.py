"""Cost of the live page for a run in simulated time: CPU time and wall time per step.

    python -m benchmarks page_cost

Walker-v1, the same episodes each time, in turn without a page, with a page without visitors, and
with one that a connection reads all the time (in its own process, which draws nothing). One thread
learns; the page's own thread is included in the CPU time.
"""

from __future__ import annotations

import os
import statistics
import subprocess
import sys
import tempfile
import threading
import time
from pathlib import Path
from typing import Any

from benchmarks.session import Session
from bricksrl.envs import get_task
from bricksrl.page.live import LivePage
from bricksrl.page.play import PageCallback
from bricksrl.training import TrainConfig, train
from bricksrl.training.config import settings_for

ENV = "Walker-v1"
READER = """
import sys, time
from websockets.sync.client import connect
url = sys.argv[1]
host = url.split("/")[2]
socket = connect(f"ws://{host}/ws?{url.partition('?')[2]}", origin=f"http://{host}", compression=None, max_size=None)
poses = total = 0
start = time.monotonic()
try:
    while True:
        message = socket.recv()
        total += len(message)
        poses += isinstance(message, bytes) and message[0] == 1
except Exception:
    print(poses / (time.monotonic() - start), total / (time.monotonic() - start))
"""  # noqa: E501


def run(episodes: int, folder: Path, kind: str) -> dict[str, float]:
    """CPU and wall seconds of a run, and frames and bytes per second of the reader."""
    config = TrainConfig(
        ENV,
        episodes=episodes,
        settings=settings_for(ENV, "default", "sac"),
        run_dir=folder,
        record=False,
    )
    result: dict[str, float] = {}
    if kind == "without":
        cpu_s, wall_s = time.process_time(), time.perf_counter()
        train(config)
        return {"cpu_s": time.process_time() - cpu_s, "wall_s": time.perf_counter() - wall_s}
    stop = threading.Event()
    with LivePage(ENV, task=get_task(ENV), on_stop=stop.set) as page:
        reader = None
        if kind == "watched":
            reader_command = [sys.executable, "-c", READER, page.url]
            # our own arguments
            reader = subprocess.Popen(reader_command, stdout=subprocess.PIPE, text=True)  # noqa: S603
            time.sleep(1.0)
        cpu_s, wall_s = time.process_time(), time.perf_counter()
        train(config, PageCallback(page, stop), driver=page.driver, stop=stop)
        result = {"cpu_s": time.process_time() - cpu_s, "wall_s": time.perf_counter() - wall_s}
    if reader is not None:
        out, _ = reader.communicate(timeout=30)
        result["frames_per_s"], result["bytes_per_s"] = map(float, out.split())
    return result


def main(session: Session) -> None:
    args = session.parse(episodes=4, repeats=5)
    os.environ["OMP_NUM_THREADS"] = "1"
    kinds = ("without", "unwatched", "watched")
    runs: dict[str, list[dict[str, float]]] = {kind: [] for kind in kinds}
    with tempfile.TemporaryDirectory() as folder:
        run(2, Path(folder) / "warm", "without")
        for repeat in range(args.repeats):
            for kind in kinds:
                runs[kind].append(run(args.episodes, Path(folder) / f"{kind}{repeat}", kind))
    base = statistics.median(run_times["cpu_s"] for run_times in runs["without"])
    results: dict[str, Any] = {"env": ENV, "episodes": args.episodes, "repeats": args.repeats}
    for kind in kinds:
        median = {
            name: statistics.median(run_times[name] for run_times in runs[kind])
            for name in runs[kind][0]
        }
        results[kind] = {
            **{name: round(value, 3) for name, value in median.items()},
            "cpu_ratio": round(median["cpu_s"] / base, 3),
        }
        print(kind, results[kind])
    session.write(results)
