"""Robots of a site: for each robot and world a file with its physics and how it is drawn."""

from collections.abc import Mapping, Sequence
from dataclasses import asdict, replace
from itertools import combinations_with_replacement
from pathlib import Path
from typing import Any

import numpy as np

from brickhub.files import as_file_name
from brickhub.robot import Robot
from bricktwin.plans.planned_robot import planned_robot
from bricktwin.robots import EV3_DRIVER, ROBO_ARM, SCOUT, TWO_WHEELER, WALKER
from bricktwin.robots.planned import plan_file
from bricktwin.site.robot_files import robot_file, together_file
from bricktwin.site.storing import read_packed_json, write_packed_json
from bricktwin.site.tab.lessons import described as described_lesson
from bricktwin.site.tab.lessons import lesson_for
from bricktwin.twin.arena import side_by_side
from bricktwin.twin.make_body import lies_on_bench, make_body
from bricktwin.twin.models.balance import lean_on_one_axle_deg
from bricktwin.twin.mujoco_arena import ArenaWorld
from bricktwin.twin.mujoco_body import MujocoBody
from bricktwin.twin.scene import OPEN_FLOOR, Scene
from bricktwin.view.around import view_around
from bricktwin.view.body_drawing import drawing_of
from bricktwin.view.drawing_of_body import poses
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


def write_together(site: Path, robots: Sequence[Robot]) -> list[dict[str, Any]]:
    """Write the files of robots that share a world, two at a time, beside those of
    :func:`write_robots`; returns their index: names of both, file, and files of their meshes."""
    folder = site / "robots" / _TOGETHER
    folder.mkdir(parents=True)
    index = []
    for pair in combinations_with_replacement(filter(_can_share, robots), 2):
        file = together_file(pair)
        shared = ArenaWorld(side_by_side(pair))
        # Where the model has them is not where they start.
        shared.place(np.random.default_rng(0))
        body = shared.bodies[0]
        described = drawing_of(body).described()
        meshes = []
        folders = []
        # Of two robots of one name the meshes are the same.
        for name in dict.fromkeys(as_file_name(robot.name) for robot in pair):
            path = f"robots/{name}/{_MESHES}"
            folders.append(path)
            meshes += read_packed_json(site / path)
        described["meshes"] = [
            meshes.index(mesh) if mesh in meshes else mesh for mesh in described["meshes"]
        ]
        described["view"] = asdict(view_around([one.pose() for one in shared.bodies]))
        names = [robot.name for robot in pair]
        first, second = map(as_file_name, names)
        path = f"robots/{_TOGETHER}/{first}_and_{second}.json"
        write_packed_json(site / path, {"robot": file, "drawing": described, "start": _start(body)})
        index.append({"robots": names, "file": path, "meshes": folders})
    return index


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
        described["meshes"] = [
            meshes.index(mesh) if mesh in meshes else mesh for mesh in described["meshes"]
        ]
        if name != _OPEN:
            described["view"].update(_BEHIND)
        title = name.replace("-", " ").replace("_", " ")
        path = f"{folder}/{as_file_name(name)}.json"
        write_packed_json(site / path, {"robot": file, "drawing": described, "start": _start(body)})
        lesson = lesson_for(robot, name, is_held=scene.held_deg is not None)
        taught = None if lesson is None else described_lesson(lesson)
        index.append({"name": name, "title": title, "file": path, "lesson": taught})
    return index


def _start(body: MujocoBody) -> list[float]:
    """Frame of the drawing with the robot at its start."""
    body.update_visuals()
    numbers = [drawn.model_body for drawn in drawing_of(body).bodies]
    frame = poses(body.data.xpos[numbers], body.data.xquat[numbers])
    return [round(value, 5) for value in frame.ravel().tolist()]
