"""Trained robots in a browser tab: the policy that comes with each environment, as the program that
its hub runs by itself.

    python -m benchmarks tab_policies
    python -m benchmarks tab_policies --envs Spinning-v0

Writes the programs to ``docs/hub_programs``, which ``make docs`` gives to the tab, unless they are
there (``--again`` writes them anew; a minute or two each). Then each plays 20 episodes in a tab's
worker (Pyodide and MuJoCo's JavaScript build in Node.js) and 20 on the virtual hub of this
computer, from starts that are drawn anew. What the tab recorded is scored here, by the
environment's own reward. The difference of the mean returns is within its 95 % interval (Welch), or
not.
"""

from __future__ import annotations

import itertools
import json
import math
import os
import statistics
import subprocess
import tempfile
from dataclasses import asdict
from pathlib import Path
from types import SimpleNamespace
from typing import TYPE_CHECKING, Any

import brickhub
import bricktwin
from benchmarks.machine import ONE_THREAD
from benchmarks.session import Session
from benchmarks.tab_physics import IN_NODE, ROOT, T_95
from brickhub.seed import derive_seed
from bricksrl.envs.registry import get_task
from bricksrl.policies.by_name import TRAINED
from bricktwin.site.packages import node, unpack_packages
from bricktwin.site.robot_files import robot_file
from bricktwin.twin.standing import Pose

if TYPE_CHECKING:
    from bricksrl.envs.task import Task

PLAY = ROOT / "benchmarks" / "tab_episodes.py"
PROGRAMS = ROOT / "docs" / "hub_programs"
LEARNED = {
    "RunAway-v0": "RunAway-v0",
    "Spinning-v0": "Spinning-v0",
    "LineFollow-v0": "LineFollow-v0",
    "Walker-v1": "Walker-v1",
    "Walker-v0": "WalkerSim-v0",
    "RoboArm-v0": "RoboArmSim-v0",
}
"""Environments with a hub, and the one in which the policy that comes with each has learned."""


def path_of(env_id: str) -> Path:
    """The program of an environment."""
    return PROGRAMS / f"{env_id.lower().replace('-', '_')}.py"


def scored(task: Task, lines: list[dict[str, Any]]) -> float:
    """Return of an episode that was recorded elsewhere."""
    from brickhub.virtual.micropython.exceptions import HostStop
    from bricksrl.envs.odometry import TrueOdometer
    from bricksrl.policies.hub_export import Alone

    clock: Any = SimpleNamespace(body_ms=0.0)
    now = {"pose": Pose(*lines[0]["pose"])}
    episode = Alone(task, clock, TrueOdometer(lambda: now["pose"], 0.0))
    for line in lines:
        clock.body_ms = line["ms"]
        now["pose"] = Pose(*line["pose"])
        try:
            episode.write(line["printed"].encode() + b"\r\n")
        except HostStop:
            break
    return episode.return_


class Tab:
    """A tab's worker, which plays episodes."""

    def __init__(self, folder: Path) -> None:
        self._folder = folder
        unpack_packages(folder)
        houses = [str(Path(str(house.__file__)).parents[1]) for house in (brickhub, bricktwin)]
        places = [str(folder / "node_modules"), *houses, str(folder)]
        # Folders are mounted in their order.
        self._command = [node(), str(IN_NODE), *places, "--", str(PLAY), "/folder_2/asked.json"]

    def played(
        self,
        task: Task,
        source: str,
        seeds: list[int],
    ) -> list[list[dict[str, Any]]]:
        """Lines of each episode."""
        file = robot_file(task.robot, task.scene)
        (self._folder / "robot.json").write_text(json.dumps(file), encoding="utf-8")
        (self._folder / "program.py").write_text(source, encoding="utf-8")
        asked = {
            "file": "/folder_2/robot.json",
            "program": "/folder_2/program.py",
            "starts": seeds,
            "on_ms": [seed % 1000 for seed in seeds],
            "lines": task.max_steps + 1,
        }
        (self._folder / "asked.json").write_text(json.dumps(asked), encoding="utf-8")
        done = subprocess.run(  # noqa: S603  our own words only
            self._command,
            env={**os.environ, **ONE_THREAD},
            stdout=subprocess.PIPE,
            text=True,
            check=True,
        )
        rows = [json.loads(line) for line in done.stdout.splitlines() if line.startswith("{")]
        return [row["lines"] for row in rows]


def measure(env_id: str, tab: Tab, episodes: int) -> dict[str, Any]:
    """Returns of an environment's program in both places."""
    from bricksrl.policies.hub_export import play_alone

    task = get_task(env_id)
    source = path_of(env_id).read_text(encoding="utf-8")
    seeds = [derive_seed(0, "tab", number) for number in range(episodes)]
    here = [play_alone(source, task, None, seed).return_ for seed in seeds]
    there = [scored(task, lines) for lines in tab.played(task, source, seeds)]
    means = [statistics.fmean(returns) for returns in (there, here)]
    errors = [statistics.stdev(returns) / math.sqrt(episodes) for returns in (there, here)]
    half = T_95 * math.hypot(*errors)
    return {
        "tab": round(means[0], 3),
        "native": round(means[1], 3),
        "difference": round(means[0] - means[1], 3),
        "half_interval": round(half, 3),
        "is_within": abs(means[0] - means[1]) <= half + 1e-6 * abs(means[1]),
        "tab_returns": [round(value, 3) for value in there],
        "native_returns": [round(value, 3) for value in here],
        "policy": float(TRAINED[LEARNED[env_id]]["return"]),
    }


def main(session: Session) -> None:
    """Write what is missing, measure, and write the result."""
    from bricksrl.policies.hub_export import export_own, world_file

    args = session.parse(episodes=20, envs=list(LEARNED))
    known = session.known()
    programs = dict(known.get("programs", {}))
    environments = dict(known.get("environments", {}))
    PROGRAMS.mkdir(exist_ok=True)
    for env_id in args.envs:
        path = path_of(env_id)
        if session.is_again or not path.exists():
            for old in (path, world_file(path)):
                old.unlink(missing_ok=True)
            made = export_own(env_id, path, learned=LEARNED[env_id])
            programs[env_id] = asdict(made)
            print(env_id, made, flush=True)
    with tempfile.TemporaryDirectory(prefix="tab-policies-") as name:
        tab = Tab(Path(name))
        for env_id in args.envs:
            environments[env_id] = measure(env_id, tab, args.episodes)
            shown = dict(itertools.islice(environments[env_id].items(), 5))
            print(env_id, shown, flush=True)
    session.write({"programs": programs, "environments": environments})
