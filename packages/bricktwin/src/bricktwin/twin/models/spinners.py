"""Spinners: shafts and gears of a model that turn visually only, found by the names of their bodies."""

from __future__ import annotations

import mujoco
import numpy as np

from bricktwin.plans.geometry import Floats

PREFIX = "spin_"


class Spinners:
    """Shafts and gears of a model that turn visually only."""

    def __init__(self, model: mujoco.MjModel) -> None:
        self._spinners: list[tuple[int, int, float, Floats]] = []
        """Body, address of the joint's position, ratio and axis [3] of each."""
        for body in range(model.nbody if model.nuser_body else 0):
            robot, slash, name = model.body(body).name.rpartition("/")  # "ROBOT/" in an arena
            if name.startswith(PREFIX):
                ratio, *axis = model.body_user[body, :4].tolist()
                address = int(model.joint(f"{robot}{slash}motor_{name.split('_')[1]}").qposadr[0])
                self._spinners.append((body, address, ratio, np.array(axis)))

    def turn(self, model: mujoco.MjModel, data: mujoco.MjData) -> None:
        """Turn each with its motor's joint; positions must be up to date, and are so afterwards."""
        if not self._spinners:
            return
        for body, address, ratio, axis in self._spinners:
            angle = ratio * float(data.qpos[address] - model.qpos0[address])
            mujoco.mju_axisAngle2Quat(model.body_quat[body], axis, angle)
        mujoco.mj_kinematics(model, data)
