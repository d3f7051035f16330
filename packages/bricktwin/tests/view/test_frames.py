"""Frames that JavaScript makes from MuJoCo's arrays, beside those of Python."""

from __future__ import annotations

import json
import shutil
import subprocess
from pathlib import Path

import numpy as np
import pytest

from brickhub.robot import HubKind, Motor, Robot
from bricktwin.robots import WALKER
from bricktwin.twin.make_body import make_body
from bricktwin.view.body_drawing import drawing_of
from bricktwin.view.drawing_of_body import View, poses
from bricktwin.view.mirror import Mirror
from bricktwin.view.script import FOLDER, one_script

ARRAYS = ("xpos", "xquat", "qpos", "site_xpos")
SCRIPT = """
const lines = require("fs").readFileSync(0, "utf8").split("\\n");
for (const line of lines) {
  const { drawing, arrays } = JSON.parse(line);
  const data = {};
  for (const [name, values] of Object.entries(arrays)) data[name] = Float64Array.from(values);
  console.log(JSON.stringify([...new Frames(drawing).poses(data)]));
}
"""


GEARS = """<mujoco>
  <size nuser_body="4"/>
  <worldbody>
    <body name="base">
      <freejoint/>
      <geom type="box" size="0.05 0.05 0.02" mass="0.5"/>
      <body name="wheel" pos="0 0 0.06">
        <joint name="turn" type="hinge" axis="0 1 0"/>
        <geom type="sphere" size="0.02" mass="0.1"/>
      </body>
      <body name="spin_A_0" pos="0.05 0 0.06" user="-2 0 0.6 0.8">
        <geom type="box" size="0.01 0.02 0.01" mass="0" contype="0" conaffinity="0"/>
      </body>
    </body>
  </worldbody>
</mujoco>
"""


def test_frames_are_those_of_python(tmp_path: Path) -> None:
    """After a kinematics step alone, with the shafts, gears and rods that turn for the eye only."""
    node = shutil.which("node")
    if node is None:
        pytest.skip("no Node.js is on this computer")
    lines = []
    expected = []
    (tmp_path / "gears.xml").write_text(GEARS)
    motors = (Motor("turn", "A"),)
    gears = Robot("gears", HubKind.PRIME, motors, model=str(tmp_path / "gears.xml"))
    robots: list[Robot] = [WALKER, gears]
    spinners = rods = 0
    for number, robot in enumerate(robots):
        body = make_body(robot)
        drawing = drawing_of(body)
        spinners += len(drawing.spinners)
        rods += len(drawing.rods)
        body.data.qpos[:] += np.random.default_rng(number).uniform(-0.3, 0.3, body.model.nq)
        body.update_visuals()
        arrays = {name: getattr(body.data, name).ravel().tolist() for name in ARRAYS}
        # As MuJoCo leaves it alone: the parts that it does not turn stand as in its model.
        for part in (*drawing.spinners, *drawing.rods):
            arrays["xquat"][4 * part.body : 4 * part.body + 4] = [1.0, 0.0, 0.0, 0.0]
        plain = {**drawing.described(), "meshes": []}
        lines.append(json.dumps({"drawing": plain, "arrays": arrays}))
        numbers = [drawn.model_body for drawn in drawing.bodies]
        expected.append(poses(body.data.xpos[numbers], body.data.xquat[numbers]).ravel())
    assert spinners == 1 and rods == 4
    script = one_script("frames.js") + SCRIPT
    ran = subprocess.run(
        [node, "-e", script], input="\n".join(lines), capture_output=True, text=True, check=False
    )
    assert ran.returncode == 0, ran.stderr
    for line, frame in zip(ran.stdout.splitlines(), expected, strict=True):
        seen = np.array(json.loads(line)).reshape(-1, 7)
        wanted = frame.reshape(-1, 7)
        # A quaternion and its negative are one turn.
        seen[:, 3:] *= np.sign((seen[:, 3:] * wanted[:, 3:]).sum(1, keepdims=True))
        assert np.allclose(seen, wanted, atol=1e-6)


def test_one_script_has_all_modules_and_no_import() -> None:
    script = one_script("scene3d.js")
    assert "\nimport " not in script and "\nexport " not in script
    for file in FOLDER.iterdir():
        if file.name != "frames.js":
            (head, *_) = file.read_text(encoding="utf-8").partition("\n")
            assert script.count(head) == 1, file.name


def test_mirror_shows_the_robot_and_its_ghost_from_where_it_is_told() -> None:
    body = make_body(WALKER)
    own = drawing_of(body)
    assert Mirror(body).drawing.view == own.view
    view = View(distance_m=3.0)
    shown = Mirror(body, view).drawing
    assert shown.view == view
    # Each part of the robot has a ghost; what stands in no other place has none.
    ghosts = [one.name for one in shown.bodies[len(own.bodies) :]]
    assert 0 < len(ghosts) <= len(own.bodies)
    assert {name.removeprefix("goal ") for name in ghosts} <= {one.name for one in own.bodies}
    assert all(name.startswith("goal ") for name in ghosts)
