"""Oracles of a change that must change nothing: digests of models, hub programs and motion logs,
and returns to the last digit.

    python -m benchmarks oracles --folder DIR                  # before the change
    python -m benchmarks oracles --folder NEW --before DIR     # after it: each difference

The second one ends with exit code 1 if there is a difference.

On one computer, because torch's kernels differ between processors. Where models are kept in a
cache, run it twice: the first run builds them, the second loads them. Takes about four CPU minutes;
``--only 'model *'`` makes a part, by name.
"""

from __future__ import annotations

import contextlib
import fnmatch
import functools
import hashlib
import io
import json
import os
import tempfile
from collections.abc import Callable, Iterator
from pathlib import Path
from typing import Any

from benchmarks.machine import ONE_THREAD
from benchmarks.session import Session, read_result

os.environ.update(ONE_THREAD)

import mujoco
import numpy as np
import torch

from brickhub.hub.program.generate import generate
from brickhub.hub.transport import Pipe
from brickhub.target import whole_interface
from bricksrl.cli import main as bricksrl
from bricksrl.envs import get_task, list_envs
from bricksrl.envs.arenas import ARENAS, get_arena_task
from bricksrl.training import TrainConfig, resume, train
from bricksrl.training.checkpoint import load_checkpoint
from bricktwin.robots import ROBOTS
from bricktwin.twin.make_body import lies_on_bench, make_body
from bricktwin.twin.mujoco_arena import ArenaWorld
from bricktwin.twin.scene import OPEN_FLOOR

EPISODES = {
    "RunAway-v0": 40,
    "WalkerSim-v0": 20,
    "Walker-v1": 20,
    "Park-v0": 20,
    "LineFollow-v0": 20,
}
"""Episodes of SAC with seed 0. One is random; the robots have learned most after these."""
RESUMED = "RunAway-v0"
"""Environment of the run that stops half way."""

Oracle = Callable[[], Any]


def oracles() -> Iterator[tuple[str, Oracle]]:
    """Models of robots on an open floor, of each environment's scene and of each arena; hub
    programs; motion logs; runs."""
    scenes: dict[Any, str] = {(robot, OPEN_FLOOR): robot.name for robot in ROBOTS.values()}
    interfaces = {
        robot.name: (robot, whole_interface(robot))
        for robot in ROBOTS.values()
        if robot.hub.model.runs_programs
    }
    for env_id in list_envs():
        task = get_task(env_id)
        scenes.setdefault((task.robot, task.scene), env_id)
        interfaces[env_id] = task.robot, task.interface
    for (robot, scene), name in scenes.items():
        if not lies_on_bench(robot, scene):
            yield f"model {name}", functools.partial(_body, robot, scene)
    for arena_id in ARENAS:
        arena = get_arena_task(arena_id)
        yield f"model {arena_id}", functools.partial(_arena, arena)
        for contestant, interface in zip(arena.arena.robots, arena.interfaces, strict=True):
            interfaces[f"{arena_id} {contestant.name}"] = contestant.robot, interface
    for name, (robot, interface) in interfaces.items():
        yield f"program {name}", functools.partial(_program, robot, interface)
    for name, robot in ROBOTS.items():
        if robot.hub.model.runs_programs:
            yield f"motion log {name}", functools.partial(_motion_log, name)
    for env_id, episodes in EPISODES.items():
        yield f"learning {env_id}", functools.partial(_learned, env_id, episodes)
    yield f"resumed {RESUMED}", functools.partial(_learned, RESUMED, EPISODES[RESUMED] // 2)


def digest(*parts: bytes) -> str:
    """First 16 digits of the SHA-256."""
    return hashlib.sha256(b"".join(parts)).hexdigest()[:16]


def _body(robot: Any, scene: Any) -> str:
    body: Any = make_body(robot, scene=scene, seed=0)
    return _model(body.model, body.data)


def _arena(task: Any) -> str:
    world = ArenaWorld(task.arena)
    return _model(world.engine.model, world.engine.data)


def _model(model: Any, data: Any) -> str:
    """Digest of a compiled model and of where its robots start."""
    binary = np.empty(mujoco.mj_sizeModel(model), np.uint8)
    mujoco.mj_saveModel(model, None, binary)
    return digest(binary.tobytes(), data.qpos.tobytes())


def _program(robot: Any, interface: Any) -> list[int]:
    return [generate(robot, interface, pipe).hash for pipe in Pipe]


def _motion_log(robot: str) -> str:
    """The file of `bricksrl twin record`, on the virtual hub."""
    with tempfile.TemporaryDirectory() as folder, contextlib.redirect_stdout(io.StringIO()):
        path = Path(folder) / "log.jsonl"
        if bricksrl(["twin", "record", robot, "--out", str(path)]):
            raise SystemExit(f"error: `bricksrl twin record {robot}` failed")
        return digest(path.read_bytes())


def _learned(env_id: str, first: int) -> dict[str, Any]:
    """Returns and last losses with all digits, and a digest of the policy; the run is resumed after
    ``first`` episodes."""
    with tempfile.TemporaryDirectory() as folder:
        run_dir = Path(folder) / "run"
        result = train(
            TrainConfig(env=env_id, episodes=first, seed=0, record=False, run_dir=run_dir)
        )
        if first < EPISODES[env_id]:
            result = resume(run_dir, episodes=EPISODES[env_id])
        policy = load_checkpoint(run_dir / "checkpoint.bin")["agent"]["policy"]
    weights = digest(
        *(value.numpy().tobytes() for value in policy.values() if isinstance(value, torch.Tensor))
    )
    returns = [episode.return_ for episode in result.episodes]
    return {"returns": returns, "losses": result.episodes[-1].measures, "weights": weights}


def main(session: Session) -> int:
    """Compute the oracles, write them, and compare them with those before."""
    parser = session.parser
    parser.add_argument(
        "--before", type=Path, metavar="DIR", help="folder of the oracles to compare with"
    )
    parser.add_argument(
        "--only", default="*", metavar="PATTERN", help="names, such as 'model *' or '*Walker*'"
    )
    args = session.parse()
    found = {}
    for name, oracle in oracles():
        if fnmatch.fnmatchcase(name, args.only):
            print(name, flush=True)
            found[name] = json.loads(json.dumps(oracle()))
    session.write({"oracles": found})
    before = read_result(args.before / "study.json")["oracles"] if args.before else found
    wrong = [
        f"{name}: {before.get(name)} before, {value} now"
        for name, value in found.items()
        if value != before.get(name)
    ]
    whole, parts = found.get(f"learning {RESUMED}"), found.get(f"resumed {RESUMED}")
    if whole is not None and parts is not None and whole != parts:
        wrong.append(f"the resumed run: {whole} as a whole, {parts} in parts")
    print(*wrong, f"{len(found)} oracles, {len(wrong)} differences", sep="\n")
    return 1 if wrong else 0
