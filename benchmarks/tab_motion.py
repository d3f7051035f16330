"""Motion of the robots in robots' files, on whatever engine is here: in a tab's worker MuJoCo's
JavaScript build, else Python's, of any version. A script, for :mod:`benchmarks.tab_physics`.

    python tab_motion.py ASKED

ASKED is a file of JSON: ``files`` (paths of robots' files, by name), ``starts`` (seeds),
``duration_s``, ``program``, a hub program that is run in place of swinging voltages, ``bench``, how
often it runs on the bench, and ``trials``, of a search for a gait that the robots make instead, by
the seeds. It prints a line of JSON for each robot and start.
"""

import io
import json
import math
import random
import statistics
import sys
import time
from pathlib import Path
from typing import Any

from bricktwin.site.tab.robot_file import body_of
from bricktwin.twin.body import TwinBody

SAMPLE_MS = 10
READ_MS = 100
FULL_MV = 6000
PHASE_RAD = 0.5


def engine_of(text: str) -> Any:
    """The engine that is here, of a robot's file."""
    if "start_engine" in globals():
        from bricktwin.site.tab.js_engine import JsEngine

        return JsEngine(globals()["start_engine"](text))
    import mujoco

    from bricktwin.twin.engines.mujoco_engine import MujocoEngine

    file = json.loads(text)
    model = mujoco.MjModel.from_xml_string(file["mjcf"])
    for name, values in file.get("fields", {}).items():
        getattr(model, name).reshape(-1)[:] = values
    # Robots that share a world are put together of their parts' numbers.
    for name, first, values in file.get("pieces", ()):
        getattr(model, name).reshape(-1)[first : first + len(values)] = values
    return MujocoEngine(model)


def cpu_s() -> float:
    """CPU time so far. In a tab's worker Python itself knows wall time only."""
    clock = globals().get("cpu_seconds", time.process_time)
    return float(clock())


def drive(
    body: TwinBody,
    time_ms: int,
    phases: list[float] | None = None,
) -> None:
    """Apply voltages that swing, each motor's at a phase of its own, rad: a radian behind that of
    the motor before it, if none are given."""
    if phases is None:
        phases = [float(number) for number in range(len(body.robot.motors))]
    for motor, phase in zip(body.robot.motors, phases, strict=True):
        body.set_voltage(motor.port, int(FULL_MV * math.sin(0.004 * time_ms + phase)))


def drawn_phases(body: TwinBody, start: int) -> list[float]:
    """Phases of a start, each motor's behind that of the one before. Else all starts of a robot
    with legs on a bare floor would be one motion, turned."""
    rng = random.Random(start)
    return [number + rng.uniform(-PHASE_RAD, PHASE_RAD) for number in range(len(body.robot.motors))]


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


def move(
    body: TwinBody,
    start: int,
    duration_s: float,
) -> dict[str, Any]:
    """Positions after each 10 ms of the first second, and means over all."""
    phases = drawn_phases(body, start)
    positions = []
    read = []
    for time_ms in range(SAMPLE_MS, round(duration_s * 1000) + 1, SAMPLE_MS):
        drive(body, time_ms, phases)
        body.advance_to(time_ms)
        if time_ms <= 1000:
            positions.append(list(body.engine.qpos))
        if time_ms % READ_MS == 0:
            read.append(readings(body))
    means = {name: statistics.fmean(one[name] for one in read) for name in read[0]}
    return {"positions": positions, "means": means}


def compile_here() -> None:
    """Let the tab's own compiler do it, in a tab. It has to be there before what imports it."""
    if "compile_in_tab" in globals():
        from bricktwin.site.tab.mpy_cross import put_in_place

        put_in_place(globals()["compile_in_tab"])


def run(body: TwinBody | None, program: str, duration_s: float) -> dict[str, Any]:
    """Run a hub program on a body."""
    compile_here()
    from brickhub.virtual.run import run_file

    output = io.BytesIO()
    errors = io.StringIO()
    run_file(
        Path(program),
        body,
        stdout=output,
        stderr=errors,
        time_limit_s=duration_s,
    )
    return {"printed": output.getvalue().decode(), "errors": errors.getvalue()}


class Trials:
    """A page that keeps what it is told of trials."""

    def __init__(self) -> None:
        self.made: list[dict[str, Any]] = []

    def frame(self) -> None:
        """Draw nothing."""

    def post(self, events: str, rows: bytes) -> None:
        told = json.loads(events or "[]")
        self.made += [event for event in told if event["kind"] == "trial"]

    def take(self) -> str:
        return ""

    def may_go_on(self, time_ms: int) -> bool:
        return True


def teach(
    body: TwinBody,
    seed: int,
    trials: int,
    numbers: list[float] | None = None,
) -> dict[str, Any]:
    """Let a robot search for a gait, or try its numbers; scores of the trials, null for a fall."""
    compile_here()
    from bricktwin.site.tab.teach import teach_in_tab

    page = Trials()
    request = {
        "goal": "walk",
        "seed": seed,
        "state": None,
        "trials": trials,
        "numbers": numbers,
    }
    teach_in_tab(json.dumps(request), page, body)
    scores = [None if one["fell"] else one["score"] for one in page.made]
    seconds = sum(one["seconds"] for one in page.made)
    return {"scores": scores, "robot_s": seconds}


def main(path: str) -> None:
    """Move the robots that are asked for."""
    asked = json.loads(Path(path).read_text(encoding="utf-8"))
    duration_s = asked["duration_s"]
    for _ in range(asked.get("bench", 0)):
        started_s = cpu_s()
        ran = run(None, asked["program"], duration_s)
        about = {"robot": "bench", "cpu_s": cpu_s() - started_s}
        sys.stdout.write(json.dumps({**about, **ran}) + "\n")
    for name, file in asked["files"].items():
        text = Path(file).read_text(encoding="utf-8")
        for start in asked["starts"]:
            # A body stands on an engine of its own, as in each run of the tab.
            engine = engine_of(text)
            body = body_of(json.loads(text), engine, seed=start)
            first = body.pose()
            started_s = cpu_s()
            if asked.get("trials"):
                moved = teach(body, start, asked["trials"], asked.get("numbers"))
            elif asked.get("program"):
                moved = run(body, asked["program"], duration_s)
            else:
                moved = move(body, start, duration_s)
            used_s = cpu_s() - started_s
            last = body.pose()
            way_mm = 1000 * math.hypot(last.x_m - first.x_m, last.y_m - first.y_m)
            about = {
                "robot": name,
                "start": start,
                "cpu_s": used_s,
                "speed_mm_s": way_mm / duration_s,
                "turned_deg": last.heading_deg - first.heading_deg,
            }
            sys.stdout.write(json.dumps({**about, **moved}) + "\n")
            if hasattr(engine, "end"):
                engine.end()


if __name__ == "__main__":
    main((globals().get("ARGUMENTS") or sys.argv[1:])[0])
