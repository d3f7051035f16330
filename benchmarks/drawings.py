"""Drawings that learn: from a building plan alone to a policy and its program for the hub.

    python -m benchmarks drawings [FOLDER]

Each plan of a folder, beside those of this repository, is looked at as `bricksrl learn` does; its
robot learns the first that it can, with one seed, or says why it can learn nothing. Plans of others
are named by their digest, as in `plans_of_others.csv`; nothing of them is stored. Returns are means
over 20 episodes, over the link and of the program by itself. Pictures of our robots come into
docs/images/drawings.png.
"""

from __future__ import annotations

import hashlib
import tempfile
import time
from collections.abc import Sequence
from pathlib import Path
from typing import Any

from PIL import Image, ImageDraw

from benchmarks.session import Session
from brickhub.tables import read_table
from bricksrl.envs.abilities.of_plans import ABILITIES, offers
from bricksrl.errors import BricksError
from bricksrl.evaluation.evaluator import evaluate
from bricksrl.policies.hub_export import export_program
from bricksrl.training import TrainConfig, train
from bricktwin import robots
from bricktwin.robots.as_drawn import robot_as_drawn
from bricktwin.robots.planned import is_plan
from bricktwin.twin.mujoco_body import MujocoBody
from bricktwin.twin.physics import Physics
from bricktwin.twin.render.opengl import Renderer
from bricktwin.twin.scene import OPEN_FLOOR

ROOT = Path(__file__).parent.parent
PICTURES = ROOT / "docs" / "images"
EPISODES = 20
OURS = (
    *sorted((Path(robots.__file__).parent / "plans").glob("*.ldr")),
    *sorted((ROOT / "examples").rglob("*.ldr")),
)


def look(path: Path, episodes: int) -> dict[str, Any]:
    """What the robot of a plan can learn, and what it has learned of the first."""
    started_s = time.perf_counter()
    try:
        drawn = robot_as_drawn(path)
        offered = offers(drawn)
    except BricksError as error:
        return {"refused": str(error).replace(str(path), "the plan")}
    found: dict[str, Any] = {
        "hub": drawn.hub.part,
        "motors": [f"{motor.name}: {motor.moves}" for motor in drawn.motors],
        "sensors": [f"{seen.name}: looks {seen.facts.looks or 'askew'}" for seen in drawn.sensors],
        "lacks": list(drawn.lacks),
        "can": [offer.ability.name for offer in offered if offer.task is not None],
        "cannot": {offer.ability.name: offer.reason for offer in offered if offer.task is None},
        "look_s": round(time.perf_counter() - started_s, 1),
    }
    if found["can"]:
        found["learned"] = learned(path, found["can"][0], episodes)
    return found


def learned(path: Path, goal: str, episodes: int) -> dict[str, Any]:
    """What a robot has learned with one seed, and its program by itself."""
    ability = ABILITIES[goal]
    with tempfile.TemporaryDirectory() as folder:
        run_dir = Path(folder) / "run"
        started_s, started_cpu_s = time.perf_counter(), time.process_time()
        try:
            config = TrainConfig(
                f"{path}:{goal}",
                ability.agent,
                episodes=min(ability.episodes, episodes),
                run_dir=run_dir,
            )
            steps = train(config).episodes[-1].steps
        except BricksError as error:
            return {"goal": goal, "refused": str(error).replace(str(path), "the plan")}
        cpu_s = time.process_time() - started_cpu_s
        wall_s = time.perf_counter() - started_s
        evaluation = evaluate(run_dir, episodes=EPISODES, save=False)
        found = {
            "goal": goal,
            "steps": steps,
            "cpu_s": round(cpu_s, 1),
            "wall_s": round(wall_s, 1),
            "return": evaluation.return_mean,
            "success_rate": evaluation.success_rate,
            "metrics": evaluation.metrics,
        }
        try:
            exported = export_program(run_dir, Path(folder) / "alone.py", episodes=EPISODES)
        except BricksError as error:
            return {**found, "no_program": str(error)}
        return {**found, "over_link": exported.policy_return, "alone": exported.hub_return}


def sheet(paths: Sequence[Path]) -> Image.Image:
    """Pictures of the robots of some plans, each with the name of its file."""
    across, width_px, height_px = 3, 320, 210
    rows = -(-len(paths) // across)
    whole = Image.new("RGB", (across * width_px, rows * height_px), "white")
    for number, path in enumerate(paths):
        body = MujocoBody(robot_as_drawn(path).robot, OPEN_FLOOR, Physics(), 0)
        with Renderer(body, width_px, height_px, "portrait", shadows=True) as renderer:
            picture = Image.fromarray(renderer.render())
        ImageDraw.Draw(picture).text((8, 6), path.stem.replace("_", " "), fill="black")
        row, column = divmod(number, across)
        whole.paste(picture, (column * width_px, row * height_px))
    return whole


def main(session: Session) -> None:
    """Look at all, let them learn, and write what was found."""
    session.parser.add_argument("folder", type=Path, nargs="?")
    session.parser.add_argument("--episodes", type=int, default=1000)
    args = session.parse()
    of_others = {
        row["sha256"]: f"{row['repository']}: {row['path']}"
        for row in read_table("benchmarks", "plans_of_others")
    }
    plans = {path.name: path for path in OURS}
    if session.is_quick:
        plans = dict(list(plans.items())[:1])
    for path in sorted(args.folder.rglob("*")) if args.folder else ():
        if path.is_file() and is_plan(path.name):
            digest = hashlib.sha256(path.read_bytes()).hexdigest()
            plans[of_others.get(digest, path.name)] = path
    known = session.known().get("plans", {})
    for name, path in plans.items():
        if name in known and not session.is_again:
            continue
        known[name] = look(path, args.episodes)
        print(name, known[name], flush=True)
        session.write({"episodes": EPISODES, "plans": known})
    picture = session.place_of(PICTURES) / "drawings.png"
    ours = [path for path in plans.values() if path in OURS]
    sheet(ours).quantize(200).save(picture)
