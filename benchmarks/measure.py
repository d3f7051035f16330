"""Two minutes with a robot: what `twin measure` finds of drawn virtual robots, beside what they
are.

    python -m benchmarks measure

Each robot has random physics, with one of the links of the virtual hub, and is handled by a person
who errs by a degree and a second. The measurement sees what a real hub sends. Takes two minutes.
"""

from __future__ import annotations

from dataclasses import replace
from typing import Any

import numpy as np

from benchmarks.session import Session
from brickhub.hub.interface import Interface, Wait, YawRate
from brickhub.hub.link.lockstep import HubLink
from brickhub.hub.link.profiles import PROFILES
from brickhub.robot import Robot
from brickhub.virtual.virtual_transport import VirtualHub
from bricktwin.measure.hands import SimulatedPerson
from bricktwin.measure.results import LATE_MS, compare, virtual
from bricktwin.measure.session import LIFT, measure
from bricktwin.robots import TWO_WHEELER, WALKER
from bricktwin.twin.mujoco_body import MujocoBody
from bricktwin.twin.physics import Physics, RandomPhysics

ROBOTS = (TWO_WHEELER, WALKER, TWO_WHEELER, WALKER, TWO_WHEELER)
EXCHANGES = 10_000
SPIN_MS = 1500
GRAVITY_MM_S2 = 9810.0
LIMITS = {
    "link p50, ms": 3.0,
    "link p95, %": 20.0,
    "link over 150 ms, times": 2.0,
    "motors, %": 3.0,
    "gyro scale, %": 0.3,
    "drift, deg/min": 0.15,
    "tilt, deg": 0.2,
    "distance, mm": 5.0,
}
"""Largest errors that are allowed."""


def link_delays_ms(hub: VirtualHub, robot: Robot) -> Any:
    """Many exchanges of a robot at rest."""
    with HubLink(hub, robot, Interface((), (YawRate(),), Wait(1))) as link:
        return np.array([link.read().round_trip_s * 1000 for _ in range(EXCHANGES)])


def true_speeds_deg_s(robot: Robot, physics: Physics) -> dict[str, float]:
    """Speed of each motor in the hand, from the physics alone, by name."""
    speeds = {}
    for motor in robot.motors:
        hub = virtual(robot, replace(physics, encoder_resolution_deg=0.001))
        body = hub.body
        assert isinstance(body, MujocoBody)
        SimulatedPerson(hub, np.random.default_rng(0)).begin(LIFT)
        ways, now_ms = [], 0
        for voltage_mv in (body.battery_mv, -body.battery_mv):
            body.set_voltage(motor.port, voltage_mv)
            body.advance_to(now_ms + SPIN_MS)
            before = body.angle_mdeg(motor.port)
            now_ms += 2 * SPIN_MS
            body.advance_to(now_ms)
            ways.append(abs(body.angle_mdeg(motor.port) - before) / SPIN_MS)
        speeds[motor.name] = sum(ways) / 2
    return speeds


def errors(robot: Robot, seed: int) -> dict[str, Any]:
    """Errors of the measurement of one drawn robot."""
    rng = np.random.default_rng(seed)
    physics = RandomPhysics().sample(rng)
    if seed % 3 == 0:
        physics = physics.with_link(PROFILES["bad-room"])
    hub = virtual(robot, physics, seed)
    log = measure(hub, robot, SimulatedPerson(hub, rng), {})
    robot_s = hub.now_s()
    found = compare(log, robot)
    fitted, numbers = found.fitted(), found.robot
    delays_ms = link_delays_ms(hub, robot)
    p50, p95 = np.percentile(delays_ms, (50, 95))
    share_pct = max(100.0 * float(np.mean(delays_ms > LATE_MS)), 1e-9)
    late_pct = max(numbers[f"link, over {LATE_MS:g} ms"], 1e-9)
    speeds = true_speeds_deg_s(robot, physics)
    tilts = [
        abs(getattr(fitted, name) - getattr(physics, name))
        for name in ("acceleration_bias_x_mm_s2", "acceleration_bias_y_mm_s2")
    ]
    return {
        "robot": robot.name,
        "seed": seed,
        "robot_time_s": round(robot_s, 1),
        "errors": {
            "link p50, ms": abs(numbers["link, median"] - p50),
            "link p95, %": 100.0 * abs(numbers["link, 95 of 100 within"] / p95 - 1.0),
            "link over 150 ms, times": max(late_pct / share_pct, share_pct / late_pct),
            "motors, %": max(
                100.0 * abs(numbers[f"speed of {name}, free"] / speed - 1.0)
                for name, speed in speeds.items()
            ),
            "gyro scale, %": abs(fitted.gyro_scale_error_pct - physics.gyro_scale_error_pct),
            "drift, deg/min": abs(fitted.gyro_drift_deg_min - physics.gyro_drift_deg_min),
            "tilt, deg": float(np.degrees(np.arctan(max(tilts) / GRAVITY_MM_S2))),
            "distance, mm": abs(fitted.distance_bias_mm - physics.distance_bias_mm),
        },
    }


def main(session: Session) -> None:
    """Measure all and write the result."""
    session.parser.add_argument(
        "--seeds", type=int, nargs="+", default=list(range(1, len(ROBOTS) + 1))
    )
    args = session.parse()
    rows = []
    for number, seed in enumerate(args.seeds):
        row = errors(ROBOTS[number % len(ROBOTS)], seed)
        row["errors"] = {name: round(float(value), 3) for name, value in row["errors"].items()}
        print(row, flush=True)
        rows.append(row)
    worst = {name: max(row["errors"][name] for row in rows) for name in LIMITS}
    print(
        {
            name: (value, LIMITS[name], "ok" if value <= LIMITS[name] else "TOO MUCH")
            for name, value in worst.items()
        },
        flush=True,
    )
    session.write({"robots": rows, "worst": worst, "limits": LIMITS})
