"""LeRobot's own commands on the virtual Walker: `lerobot-record` records episodes of it, `lerobot-replay` plays one again.

    python benchmarks/lerobot_commands.py --lerobot PYTHON

PYTHON is that of an environment with LeRobot, this package and its plugin (`plugins/lerobot_robot_bricksrl/README.md` says how to
make one). The commands run as they are, in processes of their own; a note of what the robot was sent and what it then measured is
taken on their way out. Counted are the frames that LeRobot's dataset holds, the actions of the replay that are those of the
recording, and how far the replayed robot was from the recorded one.
"""

from __future__ import annotations

import json
import os
import subprocess
import tempfile
import time
from pathlib import Path
from typing import Any

import pyarrow.parquet as pq
from machine import command, write

FPS, EPISODES, EPISODE_S = 4, 2, 5
LAUNCH = """
import atexit, json, runpy, sys
reader, notes, module = sys.argv[1:4]
runpy.run_path(reader)["declare_operators"]()
from lerobot_robot_bricksrl.robot import BricksRobot
send, sent = BricksRobot.send_action, []
def noted(robot, action):
    done = send(robot, action)
    sent.append({"action": list(done.values()), "observation": list(robot.get_observation().values())})
    return done
BricksRobot.send_action = noted
def write():
    with open(notes, "w") as file:
        json.dump(sent, file)
atexit.register(write)
sys.argv = [module, *sys.argv[4:]]
runpy.run_module(module, run_name="__main__", alter_sys=True)
"""
VERSIONS = "import json; from importlib.metadata import version; print(json.dumps({n: version(n) for n in (%s)}))"
PACKAGES = '"lerobot", "torch", "torchvision", "numpy"'


def run(python: str, folder: Path, name: str, *arguments: str) -> tuple[float, list[dict[str, list[float]]]]:
    """One of LeRobot's commands; seconds on the wall, and what the robot was sent and measured then.

    Raises:
        RuntimeError: it failed.
    """
    reader, notes = Path(__file__).with_name("lerobot_reader.py"), folder / f"{name}.json"
    told = {**os.environ, "HF_HUB_OFFLINE": "1"}
    line = [python, "-I", "-c", LAUNCH, str(reader), str(notes), f"lerobot.scripts.lerobot_{name}", *arguments]
    started_s = time.perf_counter()
    done = subprocess.run(line, check=False, capture_output=True, text=True, env=told)  # noqa: S603  the user's Python
    if done.returncode:
        raise RuntimeError(f"lerobot-{name} ended with code {done.returncode}: {done.stderr[-2000:]}")
    return round(time.perf_counter() - started_s, 1), json.loads(notes.read_text())


def measure(python: str, folder: Path) -> dict[str, Any]:
    """Record and replay."""
    root = folder / "walker"
    robot = ["--robot.type=bricksrl_walker", "--robot.id=w", "--robot.seed=1", f"--robot.calibration_dir={folder}"]
    data = ["--dataset.repo_id=me/walker", f"--dataset.root={root}", "--play_sounds=false"]
    hand = ["--teleop.type=bricksrl_random", "--teleop.id=h", f"--teleop.calibration_dir={folder}"]
    how = ["--dataset.single_task=walk", f"--dataset.fps={FPS}", f"--dataset.num_episodes={EPISODES}"]
    how += [f"--dataset.episode_time_s={EPISODE_S}", "--dataset.reset_time_s=0", "--dataset.push_to_hub=false"]
    record_s, recorded = run(python, folder, "record", *robot, *data, *hand, *how, "--dataset.video=false")
    held = pq.read_table(root / "data", columns=["action", "observation.state", "episode_index"]).to_pylist()
    first = [row for row in held if row["episode_index"] == 0]
    replay_s, replayed = run(python, folder, "replay", *robot, *data, "--dataset.episode=0")
    pairs = [(one["observation"], row["observation.state"]) for one, row in zip(replayed, first[1:], strict=False)]
    apart = [abs(a - b) for ours, theirs in pairs for a, b in zip(ours, theirs, strict=True)]
    return {
        "record": {
            "wall_s": record_s,
            "frames_asked": EPISODES * EPISODE_S * FPS,
            "frames_in_the_dataset": len(held),
            "actions_sent": len(recorded),
        },
        "replay": {
            "wall_s": replay_s,
            "frames_of_the_episode": len(first),
            "actions_sent": len(replayed),
            "actions_as_recorded": sum(
                max(abs(a - b) for a, b in zip(one["action"], row["action"], strict=True)) < 1e-4
                for one, row in zip(replayed, first, strict=False)
            ),
            "observations_compared": len(pairs),
            "largest_difference": max(apart, default=None),
        },
    }


def main() -> None:
    """Record, replay and write the results."""
    parser = command(__doc__)
    parser.add_argument("--lerobot", metavar="PYTHON", required=True, help="the Python of an environment that has LeRobot")
    python = parser.parse_args().lerobot
    answer = subprocess.run([python, "-I", "-c", VERSIONS % PACKAGES], check=True, capture_output=True, text=True)  # noqa: S603
    with tempfile.TemporaryDirectory() as folder:
        measured = measure(python, Path(folder))
    result = {"robot": "bricksrl_walker, virtual", "fps": FPS, **measured, "with": json.loads(answer.stdout)}
    print(json.dumps(result, indent=2), write("lerobot_commands", result))


if __name__ == "__main__":
    main()
