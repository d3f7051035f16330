"""Settings of the IMU while the hub turns. The factors are those of the firmware (v4.1.0b2, built
for a computer), measured."""

from __future__ import annotations

import io
from pathlib import Path

import pytest

from brickhub.robot import HubKind, Robot
from brickhub.virtual.bench_body import BenchBody
from brickhub.virtual.run import run_file

RATE_DEG_S = 90.0


class TurningHub(BenchBody):
    """Turns to the left, level, and measures too much acceleration downwards."""

    def angular_velocity_deg_s(self) -> tuple[float, float, float]:
        return 0.0, 0.0, RATE_DEG_S

    def heading_deg(self) -> float:
        return -RATE_DEG_S * self._time_ms / 1000

    def acceleration_mm_s2(self) -> tuple[float, float, float]:
        return 1000.0, 0.0, 9700.0


def numbers(tmp_path: Path, source: str) -> list[float]:
    program, out, err = tmp_path / "main.py", io.BytesIO(), io.StringIO()
    head = (
        "from pybricks.hubs import PrimeHub\nfrom pybricks.parameters import Axis\n"
        "from pybricks.tools import wait\n"
    )
    program.write_text(f"{head}imu = PrimeHub().imu\n{source}", encoding="utf-8")
    assert (
        run_file(program, TurningHub(Robot("hub", HubKind.PRIME)), stdout=out, stderr=err) == 0
    ), err.getvalue()
    return [float(line) for line in out.getvalue().decode().split()]


def test_a_corrected_gyroscope_counts_on_from_where_it_was(tmp_path: Path) -> None:
    source = (
        "wait(1000)\nprint(imu.heading())\n"
        "imu.settings(angular_velocity_scale=(360, 360, 350))\nprint(imu.heading())\n"
    )
    source += (
        "print(imu.angular_velocity(Axis.Z))\n"
        "print(imu.angular_velocity(Axis.Z, calibrated=False))\n"
    )
    source += (
        "print(imu.rotation(Axis.Z) / imu.rotation(Axis.Z, calibrated=False))\nwait(1000)\n"
        "print(imu.heading())\n"
    )
    before, after, rate, raw_rate, ratio, later = numbers(tmp_path, source)
    assert before == after == pytest.approx(-RATE_DEG_S, abs=0.2)
    assert (rate, raw_rate) == pytest.approx((RATE_DEG_S * 360 / 350, RATE_DEG_S))
    assert ratio == pytest.approx(360 / 350)
    assert later - after == pytest.approx(-RATE_DEG_S * 360 / 350, abs=0.2)


def test_acceleration_is_corrected_unless_the_raw_one_is_asked_for(tmp_path: Path) -> None:
    source = "imu.settings(acceleration_correction=(9900, -9700, 9806, -9806, 9700, -9700))\n"
    source += (
        "print(imu.acceleration(Axis.X))\nprint(imu.acceleration(Axis.Z))\n"
        "print(imu.acceleration(Axis.X, calibrated=False))\n"
    )
    source += "print(imu.tilt()[0])\nprint(imu.tilt(calibrated=False)[0])"
    x, z, raw_x, pitch, raw_pitch = numbers(tmp_path, source)
    # half a step of the sensor
    assert (x, z, raw_x) == pytest.approx((900 * 9806.65 / 9800, 9806.65, 1000), abs=1.2)
    assert (pitch, raw_pitch) == pytest.approx((0.0, -5.886), abs=0.001)


def test_rotation_counts_on_from_where_it_was_and_is_uncalibrated_by_the_present_factor(
    tmp_path: Path,
) -> None:
    source = (
        "wait(1000)\nbefore = imu.rotation(Axis.Z)\n"
        "imu.settings(angular_velocity_scale=(360, 360, 350))\n"
    )
    source += (
        "print(imu.rotation(Axis.Z) - before)\n"
        "print(imu.rotation(Axis.Z, calibrated=False) / before)\nwait(1000)\n"
    )
    counted_on, ratio, later = numbers(tmp_path, source + "print(imu.rotation(Axis.Z) - before)")
    assert (counted_on, ratio) == pytest.approx((0.0, 350 / 360), abs=0.001)
    assert later == pytest.approx(RATE_DEG_S * 360 / 350, abs=0.2)


def test_a_hub_on_its_side_is_calibrated_by_its_vertical_axis(tmp_path: Path) -> None:
    program, out = tmp_path / "main.py", io.BytesIO()
    program.write_text(
        "from pybricks.hubs import PrimeHub\n"
        "from pybricks.parameters import Axis, Direction, Port\n"
        "from pybricks.pupdevices import Motor\n"
        "imu = PrimeHub(top_side=Axis.Y, front_side=Axis.X).imu\n"
        "imu.settings(angular_velocity_scale=(355, 370, 350))\n"
        "left, right = Motor(Port.A, Direction.COUNTERCLOCKWISE), Motor(Port.B)\n"
        "left.run_angle(500, 720)\n"
        "print(imu.heading() * 370 / 360, imu.rotation(-Axis.Z) * 370 / 360, "
        "imu.rotation(-Axis.Z, calibrated=False))\n",
        encoding="utf-8",
    )
    assert run_file(program, stdout=out, stderr=io.StringIO()) == 0
    assert [float(word) for word in out.getvalue().split()] == pytest.approx([180.0] * 3, abs=1)
