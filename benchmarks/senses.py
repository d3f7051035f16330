"""Sensors of the virtual robots: what they read, nominal and at the ends of their random ranges,
beside what is published.

    python -m benchmarks senses

Each reading is printed by a Pybricks program on the virtual hub of a 2Wheeler. Takes a minute.
"""

from __future__ import annotations

import io
import statistics
import tempfile
from collections.abc import Callable
from dataclasses import dataclass
from pathlib import Path
from typing import Any

from benchmarks.session import Session
from brickhub.virtual.run import run_file
from bricktwin.robots import TWO_WHEELER
from bricktwin.twin.mujoco_body import MujocoBody
from bricktwin.twin.objects import Wall
from bricktwin.twin.physics import PARAMETERS, Physics
from bricktwin.twin.scene import OPEN_FLOOR, Scene

SEEDS = 5
HEAD = """
from pybricks.hubs import PrimeHub
from pybricks.parameters import Axis, Direction, Port
from pybricks.pupdevices import Motor, UltrasonicSensor
from pybricks.robotics import DriveBase
from pybricks.tools import wait
hub = PrimeHub()
left, right, eyes = Motor(Port.E, Direction.COUNTERCLOCKWISE), Motor(Port.A), UltrasonicSensor(Port.C)
hub.imu.reset_heading(0)
"""  # noqa: E501
BASE = "base = DriveBase(left, right, 56, 130)\n"


def repeated(expression: str, readings: int = 300) -> str:
    """A program that prints readings, one every 20 ms."""
    return f"for _ in range({readings}):\n    print({expression})\n    wait(20)\n"


@dataclass(frozen=True)
class Measure:
    """A measurement.

    Attributes:
        published: what others measured, or the maker says.
        parameter: parameter of the physics whose range it shows; "" for none.
        program: after ``HEAD``; prints numbers.
        value: measured value, from the body and the numbers printed.
    """

    name: str
    unit: str
    published: str
    parameter: str
    program: str
    value: Callable[[MujocoBody, list[float]], float]
    scene: Scene = OPEN_FLOOR

    def at(self, physics: Physics, seed: int = 0) -> float:
        """The value of a robot of these physics."""
        body, out = MujocoBody(TWO_WHEELER, self.scene, physics, seed), io.BytesIO()
        with tempfile.TemporaryDirectory() as folder:
            path = Path(folder) / "main.py"
            path.write_text(HEAD + self.program)
            if run_file(path, body, stdout=out):
                raise AssertionError(f"{self.name}: the program failed")
        return self.value(body, [float(word) for word in out.getvalue().split()])


def mean(_: MujocoBody, numbers: list[float]) -> float:
    """Mean of the numbers."""
    return statistics.fmean(numbers)


def spread(_: MujocoBody, numbers: list[float]) -> float:
    """Standard deviation of the numbers."""
    return statistics.stdev(numbers)


def missed(_: MujocoBody, numbers: list[float]) -> float:
    """Share of the numbers that are 2000, in percent."""
    return 100.0 * sum(number == 2000 for number in numbers) / len(numbers)


def wall(angle_deg: float) -> Scene:
    """A hard wall, half a metre ahead, seen at an angle."""
    return Scene(wall_distance_mm=(500.0, 500.0), heading_deg=(angle_deg, angle_deg))


TURN = f"{BASE}base.turn(1080)\nwait(500)\nprint(hub.imu.heading())"
DRIVE = f"{BASE}base.straight(1000)\nprint(hub.imu.heading())"
APPROACH = (
    f"{BASE}base.drive(200, 0)\nwhile eyes.distance() >= 2000:\n    wait(10)\n"
    "print(eyes.distance())\nbase.stop()"
)
EXCHANGED = """
base = DriveBase(right, left, 56, 130)
base.use_gyro(True)
base.straight(1500, wait=False)
wait(4000)
print(abs(hub.imu.heading()))
"""
CURTAIN = Scene(objects=(Wall((2300, -800), (2300, 800), height_mm=400, soft=True),))
REST = "wait(60000)\nprint(hub.imu.heading())"
GYRO, BIAS, EYES = "angular_velocity(Axis.Z)", "acceleration_bias_{}_mm_s2", "eyes.distance()"
MEASURES = (
    Measure(
        "heading for a turn by 360 degrees", "deg", "362.8 and 363.4", "gyro_scale_error_pct", TURN,
        lambda body, read: 360.0 * read[0] / body.pose().heading_deg,
    ),
    Measure("heading after a minute at rest", "deg", "0.37", "gyro_drift_deg_min", REST, mean),
    Measure("noise of the gyroscope", "deg/s", "0.1", "gyro_noise_deg_s",
        repeated(f"hub.imu.{GYRO}"), spread),
    Measure("pitch at rest", "deg", "0.7 to 1.1", BIAS.format("x"), repeated("hub.imu.tilt()[0]"),
        mean),
    Measure("roll at rest", "deg", "0.7 to 1.1", BIAS.format("y"), repeated("hub.imu.tilt()[1]"),
        mean),
    Measure(
        "vertical acceleration at rest", "mm/s2", "9810 +- 120 to 184", BIAS.format("z"),
        repeated("hub.imu.acceleration(Axis.Z)"), mean,
    ),
    Measure("distance of a wall at 500 mm", "mm", "500 +- 20", "distance_bias_mm", repeated(EYES),
        mean, wall(0)),
    Measure("readings of it that fail", "%", "", "distance_dropout_share", repeated(EYES, 1000),
        missed, wall(0)),
    Measure("distance of a wall at 30 degrees", "mm", "", "echo_angle_deg", repeated(EYES), mean,
        wall(30)),
    Measure("distance of a wall at 45 degrees", "mm", "", "echo_angle_deg", repeated(EYES), mean,
        wall(45)),
    Measure("distance of a wall at 60 degrees", "mm", "", "echo_angle_deg", repeated(EYES), mean,
        wall(60)),
    Measure("first distance of a curtain, approaching", "mm", "1500", "soft_range_mm", APPROACH,
        mean, CURTAIN),
    Measure("heading after 1 m straight, without gyroscope", "deg", "", "wheel_difference_pct",
        DRIVE, mean),
)  # fmt: skip
SPIN = Measure(
    "left and right exchanged, gyroscope on",
    "deg",
    "spins on the spot (pybricks/support#1220)",
    "",
    EXCHANGED,
    mean,
)


def main(session: Session) -> None:
    """Measure all and write the result."""
    session.parse()
    rows: list[dict[str, Any]] = []
    for one in MEASURES:
        parameter = PARAMETERS[one.parameter]
        low, high = (one.at(Physics(**{one.parameter: end})) for end in parameter.random_range)
        row = {"nominal": one.at(Physics()), "low": low, "high": high}
        rows.append(
            {
                "name": one.name,
                "unit": one.unit,
                "published": one.published,
                "parameter": one.parameter,
                **{name: round(value, 3) for name, value in row.items()},
                "source": parameter.source,
            }
        )
        print(*rows[-1].values(), sep=", ", flush=True)
    spins = [round(SPIN.at(Physics(), seed), 1) for seed in range(SEEDS)]
    print(SPIN.name, spins, flush=True)
    session.write(
        {
            "rows": rows,
            "exchanged": {"name": SPIN.name, "published": SPIN.published, "heading_deg": spins},
        }
    )
