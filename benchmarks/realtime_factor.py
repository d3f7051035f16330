"""Speed of the virtual robots: simulated seconds per CPU second on one core, hub program, link and
environment included.

    python -m benchmarks realtime_factor
    python -m benchmarks realtime_factor --envs Walker-v1 RunAway-v0
    git worktree add ../before 81c92bce && python -m benchmarks realtime_factor --before ../before

With ``--before`` the same robots run in another tree too, a piece here and a piece there, which
tells changes of the code from those of the load.

The result also has the speed of MuJoCo alone, from a replay of the same ``mj_step`` calls with the
same states and voltages, and the ratio of the total time to it. Random actions, in pieces that are
replayed immediately, so that other load affects both; medians over the pieces. Takes about a
minute.
"""

from __future__ import annotations

import copy
import os
import statistics
import subprocess
import sys
import time
from pathlib import Path
from typing import TYPE_CHECKING, Any
from unittest import mock

import mujoco
import numpy as np
import torch
from numpy.typing import NDArray

import bricksrl
from benchmarks.session import Session
from bricksrl.envs import list_envs

if TYPE_CHECKING:
    from bricksrl.envs.env import HubEnv

PIECES = 9
PIECE_SIMULATED_S = 10.0
_STATE = mujoco.mjtState.mjSTATE_FULLPHYSICS | mujoco.mjtState.mjSTATE_WARMSTART


class Steps:
    """Recorder of calls of ``mj_step``, for a replay."""

    def __init__(self, body: Any) -> None:
        self._model, self._data = body.model, body.data
        self._calls: list[tuple[NDArray[Any] | None, NDArray[Any], int, int]] = []
        self._after: NDArray[Any] | None = None

    def __call__(self, model: Any, data: Any, nstep: int = 1) -> None:
        """Replacement for ``mj_step``: records the voltages, and the state if it was changed since
        the last step."""
        before = self._state()
        moved = self._after is None or not np.array_equal(before, self._after)
        self._calls.append(
            (before if moved else None, data.ctrl.copy(), model.opt.disableactuator, nstep)
        )
        _mj_step(model, data, nstep)
        self._after = self._state()

    def again(self) -> float:
        """CPU seconds of a replay of the steps alone."""
        model, data = self._model, copy.copy(self._data)
        control, open_circuits = data.ctrl, model.opt.disableactuator
        started_s = time.process_time()
        for state, voltages, model.opt.disableactuator, nstep in self._calls:
            if state is not None:
                mujoco.mj_setState(model, data, state, _STATE)
            control[:] = voltages
            _mj_step(model, data, nstep)
        cpu_s = time.process_time() - started_s
        model.opt.disableactuator = open_circuits
        if not np.array_equal(data.qpos, self._data.qpos):
            raise AssertionError("the steps done over again lead elsewhere")
        return cpu_s

    def _state(self) -> NDArray[Any]:
        state = np.empty(mujoco.mj_stateSize(self._model, _STATE))
        mujoco.mj_getState(self._model, self._data, state, _STATE)
        return state


_mj_step = mujoco.mj_step


class Runner:
    """An environment and its random actions; equal seeds give equal runs, bit for bit."""

    def __init__(self, env_id: str) -> None:
        self.env: HubEnv = bricksrl.make(env_id, seed=0)
        self._state = self.env.reset()
        self.simulated_s = 0.0

    def run(self, actions: list[torch.Tensor]) -> float:
        """CPU seconds of these actions."""
        assert self.env.twin is not None
        started_s, simulated_s = time.process_time(), self.env.twin.now_s()
        for action in actions:
            self._state["action"] = action
            _, self._state = self.env.step_and_maybe_reset(self._state)
        self.simulated_s = self.env.twin.now_s() - simulated_s
        return time.process_time() - started_s


_WORKER = """
import sys, time, bricksrl, torch
torch.set_num_threads(1)
torch.manual_seed(0)
env = bricksrl.make(sys.argv[1], seed=0)
state = env.reset()
for line in sys.stdin:
    actions = [env.action_spec.rand() for _ in range(int(line))]
    cpu_s, simulated_s = time.process_time(), env.twin.now_s()
    for action in actions:
        state["action"] = action
        _, state = env.step_and_maybe_reset(state)
    print((env.twin.now_s() - simulated_s) / (time.process_time() - cpu_s), flush=True)
"""


class Before:
    """The same robot in another tree."""

    def __init__(self, tree: Path, env_id: str) -> None:
        paths = os.pathsep.join(map(str, (tree / "src", *tree.glob("packages/*/src"))))
        self._process = subprocess.Popen(  # noqa: S603 - the code of a tree that the caller names
            [sys.executable, "-c", _WORKER, env_id],
            cwd=tree,
            env={**os.environ, "PYTHONPATH": paths},
            stdin=subprocess.PIPE,
            stdout=subprocess.PIPE,
            text=True,
        )

    def factor(self, steps: int) -> float:
        """Simulated seconds per CPU second of so many steps."""
        assert self._process.stdin is not None and self._process.stdout is not None
        print(steps, file=self._process.stdin, flush=True)
        return float(self._process.stdout.readline())

    def close(self) -> None:
        """End its process."""
        self._process.communicate()


def measure(env_id: str, tree: Path | None = None) -> dict[str, Any]:
    """Medians over the pieces, and the ratio of each; ``tree``: one to compare with."""
    torch.manual_seed(0)
    recorded, timed = Runner(env_id), Runner(env_id)
    before = None if tree is None else Before(tree, env_id)
    times_before = []
    draw, steps, pieces = recorded.env.action_spec.rand, 10, []
    for _ in range(PIECES + 1):
        actions = [draw() for _ in range(steps)]
        recorder = Steps(recorded.env.twin.body)  # type: ignore[union-attr]
        with mock.patch.object(mujoco, "mj_step", recorder):
            recorded.run(actions)
        cpu_s, physics_s = timed.run(actions), recorder.again()
        piece = (
            timed.simulated_s / cpu_s,
            steps / cpu_s,
            timed.simulated_s / physics_s,
            cpu_s / physics_s,
        )
        pieces.append(piece)
        times_before += [] if before is None else [piece[0] / before.factor(steps)]
        steps = round(steps * PIECE_SIMULATED_S / timed.simulated_s)
    recorded.env.close()
    timed.env.close()
    if before is not None:
        before.close()
    names = ("realtime_factor", "steps_per_cpu_s", "mj_step_factor", "ratio")
    # the first piece warms up
    columns = dict(zip(names, zip(*pieces[1:], strict=True), strict=True))
    medians: dict[str, Any] = {
        name: round(statistics.median(column), 2) for name, column in columns.items()
    }
    if times_before:
        medians["times_before"] = round(statistics.median(times_before[1:]), 2)
    return {**medians, "ratios": [round(ratio, 2) for ratio in sorted(columns["ratio"])]}


def main(session: Session) -> None:
    """Measure every environment and write the results."""
    virtual = [env_id for env_id in list_envs() if "Sim-" not in env_id]
    parser = session.parser
    parser.add_argument("--envs", nargs="+", default=virtual, choices=virtual)
    parser.add_argument(
        "--before", type=Path, metavar="TREE", help="checkout of another commit to compare with"
    )
    args = session.parse()
    torch.set_num_threads(1)
    results: dict[str, Any] = {}
    for env_id in args.envs:
        results[env_id] = measure(env_id, args.before and args.before.resolve())
        print(env_id, results[env_id], flush=True)
    if list(results) == virtual or session.is_apart:
        head = ["git", "-C", str(args.before), "log", "-1", "--format=%h of %cs"]
        before = args.before and subprocess.check_output(head, text=True).strip()  # noqa: S603
        session.write({"before": before, "environments": results})
