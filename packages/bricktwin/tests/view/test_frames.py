"""Frames that JavaScript makes from MuJoCo's arrays, beside those of Python."""

from __future__ import annotations

import json
import shutil
import subprocess
from pathlib import Path

import numpy as np
import pytest

from brickhub.robot import Robot
from bricktwin.robots import ROBO_ARM, WALKER, plans
from bricktwin.robots.planned import robot_of_plan
from bricktwin.twin.make_body import make_body
from bricktwin.view.body_drawing import drawing_of
from bricktwin.view.drawing import poses
from bricktwin.view.script import FOLDER, one_script

PLANS = Path(plans.__path__[0])
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


def test_frames_are_those_of_python() -> None:
    """After a kinematics step alone, with the shafts, gears and rods that turn for the eye only."""
    node = shutil.which("node")
    if node is None:
        pytest.skip("no Node.js is on this computer")
    lines = []
    expected = []
    robots: list[Robot] = [WALKER, ROBO_ARM, *map(robot_of_plan, sorted(PLANS.glob("*.ldr")))]
    turned = 0
    for number, robot in enumerate(robots):
        body = make_body(robot)
        drawing = drawing_of(body)
        turned += len(drawing.spinners) + len(drawing.rods)
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
    assert turned > 10
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
