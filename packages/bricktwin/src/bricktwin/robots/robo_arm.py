"""The RoboArm: a turntable, two joints and a gripper on a fixed base."""

from __future__ import annotations

from brickhub.robot import HubKind, Motor, Robot

ROBO_ARM = Robot(
    name="robo-arm",
    hub=HubKind.PRIME,
    motors=(
        Motor("rotation", "B", gears=(20, 60)),
        Motor("low", "D", range_deg=(10, 70), speed_limit_deg_s=500, acceleration_deg_s2=1000, torque_limit_mnm=900),
        Motor("high", "A", range_deg=(-150, 10)),
        Motor("grab", "E", range_deg=(-148, -45)),
    ),
    needs_imu=False,
    model="bricktwin.robots.plans:robo_arm.ldr",
)
