"""Motion of the robot in a robot's file, on whatever engine is here: in a tab's worker MuJoCo's
JavaScript build, else Python's, of any version. A script, for :mod:`benchmarks.tab_physics`.

    python tab_motion.py SEED DURATION_S FILE...

It prints a line of JSON for each file: positions, readings, and CPU time.
"""

import json
import math
import sys
import time
from pathlib import Path
from typing import Any

from bricktwin.site.tab.robot_file import body_of
from bricktwin.twin.body import TwinBody

SAMPLE_MS = 10
READ_MS = 100
FULL_MV = 6000


def engine_of(text: str) -> Any:
    """The engine that is here."""
    if "start_engine" in globals():
        from bricktwin.site.tab.js_engine import JsEngine

        return JsEngine(globals()["start_engine"](text))
    import mujoco

    from bricktwin.twin.mujoco_engine import MujocoEngine

    file = json.loads(text)
    model = mujoco.MjModel.from_xml_string(file["mjcf"])
    for name, values in file["fields"].items():
        getattr(model, name).reshape(-1)[:] = values
    return MujocoEngine(model)


def cpu_s() -> float:
    """CPU time so far. In a tab's worker Python itself knows wall time only."""
    clock = globals().get("cpu_seconds", time.process_time)
    return float(clock())


def drive(body: TwinBody, time_ms: int) -> None:
    """Apply voltages that swing, each motor's behind that of the one before."""
    for number, motor in enumerate(body.robot.motors):
        phase = 0.004 * time_ms + number
        body.set_voltage(motor.port, int(FULL_MV * math.sin(phase)))


def readings(body: TwinBody) -> dict[str, float]:
    """Present readings of all sensors, by name."""
    read = {}
    for motor in body.robot.motors:
        read[f"angle {motor.name}"] = body.angle_mdeg(motor.port) / 1000
    several = {
        "tilt": body.tilt_deg(),
        "gyro": body.angular_velocity_deg_s(),
        "acceleration": body.acceleration_mm_s2(),
    }
    for name, values in several.items():
        read.update({f"{name} {number}": value for number, value in enumerate(values)})
    read["heading"] = body.heading_deg()
    for sensor in body.robot.sensors:
        if sensor.kind.model.range_mm is not None:
            read[sensor.name] = float(body.distance_mm(sensor.port))
            continue
        for sense in sensor.kind.model.senses:
            value = body.sensed(sensor.port, sense)
            # Of a colour the brightness, the last of three.
            read[f"{sensor.name} {sense.value}"] = value[-1] if isinstance(value, tuple) else value
    return read


def move(body: TwinBody, duration_s: float) -> dict[str, Any]:
    """Positions after each 10 ms, readings after each 100 ms, and the mean speed."""
    positions = []
    read = []
    first = body.pose()
    started_s = cpu_s()
    steps = round(duration_s * 1000 / SAMPLE_MS)
    for step in range(1, steps + 1):
        now_ms = step * SAMPLE_MS
        drive(body, now_ms)
        body.advance_to(now_ms)
        positions.append(list(body.engine.qpos))
        if now_ms % READ_MS == 0:
            read.append(readings(body))
    used_s = cpu_s() - started_s
    last = body.pose()
    way_mm = 1000 * math.hypot(last.x_m - first.x_m, last.y_m - first.y_m)
    return {
        "positions": positions,
        "readings": read,
        "cpu_s": used_s,
        "speed_mm_s": way_mm / duration_s,
        "turned_deg": last.heading_deg - first.heading_deg,
    }


def main(arguments: list[str]) -> None:
    """Move the robot of each file."""
    seed, duration_s, *files = arguments
    for name in files:
        text = Path(name).read_text(encoding="utf-8")
        body = body_of(json.loads(text), engine_of(text), seed=int(seed))
        moved = {"file": Path(name).name, **move(body, float(duration_s))}
        sys.stdout.write(json.dumps(moved) + "\n")


if __name__ == "__main__":
    main(globals().get("ARGUMENTS") or sys.argv[1:])
