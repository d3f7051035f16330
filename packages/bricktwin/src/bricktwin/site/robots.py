"""Robots of a site: for each robot and world a file with its physics and how it is drawn."""

from collections.abc import Mapping, Sequence
from dataclasses import asdict, replace
from pathlib import Path
from typing import Any

import numpy as np

from brickhub.errors import TwinError
from brickhub.files import as_file_name
from brickhub.robot import Robot
from bricktwin.plans.planned_robot import planned_robot
from bricktwin.robots import EV3_DRIVER, ROBO_ARM, SCOUT, TWO_WHEELER, WALKER
from bricktwin.robots.planned import plan_file
from bricktwin.site.robot_files import robot_file, sharing_file, world_file
from bricktwin.site.storing import read_packed_json, write_packed_json
from bricktwin.site.tab.lessons import described as described_lesson
from bricktwin.site.tab.lessons import lesson_for
from bricktwin.twin.arena import COLORS, side_by_side
from bricktwin.twin.engines.mujoco_engine import MujocoEngine
from bricktwin.twin.make_body import lies_on_bench, make_body
from bricktwin.twin.models.balance import lean_on_one_axle_deg
from bricktwin.twin.models.shared_scene import Start, shared_scene, starts_in
from bricktwin.twin.mujoco_arena import ArenaWorld, world_spec
from bricktwin.twin.mujoco_body import MujocoBody
from bricktwin.twin.scene import OPEN_FLOOR, Scene
from bricktwin.twin.standing import Pose
from bricktwin.view.around import view_around
from bricktwin.view.body_drawing import drawing_of, drawing_of_model
from bricktwin.view.drawing_of_body import Drawing, Floats, poses
from bricktwin.worlds import WORLDS, world

OWN = (TWO_WHEELER, WALKER, SCOUT, ROBO_ARM, EV3_DRIVER)
_TITLES = {
    "two-wheeler": "2Wheeler",
    "walker": "Walker",
    "scout": "Scout",
    "robo-arm": "RoboArm",
    "ev3-driver": "EV3 driver",
    "cart": "Cart",
}
_OPEN = "open floor"
_MESHES = "meshes.json"
_TOGETHER = "together"
_MOST = 4
"""Most hubs of a room."""
_BEHIND = {"distance_m": 1.1, "yaw_deg": -150.0, "pitch_deg": 34.0}
"""View of a robot in a world: from behind it, so that what is before it is seen."""
_FEWER_WORLDS = {"ev3-driver": ("wall", "line-simple", "maze")}
"""Worlds of robots that are offered fewer than all drivers are: all of them, for one robot more,
would be more than what the site may transfer, 12 MB."""
# A robot that does not drive is offered what it can be put into as it is.
_WITHOUT_WHEELS = ("wall",)


def write_robots(
    site: Path,
    robots: Sequence[Robot],
    worlds_of_drivers: Mapping[str, Scene],
    further: Mapping[str, Mapping[str, Scene]],
) -> list[dict[str, Any]]:
    """Write the files of robots into a site; returns its index: name and title of each robot, and
    name, title and file of each of its worlds, with what it can learn there. Raises TwinError if a
    robot has no model.

    Args:
        site: its folder.
        robots: to be offered.
        worlds_of_drivers: worlds for robots that drive, beside the open floor, by name.
        further: worlds of single robots, by the robot's name and their own.
    """
    index = []
    for robot in robots:
        worlds: dict[str, Scene] = {_OPEN: OPEN_FLOOR}
        if robot.drive_base is not None:
            for name, scene in worlds_of_drivers.items():
                # A world of the user's own is offered to every robot.
                if name not in WORLDS or name in _FEWER_WORLDS.get(robot.name, (name,)):
                    worlds[name] = scene
        elif robot.needs_imu:
            worlds.update({name: world(name) for name in _WITHOUT_WHEELS})
        worlds.update(further.get(robot.name, {}))
        worlds = {
            name: _held(robot, scene) for name, scene in worlds.items() if _can_be_in(robot, scene)
        }
        folder = f"robots/{as_file_name(robot.name)}"
        (site / folder).mkdir(parents=True)
        index.append(
            {
                "name": robot.name,
                "title": _TITLES.get(robot.name, robot.name),
                "meshes": f"{folder}/{_MESHES}",
                # Only these are offered a floor of the user's own.
                "drives": robot.drive_base is not None,
                "worlds": _write_worlds(site, folder, robot, worlds),
            }
        )
    return index


def write_together(
    site: Path,
    robots: Sequence[Robot],
    worlds: Mapping[str, Scene],
    known: Sequence[Mapping[str, Any]],
) -> dict[str, Any]:
    """Write what ``tab/robot_file.py`` and ``together.js`` put together, beside the files of
    :func:`write_robots`: a file of each robot that can share a world, and of each world that can be
    shared. Returns their index: ``robots``, by name, with their file and that of their meshes, and
    ``worlds``, with name, title, file, the most robots that have room there, and the file of a
    robot alone there, whose meshes it names by their numbers, or ``None``.

    Args:
        site, robots, worlds: as of :func:`write_robots`.
        known: what that has returned.
    """
    folder = f"robots/{_TOGETHER}"
    (site / folder).mkdir(parents=True)
    index: dict[str, Any] = {"robots": {}, "worlds": []}
    for robot in robots:
        if not _can_share(robot):
            continue
        name = as_file_name(robot.name)
        meshes = f"robots/{name}/{_MESHES}"
        path = f"{folder}/{name}.json"
        write_packed_json(site / path, _sharing(robot, read_packed_json(site / meshes)))
        index["robots"][robot.name] = {"file": path, "meshes": meshes}
    for name, scene in {_OPEN: OPEN_FLOOR, **worlds}.items():
        try:
            shared = shared_scene(scene)
        except TwinError:
            # It is for one robot alone.
            continue
        starts = _starts(shared)
        if len(starts) < 2:
            continue
        # There is nothing to be drawn on an open floor.
        worlds_alone = [one for robot in known for one in robot["worlds"] if shared.objects]
        alone = [one["file"] for one in worlds_alone if one["name"] == name]
        drawn_in = alone[0] if alone else None
        meshes = read_packed_json(site / drawn_in)["drawing"]["meshes"] if drawn_in else []
        path = f"{folder}/world-{as_file_name(name)}.json"
        write_packed_json(site / path, _shared(shared, starts, meshes))
        index["worlds"].append(
            {
                "name": name,
                "title": _title(name),
                "file": path,
                "most": len(starts),
                "drawn_in": drawn_in,
            }
        )
    return index


def _sharing(robot: Robot, meshes: list[dict[str, str]]) -> dict[str, Any]:
    """File of a robot that shares worlds; ``meshes``: those of its own file."""
    world_of_it = ArenaWorld(side_by_side([robot]))
    # Where the model has it is not where it stands.
    world_of_it.place(np.random.default_rng(0))
    (body,) = world_of_it.bodies
    drawing = drawing_of(body)
    described = drawing.described()
    described["meshes"] = _numbered(described["meshes"], meshes)
    return {
        **sharing_file(robot),
        "drawing": described,
        "disc": _disc_of(drawing),
        "counts": {
            "bodies": body.model.nbody - 1,
            "positions": body.model.nq,
            "sites": body.model.nsite,
        },
        "start": _start(body),
    }


def _disc_of(drawing: Drawing) -> dict[str, int]:
    """Which body and which of its shapes is the disc by whose colour a robot is known."""
    discs = []
    for number, drawn in enumerate(drawing.bodies):
        for shape_number, shape in enumerate(drawn.shapes):
            if np.allclose(shape.colour, (*COLORS[0], 1.0)):
                discs.append({"body": number, "shape": shape_number})
    # It is added to the model last.
    return discs[-1]


def _starts(scene: Scene) -> list[Start]:
    """Where the robots of a scene start, as many as it has room for."""
    starts: list[Start] = []
    for count in range(1, _MOST + 1):
        try:
            starts = starts_in(scene, count)
        except TwinError:
            break
    return starts


def _shared(
    scene: Scene,
    starts: Sequence[Start],
    meshes: list[Any],
) -> dict[str, Any]:
    """File of a scene that robots share, who start at these poses; ``meshes``: those of the file of
    a robot alone in it."""
    engine = MujocoEngine(world_spec(scene).compile())
    engine.forward()
    drawing = drawing_of_model(engine)
    described = drawing.described()
    described["meshes"] = _numbered(described["meshes"], meshes)
    numbers = [drawn.model_body for drawn in drawing.bodies]
    places = [Pose(*start) for start in starts]
    views = [view_around(places[:count]) for count in range(1, len(starts) + 1)]
    return {
        **world_file(scene),
        "starts": starts,
        "views": [asdict(view) for view in views],
        "drawing": {name: described[name] for name in ("meshes", "pictures", "bodies", "floor")},
        "start": _rounded(poses(engine.data.xpos[numbers], engine.data.xquat[numbers])),
    }


def _can_share(robot: Robot) -> bool:
    """Whether a robot can be one of several in a world, and hear the others there."""
    hub = robot.hub.model
    if not (hub.runs_programs and hub.has_bluetooth) or lies_on_bench(robot, OPEN_FLOOR):
        return False
    body = make_body(robot)
    # One that has to be held until it runs is alone with its hand.
    return isinstance(body, MujocoBody) and body.moves and _held(robot, OPEN_FLOOR) is OPEN_FLOOR


def _held(robot: Robot, scene: Scene) -> Scene:
    """A scene in which a hand holds a robot that stands on one axle alone; for any other as it
    is."""
    plan = plan_file(robot.model or "")
    lean_deg = None if plan is None else lean_on_one_axle_deg(planned_robot(plan))
    if lean_deg is None:
        return scene
    return replace(scene, held_deg=(lean_deg, lean_deg))


def _can_be_in(robot: Robot, scene: Scene) -> bool:
    """Whether a robot can be put into a scene: before a wall it is put by what its sensor sees."""
    sees = any(sensor.kind.model.range_mm is not None for sensor in robot.sensors)
    return sees or scene.wall_distance_mm is None


def _write_worlds(
    site: Path,
    folder: str,
    robot: Robot,
    worlds: dict[str, Scene],
) -> list[dict[str, Any]]:
    """Write a robot's meshes, and a file for each world, which names meshes by their numbers."""
    meshes: list[dict[str, str]] = []
    index = []
    for name, scene in worlds.items():
        body = make_body(robot, scene=scene)
        # Robots of a site have a model, or `robot_file` says what is missing.
        file = robot_file(robot, scene)
        assert isinstance(body, MujocoBody)  # noqa: S101
        described = drawing_of(body).described()
        is_first = not meshes
        if is_first:
            # Those of the robot itself are in all of its worlds.
            meshes = described["meshes"]
            write_packed_json(site / folder / _MESHES, meshes)
        described["meshes"] = _numbered(described["meshes"], meshes)
        if name != _OPEN:
            described["view"].update(_BEHIND)
        path = f"{folder}/{as_file_name(name)}.json"
        write_packed_json(site / path, {"robot": file, "drawing": described, "start": _start(body)})
        lesson = lesson_for(robot, name, is_held=scene.held_deg is not None)
        taught = None if lesson is None else described_lesson(lesson)
        index.append({"name": name, "title": _title(name), "file": path, "lesson": taught})
    return index


def _start(body: MujocoBody) -> list[float]:
    """Frame of the drawing with the robot at its start."""
    body.update_visuals()
    numbers = [drawn.model_body for drawn in drawing_of(body).bodies]
    return _rounded(poses(body.data.xpos[numbers], body.data.xquat[numbers]))


def _rounded(frame: Floats) -> list[float]:
    return [round(value, 5) for value in frame.ravel().tolist()]


def _numbered(
    meshes: Sequence[dict[str, str]],
    known: list[dict[str, str]],
) -> list[dict[str, str] | int]:
    """Meshes of a drawing, by their numbers where they are known."""
    return [known.index(mesh) if mesh in known else mesh for mesh in meshes]


def _title(name: str) -> str:
    """What a world is called in the page."""
    return name.replace("-", " ").replace("_", " ")
