"""Couplings between joints of a model: gears, loops and shafts, on bodies that a test turns."""

from __future__ import annotations

from types import SimpleNamespace
from typing import Any

import mujoco
import numpy as np
import pytest

from bricktwin.twin.engines.conventions import TIMESTEP_S
from bricktwin.twin.models import mjcf
from bricktwin.twin.models.turning import add_coupling, add_gears, add_loop, add_spinner


def wheels(*names: str) -> mujoco.MjSpec:
    """Wheels of 10 g side by side, each on a joint about its axis."""
    spec = mujoco.MjSpec()
    spec.compiler.degree = False
    mjcf.set_options(spec)
    spec.option.gravity = [0.0, 0.0, 0.0]
    for number, name in enumerate(names):
        body = spec.worldbody.add_body(name=f"body_{name}", pos=[0.1 * number, 0.0, 0.0])
        body.add_joint(name=name, axis=[0.0, 1.0, 0.0], armature=1e-5)
        body.add_geom(size=[0.01, 0.0, 0.0], mass=0.01, contype=0, conaffinity=0)
    return spec


def turned(spec: mujoco.MjSpec, torque_nm: float, seconds: float = 0.4) -> list[float]:
    """Angles of all joints after a torque on the first one."""
    model = spec.compile()
    data = mujoco.MjData(model)
    data.qfrc_applied[0] = torque_nm
    mujoco.mj_step(model, data, round(seconds / TIMESTEP_S))
    return [float(value) for value in data.qpos]


@pytest.mark.parametrize("is_loaded", [False, True])
@pytest.mark.parametrize("ratio", [0.5, -3.0])
def test_a_geared_joint_turns_by_its_ratio_of_the_motors(ratio: float, is_loaded: bool) -> None:
    spec = wheels("motor_B", "finger")
    geared: Any = SimpleNamespace(port="B", ratio=ratio)
    add_coupling(spec, geared, "geared", "finger", is_loaded=is_loaded)
    motor, finger = turned(spec, 1e-4)
    assert motor > 0.05
    assert finger == pytest.approx(ratio * motor, abs=0.02 * abs(ratio * motor))
    # What carries the robot is held as firmly as can be: by a time constant of two steps.
    (constraint,) = spec.equalities
    assert bool(constraint.solref[0] == 2 * TIMESTEP_S) is is_loaded
    assert bool(constraint.solimp[0] > 0.95) is is_loaded


def test_gears_keep_the_sum_of_the_turns_by_their_coefficients() -> None:
    spec = wheels("case", "left", "right")
    # A differential: both axles turn as its case does on average.
    add_gears(spec, "gears", [("case", 1.0), ("left", -0.5), ("right", -0.5)])
    case, left, right = turned(spec, 1e-4)
    assert case > 0.2 and left == pytest.approx(right)
    assert case == pytest.approx((left + right) / 2, abs=0.01)
    alone = wheels("case", "left", "right")
    assert turned(alone, 1e-4)[1:] == [0.0, 0.0]


def test_gears_keep_what_their_sum_is_at_first() -> None:
    spec = wheels("one", "other")
    for joint, angle in (("one", 0.3), ("other", -0.7)):
        spec.joint(joint).ref = angle
    add_gears(spec, "gears", [("one", 1.0), ("other", 1.0)])
    one, other = turned(spec, 1e-4)
    assert one > 0.35 and one + other == pytest.approx(-0.4, abs=0.01)


def test_a_loop_holds_two_bodies_together_at_a_pin() -> None:
    """Two levers side by side, 4 cm apart, and a bar on the first that is pinned to the second."""
    spec = mujoco.MjSpec()
    mjcf.set_options(spec)
    levers = []
    for number in range(2):
        lever = spec.worldbody.add_body(name=f"lever_{number}", pos=[0.04 * number, 0.0, 0.0])
        lever.add_joint(name=f"turn_{number}", axis=[0.0, 1.0, 0.0])
        lever.add_geom(size=[0.005, 0.0, 0.0], pos=[0.0, 0.0, 0.03], mass=0.01)
        levers.append(lever)
    bar = levers[0].add_body(name="bar", pos=[0.0, 0.0, 0.03])
    bar.add_joint(name="pin", axis=[0.0, 1.0, 0.0])
    bar.add_geom(size=[0.005, 0.0, 0.0], pos=[0.02, 0.0, 0.0], mass=0.005)
    for geom in spec.geoms:
        geom.contype = geom.conaffinity = 0
    add_loop(spec, "loop", bar, levers[1], (0.04, 0.0, 0.0))
    model = spec.compile()
    data = mujoco.MjData(model)
    mujoco.mj_forward(model, data)
    data.qfrc_applied[0] = 2e-4
    furthest = 0.0
    for _ in range(100):
        mujoco.mj_step(model, data, 2)
        end = data.body("bar").xpos + data.body("bar").xmat.reshape(3, 3) @ [0.04, 0.0, 0.0]
        tip = data.body("lever_1").xpos + data.body("lever_1").xmat.reshape(3, 3) @ [0, 0, 0.03]
        assert end == pytest.approx(tip, abs=3e-4)
        # A parallelogram: both levers turn alike, and the bar stays level.
        first, second = (float(data.joint(f"turn_{number}").qpos[0]) for number in range(2))
        assert second == pytest.approx(first, abs=0.02)
        furthest = max(furthest, abs(first))
    assert furthest > 0.3
    (constraint,) = spec.equalities
    assert constraint.solref.tolist() == [2 * TIMESTEP_S, 1.0]


def test_a_shaft_says_by_name_and_numbers_how_it_turns() -> None:
    spec = mujoco.MjSpec()
    carrier = spec.worldbody.add_body(name="carrier")
    follower: Any = SimpleNamespace(port="D", ratio=-2.5, axis=np.array([0.0, 0.6, -0.8]))
    body = add_spinner(carrier, 7, follower, (0.1, 0.2, 0.3))
    assert body.name == "spin_D_7" and body.pos.tolist() == [0.1, 0.2, 0.3]
    # Its ratio, and the axis about which counterclockwise is positive.
    assert list(body.userdata) == pytest.approx([-2.5, 0.0, -0.6, 0.8])
