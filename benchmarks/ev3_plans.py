"""Plans by others with an EV3: what each lacks for a twin, and what it does there.

    python -m benchmarks ev3_plans FOLDER

Reads those files below the folder that ``plans_of_others.csv`` names and that have an EV3 Brick.
None of them says ports, so ports are given in the order of the lines: A to D to the motors, 1 to 4
to the sensors. Where several motors sit on one axle, as few as possible are left out, the last
ones first. A program on the virtual brick then turns all motors for two seconds, of those on one
gear the first, so that those that drive wheels roll forwards, and reads all sensors.
"""

from __future__ import annotations

import hashlib
import io
import itertools
import math
import tempfile
from collections import Counter
from pathlib import Path
from typing import Any

from benchmarks.plans_of_others import ENDINGS
from benchmarks.session import Session
from brickhub.robot import HubKind, Robot
from brickhub.tables import read_table
from brickhub.virtual.run import run_file
from bricksrl.errors import BricksError, PlanError
from bricktwin.plans.check import check
from bricktwin.plans.ldraw_text import read_text
from bricktwin.plans.part import DeviceKind
from bricktwin.plans.plan import Plan, read_plan
from bricktwin.plans.planned_robot import planned_robot
from bricktwin.robots.plan_facts import read_facts
from bricktwin.robots.planned import robot_of_plan
from bricktwin.twin.mujoco_body import MujocoBody
from bricktwin.twin.physics import Physics
from bricktwin.twin.scene import OPEN_FLOOR

_MOST_LEFT_OUT = 2
_READINGS = {
    "Ev3ColorSensor": "reflection()",
    "Ev3GyroSensor": "angle()",
    "Ev3InfraredSensor": "distance()",
    "Ev3TouchSensor": "pressed()",
    "Ev3UltrasonicSensor": "distance()",
}


def with_ports(plan: Plan, text: str, dropped: set[int]) -> str:
    """The plan's text with a port for each motor and sensor, and without the motors of some
    lines."""
    ports: dict[int, str] = {}
    motors = [placed for placed in plan.devices(DeviceKind.MOTOR) if placed.line not in dropped]
    sensors = plan.devices(DeviceKind.SENSOR)
    for letters, devices in (("ABCD", motors), ("1234", sensors)):
        ordered = sorted(devices, key=lambda placed: placed.line)
        ports.update(zip((placed.line for placed in ordered), letters, strict=False))
    lines = []
    for number, line in enumerate(text.splitlines(), 1):
        if number in ports:
            lines.append(f"0 !BRICKSRL PORT {ports[number]}")
        # An empty line keeps the numbers of the others.
        lines.append("" if number in dropped else line)
    return "\n".join(lines) + "\n"


def program(robot: Robot, dragged: set[str]) -> str:
    """A program that turns all motors for two seconds but those of some ports, then reads all
    sensors."""
    lines = [
        "from pybricks.ev3devices import *",
        "from pybricks.parameters import Direction, Port",
        "from pybricks.tools import wait",
    ]
    for motor in robot.motors:
        direction = f"Direction.{motor.direction.name}"
        lines.append(f"{motor.name} = Motor(Port.{motor.port}, {direction})")
    for sensor in robot.sensors:
        lines.append(f"{sensor.name} = {sensor.kind.model.class_name}(Port.S{sensor.port})")
    lines += [f"{motor.name}.run(300)" for motor in robot.motors if motor.port not in dragged]
    lines.append("wait(2000)")
    lines += [f"print('{motor.name}', {motor.name}.angle())" for motor in robot.motors]
    for sensor in robot.sensors:
        reading = _READINGS[sensor.kind.value]
        lines.append(f"print('{sensor.name}', {sensor.name}.{reading})")
    return "\n".join(lines) + "\n"


def drive(path: Path) -> dict[str, Any]:
    """What the robot of a plan with ports does. Raises BricksError if it has no twin."""
    robot = robot_of_plan(path, name="robot")
    body = MujocoBody(robot, OPEN_FLOOR, Physics(), 0)
    main, out = path.with_name("main.py"), io.BytesIO()
    main.write_text(program(robot, {port for _, port in planned_robot(path).geared_together}))
    code = run_file(main, body, stdout=out)
    pose = body.pose()
    readings = [line.split(maxsplit=1) for line in out.getvalue().decode().splitlines()]
    return {
        "ended_with": code,
        "mass_g": round(1000 * float(sum(body.model.body_mass))),
        "moved_mm": round(1000 * math.hypot(pose.x_m, pose.y_m)),
        "turned_deg": round(pose.heading_deg),
        "wheels_turned_by_motors": len(planned_robot(path).rolling),
        "read": {line[0]: line[1] for line in readings if len(line) == 2},
    }


def look(path: Path) -> dict[str, Any] | None:
    """What is found in a file; ``None`` if it has no EV3 Brick."""
    try:
        plan, text = read_plan(path), read_text(path)
    except PlanError:
        return None
    hubs = [hub for hub in plan.devices(DeviceKind.HUB) if hub.electric.name == HubKind.EV3.value]
    if not hubs:
        return None
    findings = check(plan)
    counts = Counter(finding.name for finding in findings)
    motors = plan.devices(DeviceKind.MOTOR)
    found: dict[str, Any] = {
        "parts": len(plan.parts),
        "unknown_parts": {one.number: len(one.lines) for one in plan.unknown},
        "motors": dict(Counter(motor.electric.name for motor in motors)),
        "sensors": dict(Counter(one.electric.name for one in plan.devices(DeviceKind.SENSOR))),
        "findings": dict(counts),
        "collisions": [str(one) for one in findings if one.name == "collision"],
        "lacks": [],
    }
    lines = sorted((motor.line for motor in motors), reverse=True)
    choices = itertools.chain.from_iterable(
        itertools.combinations(lines, count) for count in range(_MOST_LEFT_OUT + 1)
    )
    with tempfile.TemporaryDirectory() as folder:
        copy = Path(folder) / "robot.ldr"
        for dropped in choices:
            copy.write_text(with_ports(plan, text, set(dropped)), encoding="utf-8")
            try:
                driven = drive(copy)
            except BricksError as error:
                found["lacks"].append(str(error).replace(str(copy), "the plan"))
                continue
            if dropped:
                named = ", ".join(map(str, sorted(dropped)))
                found["lacks"].append(f"lines {named}: motors that drive what another one drives")
            found["lacks"] += no_twin(copy, driven)
            return {**found, "left_out": sorted(dropped), "driven": driven}
    return {**found, "lacks": list(dict.fromkeys(found["lacks"])), "driven": None}


def no_twin(path: Path, driven: dict[str, Any]) -> list[str]:
    """What of a plan a twin does not have, in words."""
    missing = list(read_facts(path).lacks)
    if not driven["wheels_turned_by_motors"]:
        missing.append("no motor turns a wheel")
    return missing


def main(session: Session) -> None:
    """Look at all, and write what was found."""
    session.parser.add_argument("folder", type=Path)
    folder: Path = session.parse().folder
    names = {
        row["sha256"]: f"{row['repository']}: {row['path']}"
        for row in read_table("benchmarks", "plans_of_others")
    }
    plans = {}
    for path in sorted(folder.rglob("*")):
        if path.suffix.lower() not in ENDINGS:
            continue
        name = names.get(hashlib.sha256(path.read_bytes()).hexdigest())
        found = None if name is None else look(path)
        if found is not None:
            plans[name] = found
            print(name, found, flush=True)
    session.write({"plans": plans})
