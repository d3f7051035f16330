"""Programs that a site offers: each runs on its robot in its world, or on the bench, as its title
says."""

from __future__ import annotations

import io
import math
from pathlib import Path

import pytest

from brickhub.virtual.body import Body
from brickhub.virtual.run import Operation, run_file
from bricktwin.robots import ROBOTS
from bricktwin.site import build
from bricktwin.site.tab.run import own_devices
from bricktwin.twin.make_body import make_body
from bricktwin.twin.mujoco_body import MujocoBody
from bricktwin.twin.scene import OPEN_FLOOR
from bricktwin.worlds import world

PROGRAMS = {program["name"]: program for program in build.programs(None)}
ON_BENCH = [name for name, program in PROGRAMS.items() if program["robot"] == "bench"]
DRIVES = [
    name
    for name, program in PROGRAMS.items()
    # What waits for another hub stands without it; `test_room_in_browser.py` has both.
    if program["robot"] != "bench" and "\n# With: " not in program["source"]
]


def run(
    tmp_path: Path, name: str, limit_s: float, body: Body | None = None, **operation: object
) -> tuple[str, str]:
    path, out, err = tmp_path / name, io.BytesIO(), io.StringIO()
    for file, source in {name: PROGRAMS[name]["source"], **PROGRAMS[name]["files"]}.items():
        (tmp_path / file).write_text(source, encoding="utf-8")
    with pytest.MonkeyPatch.context() as patch:
        patch.setattr("bricktwin.site.tab.run.FOLDER", tmp_path)
        own = own_devices(PROGRAMS[name]["source"], PROGRAMS[name]["files"])
    done = Operation(own_devices=own, **operation)  # type: ignore[arg-type]
    run_file(path, body, stdout=out, stderr=err, time_limit_s=limit_s, operation=done)
    return out.getvalue().decode(), err.getvalue()


def placed(name: str) -> MujocoBody:
    program = PROGRAMS[name]
    scene = world(program["world"]) if program["world"] else OPEN_FLOOR
    body = make_body(ROBOTS[program["robot"]], scene=scene)
    assert isinstance(body, MujocoBody)
    return body


@pytest.mark.parametrize("name", ON_BENCH)
def test_programs_for_the_bench(tmp_path: Path, name: str) -> None:
    _, err = run(tmp_path, name, 5.0)
    is_wrong = "mistake" in PROGRAMS[name]["title"]
    assert ("Traceback" in err) is is_wrong, err


@pytest.mark.parametrize("name", DRIVES)
def test_programs_for_a_robot_move_it(tmp_path: Path, name: str) -> None:
    body = placed(name)
    before = body.data.qpos.copy()
    _, err = run(tmp_path, name, 2.0, body)
    assert "Traceback" not in err, err
    assert abs(body.data.qpos - before).max() > 0.02


def test_the_line_is_followed(tmp_path: Path) -> None:
    body = placed("line.py")
    (line,) = body.scene.marks
    run(tmp_path, "line.py", 8.0, body)
    pose = body.pose()
    heading = math.radians(pose.heading_deg)
    # Its color sensor is 56 mm ahead of its axle.
    x_mm = 1000 * pose.x_m + 56 * math.cos(heading)
    y_mm = 1000 * pose.y_m - 56 * math.sin(heading)
    assert abs(line.beyond_mm(x_mm, y_mm)) < 25
    assert math.hypot(pose.x_m, pose.y_m) > 0.3
