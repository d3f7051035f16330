"""Logs of runs: they say what happened, and change nothing."""

from __future__ import annotations

import csv
import io
import signal
import subprocess
import sys
from pathlib import Path

import pytest

from brickhub.cli import main
from brickhub.virtual import run_log
from brickhub.virtual.given_readings import parse_reading
from brickhub.virtual.machine import Machine
from brickhub.virtual.run import Operation, run_file
from brickhub.virtual.run_log import RunLog

DEVICES = """
from pybricks.hubs import PrimeHub
from pybricks.iodevices import PUPDevice
from pybricks.parameters import Color, Direction, Port, Stop
from pybricks.pupdevices import ColorSensor, DCMotor, ForceSensor, Motor, UltrasonicSensor
from pybricks.robotics import DriveBase
from pybricks.tools import multitask, run_task, wait
hub = PrimeHub()
left, right = Motor(Port.A, Direction.COUNTERCLOCKWISE), Motor(Port.B)
"""
EVERYTHING = (
    DEVICES
    + """
base = DriveBase(left, right, 56, 112)
base.use_gyro(True)
eye, button, eyes = ColorSensor(Port.C), ForceSensor(Port.D), UltrasonicSensor(Port.E)
base.straight(70)
print(eye.color(), eye.hsv(), eye.reflection(), eye.ambient(), button.force(), button.pressed(), eyes.distance())
print(hub.imu.heading(), hub.imu.tilt(), left.angle(), right.speed(), left.load(), left.stalled())
async def turn():
    await base.turn(45)
    print(hub.imu.heading())
async def watch():
    for _ in range(20):
        print(await eye.hsv(), await eyes.distance(), left.angle(), left.model.state())
        await wait(7)
run_task(multitask(turn(), watch()))
print(PUPDevice(Port.C).read(5), PUPDevice(Port.D).read(0))
left.run_until_stalled(300, Stop.COAST, 40)
print(left.angle(), left.load(), left.control.stalled(), hub.imu.stationary())
left.close()
wait(200)
print(DCMotor(Port.F), left.speed())
"""  # noqa: E501
)
READINGS = ("C=120,80,50", "D=4N", "E=300mm")


def logged(
    folder: Path, source: str, log: RunLog | None, readings: tuple[str, ...] = READINGS
) -> str:
    """What a program prints."""
    path, out, err = folder / "main.py", io.BytesIO(), io.StringIO()
    path.write_text(source)

    def attend(machine: Machine) -> None:
        machine.log = log

    operation = Operation(readings=[parse_reading(text) for text in readings], attend=attend)
    assert run_file(path, stdout=out, stderr=err, operation=operation) == 0, err.getvalue()
    return out.getvalue().decode()


def test_a_run_with_a_log_is_the_same_as_one_without(tmp_path: Path) -> None:
    log = RunLog()
    assert logged(tmp_path, EVERYTHING, log) == logged(tmp_path, EVERYTHING, None)
    last = list(log.rows())[-1]
    assert {
        "C_color",
        "C_hue_deg",
        "C_ambient_pct",
        "D_pressed",
        "E_distance_mm",
        "C_RGB_I_3",
        "D_FORCE",
    } <= last.keys()


def test_motors_are_logged_as_the_program_sees_them(tmp_path: Path) -> None:
    log = RunLog()
    source = """
right.run(400)
for _ in range(8):
    wait(50)
    print(right.angle(), right.speed(), right.load())
right.stop()
wait(100)
"""
    printed = logged(tmp_path, DEVICES + source, log).splitlines()
    rows = {row["time_s"]: row for row in log.rows()}
    for number, line in enumerate(printed, 1):
        row = rows[50 * number / 1000]
        assert isinstance(row["B_angle_deg"], float)
        assert [round(row["B_angle_deg"]), row["B_speed_deg_s"], row["B_load_mnm"]] == list(
            map(float, line.split())
        )
        assert row["B_voltage_mv"] is not None and row["A_voltage_mv"] is None, (
            "one runs, one coasts"
        )
    assert rows[0.41]["B_voltage_mv"] is None


def test_sensors_are_logged_when_the_program_reads_them(tmp_path: Path) -> None:
    near = tmp_path / "near.csv"
    near.write_text("0, 500\n0.1, 200\n")
    source = """
wait(50)
eyes = UltrasonicSensor(Port.E)
for _ in range(3):
    print(eyes.distance())
    wait(60)
button = ForceSensor(Port.D)
button.pressed()
"""
    log = RunLog()
    logged(tmp_path, DEVICES + source, log, (f"E=@{near}", "D=4N"))
    rows = {row["time_s"]: row for row in log.rows()}
    assert [rows[time]["E_distance_mm"] for time in (0.05, 0.06, 0.11, 0.12, 0.18)] == [
        None,
        500,
        500,
        200,
        200,
    ]
    assert [row["D_pressed"] for row in rows.values()][-2:] == [None, 1], (
        "the last row has what was read last"
    )


def test_the_table_is_rectangular(tmp_path: Path) -> None:
    log = RunLog()
    see = "eye = ColorSensor(Port.C)\neye.detectable_colors([Color(10, 20, 30)])\neye.color()\n"
    source = f"wait(25)\n{see}wait(20)\nMotor(Port.D)\n"
    logged(tmp_path, DEVICES + source, log, ("C=10,20,30",))
    header, *rows = csv.reader(log.csv().splitlines())
    assert (
        header[:5] == ["time_s", "A_angle_deg", "A_speed_deg_s", "A_load_mnm", "A_voltage_mv"]
        and header[-1] == "D_voltage_mv"
    )
    assert {len(row) for row in rows} == {len(header)}
    assert [row[0] for row in rows] == [*(f"0.0{i}0" for i in range(1, 8)), "0.076"]
    assert [row[header.index("C_color")] for row in rows] == [
        *[""] * 5,
        *["Color(h=10, s=20, v=30)"] * 3,
    ]


def test_a_long_log_is_thinned_out(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(run_log, "_MOST_ROWS", 50)
    log = RunLog()
    logged(tmp_path, DEVICES + "right.run(100)\nwait(2000)\n", log)
    times = [row["time_s"] for row in log.rows()]
    assert log.period_ms == 80 and times == [80 * number / 1000 for number in range(1, 26)]


ENDS = {
    "raises": ("right.run(100)\nwait(100)\n1/0", (), 1, 10),
    "exits": ("right.run(100)\nwait(100)\nraise SystemExit", (), 0, 10),
    "is stopped": ("right.run(100)\nwhile True:\n    wait(10)", ("--time-limit-s", "0.3"), 124, 30),
    "does nothing": ("", (), 0, 1),
}


@pytest.mark.parametrize("end", ENDS)
def test_the_log_is_written_however_the_run_ends(
    end: str, tmp_path: Path, capfd: pytest.CaptureFixture[str]
) -> None:
    source, options, code, count = ENDS[end]
    path, log = tmp_path / "main.py", tmp_path / "new" / "run.csv"
    path.write_text(DEVICES + source)
    assert main(["run", str(path), "--log", str(log), *options]) == code, capfd.readouterr().err
    assert len(log.read_text().splitlines()) == 1 + count


@pytest.mark.skipif(sys.platform == "win32", reason="Windows sends no Ctrl-C to one process")
def test_the_log_is_written_after_ctrl_c(tmp_path: Path) -> None:
    path, log = tmp_path / "main.py", tmp_path / "run.csv"
    path.write_text(
        DEVICES
        + (
            "print('go')\nwhile True:\n    try:\n        wait(10)\n    except BaseException:\n"
            "        pass\n"
        )
    )
    command = [sys.executable, "-m", "brickhub", "run", str(path), "--log", str(log), "--realtime"]
    with subprocess.Popen(
        command, stdout=subprocess.PIPE, stderr=subprocess.PIPE, text=True
    ) as process:
        assert process.stdout is not None and process.stderr is not None
        assert process.stdout.readline() == "go\n"
        process.send_signal(signal.SIGINT)
        assert process.wait(30) == 130
        assert (
            process.stderr.read() == f"interrupted: the program was stopped; its log is in {log}\n"
        )
    assert log.read_text().startswith("time_s,A_angle_deg,")


def test_what_cannot_be_logged_is_refused_before_the_run(
    tmp_path: Path, capfd: pytest.CaptureFixture[str]
) -> None:
    path, log = tmp_path / "main.py", tmp_path / "run.csv"
    path.write_text("print('ran')")
    log.write_text("of yesterday")
    assert main(["run", str(path), "--log", str(log), "--reading", "Z=red"]) == 2
    assert main(["run", str(path), "--log", str(log), "--hub", "ble"]) == 2
    assert main(["run", str(path), "--log", str(tmp_path)]) == 2
    out, err = capfd.readouterr()
    assert out == "" and "leave out --hub, or --log" in err and f"cannot write {tmp_path}" in err
    assert log.read_text() == "of yesterday"
