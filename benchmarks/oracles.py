"""Oracles of a change that must change nothing: digests of models, hub programs and motion logs, and returns to the last digit.

    python -m benchmarks oracles --write            # before the change
    python -m benchmarks oracles                    # after it: each difference, and exit code 1 if there is one
    python -m benchmarks oracles --only 'model *'   # a part, by name

The committed record is of one package, `bricksrl`, before it became three; the script finds a name in either layout. Returns are
compared on the processor that the record names, because torch's kernels differ between processors. Where models are kept in a
cache, run it twice: the first run builds them, the second loads them. Takes about four CPU minutes.
"""

from __future__ import annotations

import contextlib
import fnmatch
import functools
import hashlib
import importlib
import io
import json
import os
import tempfile
from collections.abc import Callable, Iterator
from pathlib import Path
from typing import Any

from benchmarks.machine import ONE_THREAD, describe
from benchmarks.session import Session, read_result

os.environ.update(ONE_THREAD)

import numpy as np
import torch
from tensordict import TensorDictBase

from bricksrl.cli import main as bricksrl
from bricksrl.envs import get_task, list_envs
from bricksrl.envs.arenas import ARENAS, get_arena_task
from bricksrl.envs.registry import is_simulation
from bricksrl.training import Callback, Phase, RunResult, TrainConfig, resume, train
from bricksrl.training.checkpoint import load_checkpoint

NOTE = "returns, observations and weights are equal on the processor below; other processors compute other last digits"
EPISODES = {"RunAway-v0": 40, "WalkerSim-v0": 20, "Walker-v1": 20, "Park-v0": 20, "LineFollow-v0": 20}
"""Episodes of SAC with seed 0. One is random; the robots have learned most after these."""
RESUMED = "RunAway-v0"
"""Environment of the run that stops half way."""
_PLACES = {
    "hub": ("brickhub.hub", "bricksrl.hub"),
    "robots": ("bricktwin.robots", "bricksrl.robots"),
    "twin": ("bricktwin.twin", "bricksrl.twin"),
}
"""Packages by their place in three distributions, and in one."""

Oracle = Callable[[], Any]


def find(module: str, name: str) -> Any:
    """The object ``name`` of a module such as ``hub.transport``, in the first layout that is installed."""
    package, _, rest = module.partition(".")
    for place in _PLACES[package]:
        with contextlib.suppress(ModuleNotFoundError):
            return getattr(importlib.import_module(f"{place}.{rest}".rstrip(".")), name)
    raise SystemExit(f"error: neither {' nor '.join(_PLACES[package])} is installed; install this clone")


def digest(*parts: bytes) -> str:
    """First 16 digits of the SHA-256."""
    return hashlib.sha256(b"".join(parts)).hexdigest()[:16]


# ---------------------------------------------------------------- models


def models() -> Iterator[tuple[str, Oracle]]:
    """The compiled model of each robot on an open floor, of each environment's robot in its scene, and of each arena."""
    open_floor, lies_on_bench = find("twin.scene", "OPEN_FLOOR"), find("twin.make_body", "lies_on_bench")
    pairs = {(robot, open_floor): robot.name for robot in find("robots", "ROBOTS").values()}
    for env_id in list_envs():
        task = get_task(env_id)
        pairs.setdefault((task.robot, task.scene), env_id)
    for (robot, scene), name in pairs.items():
        if not lies_on_bench(robot, scene):
            yield f"model {name}", functools.partial(_body, robot, scene)
    for env_id in ARENAS:
        yield f"model {env_id}", functools.partial(_arena, env_id)


def _body(robot: Any, scene: Any) -> dict[str, Any]:
    body = find("twin.make_body", "make_body")(robot, scene=scene, seed=0)
    return {**_model(body.model), "start": digest(body.data.qpos.tobytes())}


def _arena(env_id: str) -> dict[str, Any]:
    world = find("twin.arena", "ArenaWorld")(get_arena_task(env_id).arena)
    return {**_model(world.model), "start": digest(world.data.qpos.tobytes())}


def _model(model: Any) -> dict[str, Any]:
    """Digests of all arrays, texts, sizes and options of a model, by the first word of their names."""
    groups: dict[str, list[bytes]] = {}
    for name, value in _values(model):
        is_size = isinstance(value, int)
        if not (isinstance(value, np.ndarray) and value.size == 0):  # the sizes say so
            group = "sizes" if is_size else name.partition("_")[0]
            groups.setdefault(group, []).append(name.encode() + _bytes(value))
    counts = {name: getattr(model, name) for name in ("nq", "nbody", "ngeom", "nmesh")}
    return {**counts, **{group: digest(*parts) for group, parts in sorted(groups.items())}}


def _bytes(value: Any) -> bytes:
    """A value with its type: an array, a text, a number, or one of MuJoCo's structures of them."""
    if isinstance(value, np.ndarray):
        return f"{value.dtype}{value.shape}".encode() + value.tobytes()
    if isinstance(value, bytes):
        return value
    if isinstance(value, bool | int | float):
        return repr(value).encode()
    return b"".join(name.encode() + _bytes(part) for name, part in _values(value))


def _values(structure: Any) -> Iterator[tuple[str, Any]]:
    for name in sorted(dir(structure)):
        # MuJoCo's signature of the specification is not in its binary form.
        value = None if name.startswith("_") or name == "signature" else getattr(structure, name)
        if value is not None and not callable(value):
            yield name, value


# ---------------------------------------------------------------- hub programs and motion logs


def programs() -> Iterator[tuple[str, Oracle]]:
    """The hub program of each environment and arena with a hub, and the one that records each robot's motion."""
    for env_id in list_envs():
        if not is_simulation(env_id):
            task = get_task(env_id)
            yield f"program {env_id}", functools.partial(_program, task.robot, task.interface)
    for env_id in ARENAS:
        arena_task = get_arena_task(env_id)
        for contestant, interface in zip(arena_task.arena.robots, arena_task.interfaces, strict=True):
            yield f"program {env_id} {contestant.name}", functools.partial(_program, contestant.robot, interface)
    from brickhub.target import whole_interface

    for robot in find("robots", "ROBOTS").values():
        yield f"program {robot.name}", functools.partial(_program, robot, whole_interface(robot))


def _program(robot: Any, interface: Any) -> dict[str, str]:
    generate, pipes = find("hub.program.generate", "generate"), find("hub.transport", "Pipe")
    made = {pipe.name.lower(): generate(robot, interface, pipe) for pipe in pipes}
    return {name: f"{program.hash:08x} {digest(program.source.encode())}" for name, program in made.items()}


def motion_logs() -> Iterator[tuple[str, Oracle]]:
    """The file of `bricksrl twin record` for each robot, on the virtual hub."""
    for name in find("robots", "ROBOTS"):
        yield f"motion log {name}", functools.partial(_motion_log, name)


def _motion_log(robot: str) -> dict[str, Any]:
    with tempfile.TemporaryDirectory() as folder, contextlib.redirect_stdout(io.StringIO()):
        path = Path(folder) / "log.jsonl"
        if bricksrl(["twin", "record", robot, "--out", str(path)]):
            raise SystemExit(f"error: `bricksrl twin record {robot}` failed")
        lines = path.read_bytes().splitlines()
    return {"digest": digest(*lines), "lines": len(lines), "last": json.loads(lines[-1])}


# ---------------------------------------------------------------- learning


class _Last(Callback):
    """Callback that keeps the last step of a run."""

    def on_transition(self, episode: int, step: int, phase: Phase, transition: TensorDictBase) -> None:
        self.step = transition["next"].clone()


def learning() -> Iterator[tuple[str, Oracle]]:
    """Runs of SAC with seed 0, and one that stops half way and is resumed, which must end as the whole one."""
    for env_id, episodes in EPISODES.items():
        yield f"learning {env_id}", functools.partial(_learned, env_id, episodes)
    yield f"resumed {RESUMED}", functools.partial(_learned, RESUMED, EPISODES[RESUMED] // 2)


def _learned(env_id: str, first: int) -> dict[str, Any]:
    """A run of ``first`` episodes that is then resumed, if any are left."""
    with tempfile.TemporaryDirectory() as folder:
        run_dir, last, episodes = Path(folder) / "run", _Last(), EPISODES[env_id]
        result = train(TrainConfig(env=env_id, episodes=first, seed=0, record=False, run_dir=run_dir), last)
        if first < episodes:
            result = resume(run_dir, last, episodes=episodes)
        return _outcome(result, last)


def _outcome(result: RunResult, last: _Last) -> dict[str, Any]:
    """Returns of all episodes, last losses and observation with all digits, and a digest of the policy's weights."""
    policy = load_checkpoint(result.run_dir / "checkpoint.bin")["agent"]["policy"]
    weights = [value.numpy().tobytes() for value in policy.values() if isinstance(value, torch.Tensor)]
    return {
        "returns": [episode.return_ for episode in result.episodes],
        "losses": result.episodes[-1].measures,
        "observation": last.step["observation"].tolist(),
        "weights": digest(*weights),
    }


# ---------------------------------------------------------------- comparison


def differences(name: str, before: Any, now: Any) -> Iterator[str]:
    """One line for each value that differs."""
    if isinstance(before, dict) and isinstance(now, dict):
        for key in sorted({*before, *now}):
            yield from differences(f"{name} · {key}", before.get(key), now.get(key))
    elif isinstance(before, list) and isinstance(now, list) and len(before) == len(now):
        for index, (old, new) in enumerate(zip(before, now, strict=True)):
            yield from differences(f"{name} · {index}", old, new)
    elif before != now:
        yield f"{name}: {before} before, {now} now"


def _whole_and_resumed(found: dict[str, Any]) -> Iterator[str]:
    """Differences of the resumed run from the whole one, where both were made."""
    whole, parts = found.get(f"learning {RESUMED}"), found.get(f"resumed {RESUMED}")
    if whole is not None and parts is not None:
        yield from differences(f"resumed {RESUMED}, against the whole run", whole, parts)


def main(session: Session) -> int:
    """Compute the oracles; write them, or compare them with those written."""
    parser = session.parser
    parser.add_argument("--write", action="store_true", help="write the record instead of comparing with it")
    parser.add_argument("--only", default="*", metavar="PATTERN", help="names, such as 'model *' or '*Walker*'")
    args = session.parse()
    if args.write and args.only != "*":
        parser.error("a record has all oracles; omit --only")
    found = {}
    for part in (models, programs, motion_logs, learning):
        for name, oracle in part():
            if fnmatch.fnmatchcase(name, args.only):
                print(name, flush=True)
                found[name] = oracle()
    found = json.loads(json.dumps(found))
    wrong = list(_whole_and_resumed(found))
    if args.write and not wrong:
        session.write({"note": NOTE, "oracles": found})
    elif not args.write:
        record = read_result(session.published())
        before = {name: value for name, value in record["oracles"].items() if fnmatch.fnmatchcase(name, args.only)}
        for name in [*before, *(name for name in found if name not in before)]:
            wrong += differences(name, before.get(name), found.get(name))
        here, there = (data["machine"]["processor"] for data in (describe(), record))
        if here != there:
            print(f"the record is of {there}, this is {here}: returns may differ in their last digits")
    print(*wrong, f"{len(found)} oracles, {len(wrong)} differences", sep="\n")
    return 1 if wrong else 0
