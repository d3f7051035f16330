"""Motors of the twins against LEGO's data sheets: free, under load, and at a stall, at 7.2 V.

    python -m benchmarks motors

A motor of each kind turns on a stand in the twin: without load, against a constant torque, and
against one that grows until the shaft stands still. LEGO's sheets give each speed within 15 %.
Motors without a sheet have the curves that Pybricks measured. Takes a few seconds.
"""

from __future__ import annotations

from typing import Any

import mujoco

from benchmarks.session import Session
from brickhub.robot import HubKind, Motor, MotorKind, Robot
from brickhub.virtual.firmware.motor_model import MOTOR_TYPES
from bricktwin.twin.models import mjcf
from bricktwin.twin.models.motors import SHEET_V, SHEETS
from bricktwin.twin.models.mounts import add_hub_site, hub_axes
from bricktwin.twin.mujoco_body import MujocoBody
from bricktwin.twin.physics import Physics
from bricktwin.twin.scene import OPEN_FLOOR, Scene

PORT = "A"
LOAD_NM = 0.035
"""Load of a motor without a sheet."""
GROWTH_NM, STILL_RAD_S = 0.00002, 0.1
"""Growth of the load in 5 ms; a shaft that turns more slowly than a turn a minute stands still."""


def stand(robot: Robot, scene: Scene) -> mujoco.MjSpec:
    """Model of one motor on a fixed base."""
    spec = mjcf.new_spec(robot.name, scene)
    base = spec.worldbody.add_body(name="base", pos=[0.0, 0.0, 0.1])
    add_hub_site(base, hub_axes(robot.hub_sides))
    rotor = mjcf.add_rotor(spec, base, robot.motors[0], (0.0, 0.0, 0.0))
    mjcf.add_light(rotor)
    return spec


class Stand:
    """A motor on the stand, at 7.2 V from the start."""

    def __init__(self, kind: MotorKind, *, battery_v: float = SHEET_V) -> None:
        hubs = (HubKind.PRIME, HubKind.EV3)
        robot = Robot(
            "stand",
            next(hub for hub in hubs if hub.model.takes(kind.model)),
            motors=(Motor("motor", PORT, kind),),
            model=f"{__name__}:stand",
            needs_imu=False,
        )
        self.body = MujocoBody(robot, OPEN_FLOOR, Physics(battery_v=battery_v, battery_ohm=0.0), 0)
        self.body.set_voltage(PORT, round(battery_v * 1000))
        self.time_ms = 0

    def turn(self, load_nm: float, for_ms: int) -> float:
        """Mean speed against a load, rpm."""
        before_mdeg = self.body.angle_mdeg(PORT)
        self.body.data.qfrc_applied[0] = -load_nm
        self.time_ms += for_ms
        self.body.advance_to(self.time_ms)
        return (self.body.angle_mdeg(PORT) - before_mdeg) / for_ms / 6.0

    def speed_rpm(self, load_nm: float) -> float:
        """Steady speed against a load."""
        self.turn(load_nm, 1500)
        return self.turn(load_nm, 2000)

    def stall_nm(self) -> float:
        """Load at which the shaft stands still."""
        load_nm = 0.0
        while self.body.data.qvel[0] > STILL_RAD_S or load_nm == 0.0:
            load_nm += GROWTH_NM
            self.turn(load_nm, 5)
        return load_nm


def measure(kind: MotorKind) -> dict[str, Any]:
    """Free, loaded and stalled, in the twin and by the sheet."""
    sheet = SHEETS.get(kind.model.like or kind.value)
    load_nm = sheet.load_nm if sheet else LOAD_NM
    twin = {
        "free_rpm": Stand(kind).speed_rpm(0.0),
        "loaded_rpm": Stand(kind).speed_rpm(load_nm),
        "stall_ncm": 100 * Stand(kind).stall_nm(),
        "stall_full_battery_ncm": 100 * Stand(kind, battery_v=8.3).stall_nm(),
    }
    by_sheet = sheet and {
        "free_rpm": sheet.free_rpm,
        "loaded_rpm": sheet.loaded_rpm,
        "stall_ncm": 100 * sheet.stall_nm,
    }
    return {
        "load_ncm": round(100 * load_nm, 2),
        "twin": {name: round(value, 1) for name, value in twin.items()},
        "sheet": by_sheet or None,
        "deviation_pct": {
            name: round(100 * (twin[name] / value - 1), 1)
            for name, value in (by_sheet or {}).items()
        },
        "firmware_rated_deg_s": MOTOR_TYPES[kind].max_speed_deg_s,
    }


def main(session: Session) -> None:
    """Measure all kinds of motors and write."""
    session.parse()
    results = {}
    for kind in MotorKind:
        results[kind.value] = measure(kind)
        print(kind.value, results[kind.value], flush=True)
    session.write({"volts": SHEET_V, "motors": results})
