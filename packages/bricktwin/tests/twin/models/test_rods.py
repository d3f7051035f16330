from __future__ import annotations

import mujoco
import numpy as np
import pytest

from bricktwin.twin.engines.mujoco_engine import MujocoEngine
from bricktwin.twin.models.turning import add_rod
from bricktwin.twin.models.turning_parts import TurningParts


def swing() -> mujoco.MjModel:
    """A pendulum of 0.1 m on a horizontal frame, coupled to a sledge by a rod of 0.25 m."""
    spec = mujoco.MjSpec()
    spec.option.gravity, spec.option.timestep = [-9.81, 3.0, 0.0], 0.0005
    frame = spec.worldbody.add_body(name="frame", quat=[0.5, 0.5, 0.5, 0.5])
    sledge = frame.add_body(name="sledge", pos=[0.0, 0.0, -0.2])
    sledge.add_joint(type=mujoco.mjtJoint.mjJNT_SLIDE, axis=[1, 0, 0])
    bob = frame.add_body(name="bob", pos=[0.15, 0.0, 0.1])
    bob.add_joint(type=mujoco.mjtJoint.mjJNT_HINGE, axis=[0, 1, 0])
    for body in (sledge, bob):
        body.add_geom(type=mujoco.mjtGeom.mjGEOM_SPHERE, size=[0.01, 0, 0], mass=0.11)
    rod = add_rod(spec, "arm", (sledge, (0.0, 0.0, 0.0)), (bob, (0.0, 0.0, -0.1)))
    rod.add_geom(
        type=mujoco.mjtGeom.mjGEOM_CAPSULE, fromto=[0, 0, 0, 0, 0, 0.25], size=[0.003, 0, 0], mass=0
    )
    return spec.compile()


def tip(data: mujoco.MjData) -> np.ndarray[tuple[int], np.dtype[np.float64]]:
    """End of the drawn rod."""
    end: np.ndarray[tuple[int], np.dtype[np.float64]] = (
        data.body("rod_arm").xmat.reshape(3, 3)[:, 2] * 0.25
    )
    return data.body("rod_arm").xpos + end


class TestRod:
    def test_rod_length_is_constant(self) -> None:
        model = swing()
        data, seen, lengths = mujoco.MjData(model), [], []
        for _ in range(500):
            mujoco.mj_step(model, data)
            seen.append(data.qpos.copy())
            lengths.append(
                float(
                    np.linalg.norm(data.site("rod_arm_far").xpos - data.site("rod_arm_near").xpos)
                )
            )
        assert np.ptp(seen, axis=0).min() > 0.05
        assert lengths == pytest.approx([0.25] * 500, abs=1e-4)

    def test_rod_mass_is_halved(self) -> None:
        model = swing()
        assert model.body("sledge").mass == pytest.approx(0.11)
        assert model.body("bob").mass == pytest.approx(0.11)
        assert model.body("rod_arm").mass == 0.0

    def test_rod_is_drawn_between_pins(self) -> None:
        model = swing()
        data = mujoco.MjData(model)
        rods = TurningParts(MujocoEngine(model, model, data))
        for _ in range(5):
            mujoco.mj_step(model, data, 60)
            mujoco.mj_kinematics(model, data)
            rods.turn()
            assert data.body("rod_arm").xpos == pytest.approx(
                data.site("rod_arm_near").xpos, abs=1e-9
            )
            assert tip(data) == pytest.approx(data.site("rod_arm_far").xpos, abs=1e-4)

    def test_drawing_rod_does_not_change_motion(self) -> None:
        def motion(draws: bool) -> bytes:
            model = swing()
            data = mujoco.MjData(model)
            rods = TurningParts(MujocoEngine(model, model, data))
            for _ in range(20):
                mujoco.mj_step(model, data, 10)
                if draws:
                    mujoco.mj_kinematics(model, data)
                    rods.turn()
            return data.qpos.tobytes()

        assert motion(True) == motion(False)

    def test_rods_of_one_motor_have_its_name_and_a_number(self) -> None:
        spec = mujoco.MjSpec()
        bodies = [spec.worldbody.add_body(pos=[0.1 * number, 0.0, 0.0]) for number in range(3)]
        for body in bodies:
            body.add_geom(size=[0.01, 0, 0])
        rods = [
            add_rod(spec, "A", (bodies[0], (0.0, 0.0, 0.0)), (far, (0.0, 0.0, 0.0)))
            for far in bodies[1:]
        ]
        assert [rod.name for rod in rods] == ["rod_A", "rod_A_1"]
        model = spec.compile()
        assert model.tendon_length0.tolist() == pytest.approx([0.1, 0.2])
        assert len(TurningParts(MujocoEngine(model)).rods) == 2

    @pytest.mark.parametrize("name", ["box", "rod_box", "spin_box"])
    @pytest.mark.parametrize("user_numbers", [0, 1, 4])
    def test_users_model_without_such_parts_is_unchanged(
        self, name: str, user_numbers: int
    ) -> None:
        spec = mujoco.MjSpec()
        spec.nuser_body = user_numbers
        spec.worldbody.add_body(name=name, pos=[0.1, 0.0, 0.0], quat=[0.8, 0.6, 0.0, 0.0])
        model = spec.compile()
        data = mujoco.MjData(model)
        mujoco.mj_kinematics(model, data)
        before = (model.body_quat.copy(), data.xpos.copy(), data.xquat.copy())
        TurningParts(MujocoEngine(model, model, data)).turn()
        after = (model.body_quat, data.xpos, data.xquat)
        assert all(map(np.array_equal, before, after))
