"""Recordings after their process was killed with SIGKILL at random moments.

    python -m benchmarks record_kill --kills 200 [--lerobot PYTHON]

A process records episodes of known content and reports each commit. It is killed, the dataset is
read and compared, and another process continues recording into the same folder:
``KILLS_PER_FOLDER`` kills per folder, every second folder with images. An episode is lost if its
commit was reported and it is missing or differs. The dataset is read with our reader, with pyarrow
alone, and with LeRobot if it is installed.
"""

from __future__ import annotations

import json
import os
import random
import subprocess
import sys
import tempfile
import time
from contextlib import nullcontext
from pathlib import Path
from types import TracebackType
from typing import TYPE_CHECKING, Any

import numpy as np

from brickhub.entry import Entry
from bricksrl.data import About, Step
from bricksrl.data.schema import Description

if TYPE_CHECKING:
    from benchmarks.session import Session

KILLS_PER_FOLDER = 20
LONGEST_S = 0.15
"""Longest delay of a kill; recording an episode takes about as long."""
STEPS = 20
_CHANNELS = (Entry("angle", 0.0, 360.0, "deg", wraps=True), Entry("distance", unit="mm"))
BLIND = Description(
    "Toy-v0", 4.0, _CHANNELS, (Entry("motor", -100.0, 100.0, "deg"),), {"name": "toy"}
)
SEEING = Description(
    BLIND.env, 4.0, _CHANNELS, BLIND.action, BLIND.robot, camera="webcam", image_px=32
)


def steps(number: int, side: int) -> list[Step]:
    """Steps of episode ``number``, which depend on the number only."""
    rng = np.random.default_rng(number)
    states = rng.normal(size=(STEPS + 1, 2)).astype(np.float32)
    images = rng.integers(0, 256, (STEPS + 1, side, side, 3), dtype=np.uint8)
    return [
        Step(
            observation=states[i],
            action=states[i, :1],
            reward=float(number),
            next_observation=states[i + 1],
            terminated=False,
            truncated=i == STEPS - 1,
            image=images[i] if side else None,
            next_image=images[i + 1] if side else None,
        )
        for i in range(STEPS)
    ]


def record(root: Path, description: Description) -> None:
    """Record endlessly; print the number of committed episodes when ready and after each commit."""
    from bricksrl.data.recorder import Recorder

    with Recorder(root, description) as recorder:
        while True:
            print(len(recorder.rows), flush=True)
            recorder.write(steps(len(recorder.rows), description.image_px), About(policy="known"))


def killed_after(root: Path, kind: str, commits: int, delay_s: float) -> int:
    """Start a recording, kill it ``delay_s`` after so many commits; returns the last reported
    number of episodes."""
    command = [sys.executable, __file__, str(root), kind]
    with subprocess.Popen(command, stdout=subprocess.PIPE, text=True) as process:  # noqa: S603
        assert process.stdout is not None
        output = "".join(process.stdout.readline() for _ in range(1 + commits))
        if not output.endswith("\n"):
            raise RuntimeError("the recording process ended by itself")
        time.sleep(delay_s)
        process.kill()
        # the last line counts only if it is whole
        lines = (output + process.stdout.read()).split("\n")[:-1]
    return int(lines[-1])


def opened(root: Path, committed: int) -> dict[str, Any]:
    """Numbers of episodes, of lost ones and of unreported ones, and whether pyarrow reads the
    dataset."""
    if not committed and not (root / "meta/info.json").exists():
        return {"episodes": 0, "lost": 0, "beyond": 0, "pyarrow": True}
    import pyarrow.dataset
    import pyarrow.parquet

    from bricksrl.data import load

    data = load(root)
    wrong = 0
    for number in range(len(data.rows)):
        expected, mask = steps(number, data.description.image_px), data.episode == number
        same = [
            np.array_equal(
                data.observation[mask],
                np.stack([np.asarray(step.observation) for step in expected]),
            )
        ]
        same.append(bool((data.reward[mask] == number).all()))
        if data.image is not None and data.next_image is not None:
            same.append(
                np.array_equal(
                    data.image[mask],
                    np.stack([step.image for step in expected if step.image is not None]),
                )
            )
            same.append(
                np.array_equal(data.next_image[mask][-1], np.asarray(expected[-1].next_image))
            )
        wrong += not all(same)
    table = pyarrow.dataset.dataset(root / "data").to_table()
    rows = sum(
        pyarrow.parquet.read_table(path).num_rows
        for path in (root / "meta/episodes").rglob("*.parquet")
    )
    return {
        "episodes": len(data.rows),
        "lost": wrong + max(0, committed - len(data.rows)),
        "beyond": len(data.rows) - committed,
        "pyarrow": table.num_rows >= len(data) and rows >= len(data.rows),
    }


class LeRobot:
    """LeRobot's reader, in a process of the Python where it is installed."""

    def __init__(self, python: str) -> None:
        # our modules are not its
        command = [python, "-I", str(Path(__file__).with_name("lerobot_reader.py"))]
        environment = {**os.environ, "HF_HUB_OFFLINE": "1"}
        self._process = subprocess.Popen(  # noqa: S603
            command, stdin=subprocess.PIPE, stdout=subprocess.PIPE, text=True, env=environment
        )
        self.versions = self._answer()
        self.errors: list[str] = []

    def __enter__(self) -> LeRobot:
        return self

    def __exit__(
        self,
        exc_type: type[BaseException] | None,
        error: BaseException | None,
        trace: TracebackType | None,
    ) -> None:
        self._process.communicate(timeout=30)

    def opens(self, root: Path, committed: int) -> bool:
        """Whether it reads all committed episodes, and each as it was recorded."""
        episodes = self.read(root)
        if episodes is None:
            return False
        side = SEEING.image_px if episodes and "image" in episodes[0] else 0
        same = all(episode == recorded(number, side) for number, episode in enumerate(episodes))
        return same and len(episodes) >= committed

    def read(self, root: Path) -> list[dict[str, str]] | None:
        """Digests of all episodes of a dataset; ``None`` if it cannot be read, or counts others
        than it reads."""
        assert self._process.stdin is not None
        self._process.stdin.write(f"{root}\n")
        self._process.stdin.flush()
        answer = self._answer()
        if "error" in answer:
            self.errors.append(answer["error"])
            return None
        episodes: list[dict[str, str]] = answer["episodes"]
        return episodes if len(episodes) == answer["counted"] else None

    def _answer(self) -> dict[str, Any]:
        assert self._process.stdout is not None
        line = self._process.stdout.readline()
        if not line:
            raise RuntimeError("LeRobot's process ended; its output is above")
        answer: dict[str, Any] = json.loads(line)
        return answer


def recorded(number: int, side: int) -> dict[str, str]:
    """Expected answer of LeRobot's reader for episode ``number``."""
    from benchmarks.lerobot_reader import digest

    expected = steps(number, side)
    digests = {
        "observation.state": digest(np.stack([np.asarray(step.observation) for step in expected])),
        "action": digest(np.stack([np.asarray(step.action)[0] for step in expected])),
        "next.reward": digest(np.array([step.reward for step in expected], np.float32)),
    }
    if side:
        digests["image"] = digest(
            np.stack([step.image for step in expected if step.image is not None])
        )
    return digests


def measure(kills: int, seed: int, lerobot: LeRobot | None) -> dict[str, Any]:
    """Results of ``kills`` kills at moments drawn from ``seed``."""
    rng = random.Random(seed)
    results: list[dict[str, Any]] = []
    with tempfile.TemporaryDirectory() as folder:
        for kill in range(kills):
            series = kill // KILLS_PER_FOLDER
            root, kind = Path(folder) / str(series), ("blind", "seeing")[series % 2]
            committed = killed_after(root, kind, rng.randrange(3), rng.uniform(0.0, LONGEST_S))
            results.append(opened(root, committed))
            exists = (root / "meta/info.json").exists()
            results[-1]["lerobot"] = lerobot is not None and (
                not exists or lerobot.opens(root, committed)
            )
            if not (kill + 1) % KILLS_PER_FOLDER:
                print(
                    f"{kill + 1} kills, {sum(r['lost'] for r in results)} episodes lost", flush=True
                )
    return {
        "kills": kills,
        "seed": seed,
        "recorded_episodes": sum(
            r["episodes"]
            for i, r in enumerate(results)
            if (i + 1) % KILLS_PER_FOLDER == 0 or i + 1 == kills
        ),
        "lost_committed_episodes": sum(r["lost"] for r in results),
        "kills_after_which_our_reader_opened_it": len(results),
        "kills_after_which_pyarrow_opened_it": sum(r["pyarrow"] for r in results),
        "kills_between_the_last_word_and_the_index": sum(r["beyond"] > 0 for r in results),
        **(_of(lerobot, results) if lerobot else {}),
    }


def _of(lerobot: LeRobot, results: list[dict[str, Any]]) -> dict[str, Any]:
    return {
        "kills_after_which_lerobot_opened_it": sum(r["lerobot"] for r in results),
        "errors_of_lerobot": sorted(set(lerobot.errors)),
        "lerobot": lerobot.versions,
    }


def main(session: Session) -> None:
    """Run from the command line."""
    parser = session.parser
    parser.add_argument(
        "--lerobot", metavar="PYTHON", help="the Python of an environment that has LeRobot"
    )
    args = session.parse(kills=200, seed=0)
    with LeRobot(args.lerobot) if args.lerobot else nullcontext() as lerobot:
        session.write(measure(args.kills, args.seed, lerobot))


if __name__ == "__main__":  # the process that is killed
    record(Path(sys.argv[1]), BLIND if sys.argv[2] == "blind" else SEEING)
