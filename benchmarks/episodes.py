"""Recorded episodes of the virtual robots, in 3D to turn: pages of the documentation that need no
server.

    python -m benchmarks episodes [ENV ...]

Records the first seconds of the best policy that each environment has, or of its controller: the
poses of all drawn bodies, 20 times a second, in ``docs/episodes/<environment>.json``. The
documentation's build adds the drawing and the live page's own viewer, and writes a page for each
(:func:`page_of`).
"""

from __future__ import annotations

import base64
import gzip
import json
from contextlib import closing
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np

import bricksrl
from benchmarks.session import Session
from bricksrl.envs.registry import get_task, is_simulation, list_envs
from bricksrl.errors import RunError
from bricktwin.twin.mujoco_body import MujocoBody
from bricktwin.twin.physics import Physics
from bricktwin.view.mirror import Mirror
from bricktwin.view.script import one_script

if TYPE_CHECKING:
    from tensordict import TensorDictBase

    from bricksrl.envs.task import Task

ROOT = Path(__file__).parents[1]
FOLDER = ROOT / "docs" / "episodes"
PERIOD_MS, LONGEST_MS = 50, 12_000
EPISODES = {"RoboArm-v0": 3, "RoboArm_mixed-v0": 3}
"""Of an environment, where one is short."""
MAX_BYTES = 300_000


class Shots:
    """Pace of a virtual hub that keeps the robot's poses, and waits for nothing."""

    def __init__(self, env: Any) -> None:
        self._body, self._mirror, self._due_ms = env.twin.body, mirror_of(env.task), 0.0
        self.goal: Any = None
        self.poses: list[Any] = []

    def wall_ms(self) -> float:
        return 0.0

    def keep(self, time_ms: float) -> None:
        if time_ms >= self._due_ms:
            self._due_ms = time_ms + PERIOD_MS
            self.poses.append(self._mirror.poses(self._body.data.qpos, self.goal))


def mirror_of(task: Task) -> Mirror:
    return Mirror(MujocoBody(task.robot, task.scene, Physics(), 0))


def packed(data: bytes) -> str:
    """Bytes, compressed, as text."""
    return base64.b64encode(gzip.compress(data, 9, mtime=0)).decode()


def record(env_id: str) -> dict[str, Any]:
    """The poses of the beginning of an episode, or of some short ones."""
    import torch

    from bricksrl.policies.by_name import array_policies

    with closing(bricksrl.make(env_id, seed=0)) as env:
        name, make_policy = list(array_policies(env_id, env.task, 0).items())[-1]
        policy, shots = make_policy(), Shots(env)

        # by its argument TorchRL knows a policy
        def act(tensordict: TensorDictBase) -> TensorDictBase:
            shots.goal = env.task.goal(tensordict["observation"].tolist())
            arrays = {
                key: tensordict[key].numpy().copy()
                for key in {"observation", "image"} & set(tensordict.keys())
            }
            return tensordict.set("action", torch.as_tensor(policy(arrays), dtype=torch.float32))

        for _ in range(EPISODES.get(env_id, 1)):
            start = env.reset()
            shots.goal = env.task.goal(start["observation"].tolist())
            env.twin.machine.pace = shots
            env.rollout(env.task.max_steps, act, auto_reset=False, tensordict=start)
    poses = np.round(np.array(shots.poses[: LONGEST_MS // PERIOD_MS], "<f4"), 4)
    return {
        "env": env_id,
        "policy": name,
        "period_ms": PERIOD_MS,
        "frames": len(poses),
        "poses": packed(poses.tobytes()),
    }


def page_of(path: Path) -> str:
    """HTML page of a recorded episode, with all that it needs. Raises RunError if its robot has
    other bodies now."""
    episode = json.loads(path.read_text(encoding="utf-8"))
    drawing = mirror_of(get_task(episode["env"])).drawing
    if (
        len(gzip.decompress(base64.b64decode(episode["poses"])))
        != 28 * len(drawing.bodies) * episode["frames"]
    ):
        raise RunError(
            f"{path} shows other bodies than {episode['env']}; record it again by `python -m "
            "benchmarks episodes`"
        )
    described = json.dumps(drawing.described()).encode()
    parts = {
        "TITLE": f"{episode['env']}: an episode to turn",
        "VIEWER": one_script("scene3d.js"),
        "EPISODE": json.dumps({**episode, "drawing": packed(described)}),
    }
    text = (FOLDER / "viewer.html").read_text(encoding="utf-8")
    for name, part in parts.items():
        text = text.replace(name, part)
    return text


def main(session: Session) -> None:
    """Record them."""
    names = [env_id for env_id in list_envs() if not is_simulation(env_id)]
    session.parser.add_argument("envs", nargs="*", default=names, metavar="ENV")
    folder = session.place_of(FOLDER)
    for env_id in session.parse().envs:
        path = folder / f"{env_id}.json"
        path.write_text(json.dumps(record(env_id)) + "\n", encoding="utf-8")
        print(f"{path}: {path.stat().st_size / 1000:.0f} kB", flush=True)
        if path.stat().st_size > MAX_BYTES:
            raise RunError(f"{path} is larger than {MAX_BYTES:,} bytes; record a shorter time")
