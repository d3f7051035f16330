"""LeRobot's commands on virtual robots: record and replay the Walker; record the RoboArm, train
policies, record with them.

    python -m benchmarks lerobot_commands --lerobot PYTHON

PYTHON is the interpreter of an environment with LeRobot, this package and its plugin (see
`plugins/lerobot_robot_bricksrl/README.md`). The commands run unchanged, in their own processes,
which log the actions sent to the robot and the following observations. The result has the number of
frames in LeRobot's dataset, the number of replayed actions that equal the recorded ones, and the
largest difference of the replayed observations. LeRobot's ACT and diffusion policy need images, so
they drive the arm of `RoboArm_mixed-v0`, which has a camera. Networks are tiny and steps few: no
task is learned.
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

from benchmarks.session import Session

FPS, EPISODES, EPISODE_S = 4, 2, 5
WALKER = ("--robot.type=bricksrl_walker", "--robot.id=w", "--robot.seed=1")
ARM = ("--robot.type=bricksrl", "--robot.env=RoboArm_mixed-v0", "--robot.id=a", "--robot.seed=1")
STEPS, CLOSE = 20, 1e-4
TRAIN = (
    f"--steps={STEPS}",
    "--batch_size=8",
    "--num_workers=0",
    "--seed=1",
    "--policy.device=cpu",
    "--policy.push_to_hub=false",
)
POLICIES = {
    "act": (
        *(
            "--policy.pretrained_backbone_weights=null",
            "--policy.chunk_size=4",
            "--policy.n_action_steps=4",
        ),
        *(
            "--policy.n_heads=2",
            "--policy.dim_model=32",
            "--policy.dim_feedforward=64",
            "--policy.n_encoder_layers=1",
        ),
        *("--policy.n_vae_encoder_layers=1", "--policy.latent_dim=4"),
    ),
    "diffusion": (
        *(
            "--policy.horizon=8",
            "--policy.n_action_steps=4",
            "--policy.drop_n_last_frames=3",
            "--policy.down_dims=[16,32]",
        ),
        *(
            "--policy.diffusion_step_embed_dim=16",
            "--policy.num_train_timesteps=10",
            "--policy.spatial_softmax_num_keypoints=8",
        ),
    ),
}
LAUNCH = """
import atexit, json, runpy, sys
reader, notes, module = sys.argv[1:4]
runpy.run_path(reader)["declare_operators"]()
from lerobot_robot_bricksrl.robot import BricksRobot
send, sent = BricksRobot.send_action, []
def noted(robot, action):
    done = send(robot, action)
    seen = [value for value in robot.get_observation().values() if isinstance(value, float)]
    sent.append({"action": list(done.values()), "observation": seen})
    return done
BricksRobot.send_action = noted
def write():
    with open(notes, "w") as file:
        json.dump(sent, file)
atexit.register(write)
sys.argv = [module, *sys.argv[4:]]
runpy.run_module(module, run_name="__main__", alter_sys=True)
"""
READER = Path(__file__).with_name("lerobot_reader.py")
VERSIONS = (
    "import json; from importlib.metadata import version; print(json.dumps({n: version(n) "
    "for n in (%s)}))"
)
PACKAGES = '"lerobot", "torch", "torchvision", "numpy"'
Noted = list[dict[str, list[float]]]


def run(python: str, folder: Path, name: str, *arguments: str) -> tuple[float, Noted]:
    """Run one of LeRobot's commands; returns the wall time in seconds, and the logged actions and
    observations.

    Raises:
        RuntimeError: it failed.
    """
    notes = folder / f"{name}.json"
    variables = {**os.environ, "HF_HUB_OFFLINE": "1", "HF_LEROBOT_HOME": str(folder)}
    line = [
        python,
        "-I",
        "-c",
        LAUNCH,
        str(READER),
        str(notes),
        f"lerobot.scripts.lerobot_{name}",
        *arguments,
    ]
    started_s = time.perf_counter()
    # the user's Python
    process = subprocess.run(line, check=False, capture_output=True, text=True, env=variables)  # noqa: S603
    if process.returncode:
        raise RuntimeError(
            f"lerobot-{name} ended with code {process.returncode}: {process.stderr[-2000:]}"
        )
    return round(time.perf_counter() - started_s, 1), json.loads(notes.read_text(encoding="utf-8"))


def record(
    python: str, root: Path, *arguments: str, episodes: int = EPISODES
) -> tuple[dict[str, Any], Noted, list[Any]]:
    """Record episodes into the folder ``root``; returns counts, the logged actions, and the frames
    of the dataset."""
    args = [
        "--dataset.single_task=move",
        f"--dataset.fps={FPS}",
        f"--dataset.num_episodes={episodes}",
        "--dataset.vcodec=h264",
    ]
    args += [
        f"--dataset.episode_time_s={EPISODE_S}",
        "--dataset.reset_time_s=0",
        "--dataset.push_to_hub=false",
    ]
    wall_s, sent = run(
        python, root.parent, "record", *data(root), "--play_sounds=false", *args, *arguments
    )
    rows = pq.read_table(
        root / "data", columns=["action", "observation.state", "episode_index"]
    ).to_pylist()
    counts = {
        "wall_s": wall_s,
        "frames_asked": episodes * EPISODE_S * FPS,
        "frames_in_the_dataset": len(rows),
    }
    return {**counts, "actions_sent": len(sent)}, sent, rows


def data(root: Path) -> list[str]:
    """Arguments of LeRobot's commands for the dataset in the folder ``root``."""
    return [f"--dataset.repo_id=me/{root.name}", f"--dataset.root={root}"]


def random_teleoperator(env: str) -> list[str]:
    """Arguments for random teleoperation of an environment."""
    return ["--teleop.type=bricksrl_random", "--teleop.id=h", f"--teleop.env={env}"]


def matching_actions(sent: Noted, rows: list[Any]) -> int:
    """Number of logged actions that equal those of the dataset."""
    pairs = zip(sent, rows, strict=False)
    return sum(
        max(abs(a - b) for a, b in zip(note["action"], row["action"], strict=True)) < CLOSE
        for note, row in pairs
    )


def replay(python: str, folder: Path) -> dict[str, Any]:
    """Record the Walker and replay it."""
    root = folder / "walker"
    recorded, _, rows = record(python, root, *WALKER, *random_teleoperator("Walker-v0"))
    first = [row for row in rows if row["episode_index"] == 0]
    wall_s, replayed = run(
        python, folder, "replay", *WALKER, *data(root), "--play_sounds=false", "--dataset.episode=0"
    )
    pairs = [
        (note["observation"], row["observation.state"])
        for note, row in zip(replayed, first[1:], strict=False)
    ]
    differences = [abs(a - b) for ours, theirs in pairs for a, b in zip(ours, theirs, strict=True)]
    return {
        "record": recorded,
        "replay": {
            "wall_s": wall_s,
            "frames_of_the_episode": len(first),
            "actions_sent": len(replayed),
            "actions_as_recorded": matching_actions(replayed, first),
            "observations_compared": len(pairs),
            "largest_difference": max(differences, default=None),
        },
    }


def policies(python: str, folder: Path) -> dict[str, Any]:
    """Record the RoboArm with its camera, train each policy on that, and record an episode of the
    policy."""
    root = folder / "arm"
    recorded, _, rows = record(python, root, *ARM, *random_teleoperator("RoboArm_mixed-v0"))
    ranges = [
        (min(values) - CLOSE, max(values) + CLOSE)
        for values in zip(*(row["action"] for row in rows), strict=True)
    ]
    results = {"record": recorded}
    for name, networks in POLICIES.items():
        out, driven = folder / name, folder / f"eval_{name}"
        policy_type = f"--policy.type={name}"
        train_s, _ = run(
            python,
            folder,
            "train",
            *data(root),
            *TRAIN,
            policy_type,
            *networks,
            f"--output_dir={out}",
        )
        trained = f"--policy.path={out / 'checkpoints' / 'last' / 'pretrained_model'}"
        counts, sent, driven_rows = record(python, driven, *ARM, trained, episodes=1)
        in_range = [
            all(low < a < high for a, (low, high) in zip(note["action"], ranges, strict=True))
            for note in sent
        ]
        results[f"train_{name}"] = {"wall_s": train_s, "steps": STEPS}
        results[f"record_by_{name}"] = {
            **counts,
            "actions_as_the_policy_chose": matching_actions(sent, driven_rows),
            "actions_in_the_range_of_the_recording": sum(in_range),
            "different_actions": len({tuple(note["action"]) for note in sent}),
            "episodes_that_lerobot_reads": read(python, driven),
        }
    return results


def read(python: str, root: Path) -> int:
    """Number of episodes that LeRobot's own reader reads completely.

    Raises:
        RuntimeError: it reads none.
    """
    line = [python, "-I", str(READER)]
    process = subprocess.run(line, input=f"{root}\n", check=True, capture_output=True, text=True)  # noqa: S603
    answer = json.loads(process.stdout.splitlines()[-1])
    if "error" in answer:
        raise RuntimeError(f"LeRobot's reader: {answer['error']}")
    return len(answer["episodes"])


def main(session: Session) -> None:
    """Run them and write the results."""
    parser = session.parser
    parser.add_argument(
        "--lerobot",
        metavar="PYTHON",
        required=True,
        help="the Python of an environment that has LeRobot",
    )
    python = session.parse().lerobot
    process = subprocess.run(  # noqa: S603
        [python, "-I", "-c", VERSIONS % PACKAGES], check=True, capture_output=True, text=True
    )
    with tempfile.TemporaryDirectory() as folder:
        walker, arm = replay(python, Path(folder)), policies(python, Path(folder))
    measured = {"bricksrl_walker": walker, "RoboArm_mixed-v0": arm}
    result = {"robots": "virtual", "fps": FPS, **measured, "with": json.loads(process.stdout)}
    session.write(result)
