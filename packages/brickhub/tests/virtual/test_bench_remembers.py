"""What a bench is given and keeps: angles at which motors stand, storage, the hub's name."""

from __future__ import annotations

import io
from pathlib import Path

import pytest

from brickhub.cli import main
from brickhub.errors import DescriptionError, TwinError
from brickhub.virtual.given_readings import parse_device, parse_reading, parse_start
from brickhub.virtual.run import Operation, run_file

ANGLES = """
from pybricks.pupdevices import Motor
from pybricks.parameters import Direction, Port
print(Motor(Port.A).angle(), Motor(Port.B, gears=[12, 36]).angle())
print(Motor(Port.C, Direction.COUNTERCLOCKWISE).angle(), Motor(Port.D).angle())
"""
COUNTER = """
from pybricks.hubs import PrimeHub
system = PrimeHub().system
count = system.storage(0, read=1)[0]
system.storage(0, write=bytes([count + 1]))
print(system.name(), system.info()["name"], count)
"""


def run(tmp_path: Path, source: str, **operation: object) -> str:
    path, out = tmp_path / "main.py", io.BytesIO()
    path.write_text(source)
    run_file(path, stdout=out, stderr=io.StringIO(), operation=Operation(**operation))
    return out.getvalue().decode()


def test_motors_stand_where_they_are_put(tmp_path: Path) -> None:
    starts = {"A": 90.0, "B": -120.0, "C": 45.0}
    assert run(tmp_path, ANGLES, starts=starts) == "90 -40\n-45 0\n"


def test_motor_without_absolute_sensor_counts_from_zero(
    tmp_path: Path, capfd: pytest.CaptureFixture[str]
) -> None:
    devices = dict(map(parse_device, ("A=interactive", "B=spike-large")))
    starts = {"A": 90.0, "B": 90.0}
    assert run(tmp_path, ANGLES, starts=starts, devices=devices).splitlines()[0] == "0 30"
    path = tmp_path / "main.py"
    words = ("--port", "A=interactive", "--start", "A=90")
    assert main(("run", str(path), *words)) == 0
    assert "The motor on port A does not know its angle" in capfd.readouterr().err


@pytest.mark.parametrize("text", ["A", "A=", "A=x", "A=180", "A=-181", "A=nan", "Z9=5", "=5"])
def test_invalid_start_is_refused(text: str) -> None:
    with pytest.raises(DescriptionError, match="is not a start angle; give one such as A=90"):
        parse_start(text)


@pytest.mark.parametrize(
    ("option", "first", "second"),
    [
        ("--start", "A=90", "a=45"),
        ("--port", "B=interactive", "B=spike-large"),
        ("--port", "B=interactive", "B=mine.py:GAUGE"),
        ("--end-stop", "C=-90..120", "C=-10..10"),
    ],
)
def test_a_port_that_is_named_twice_is_refused(
    tmp_path: Path, capfd: pytest.CaptureFixture[str], option: str, first: str, second: str
) -> None:
    path = tmp_path / "main.py"
    path.write_text(ANGLES)
    assert main(("run", str(path), option, first, option, second)) == 2
    assert capfd.readouterr().err == (
        f"error: {option} names port {first[0]} twice; name it once\n"
    )


def test_two_readings_of_one_sense_are_refused(
    tmp_path: Path, capfd: pytest.CaptureFixture[str]
) -> None:
    source = "from pybricks.pupdevices import ColorSensor\nfrom pybricks.parameters import Port\n"
    source += "eye = ColorSensor(Port.B)\nprint(eye.reflection(), eye.ambient())\n"
    differing = [parse_reading(text) for text in ("B=40%", "B.ambient=20%")]
    assert run(tmp_path, source, readings=differing) == "29 2.0\n"
    words = ("--reading", "B=40%", "--reading", "B=red")
    assert main(("run", str(tmp_path / "main.py"), *words)) == 1
    assert "TwinError: port B has two readings of surface; give one\n" in capfd.readouterr().err


def test_start_beyond_end_stops_is_refused(tmp_path: Path) -> None:
    with pytest.raises(TwinError, match="starts at 90 deg, beyond its end stops"):
        run(tmp_path, ANGLES, starts={"A": 90.0}, end_stops={"A": (-10.0, 10.0)})
    with pytest.raises(TwinError, match="has no port F1|has no port"):
        run(tmp_path, ANGLES, starts={"F1": 90.0})


def test_storage_lasts_and_the_hub_has_its_name(tmp_path: Path) -> None:
    kept = tmp_path / "hub.bin"
    for count in range(3):
        said = run(tmp_path, COUNTER, storage=kept, hub_name="Team 7")
        assert said == f"Team 7 Team 7 {count}\n"
    assert len(kept.read_bytes()) == 512
    assert run(tmp_path, COUNTER) == "Pybricks Hub Pybricks Hub 0\n", "without it, it forgets"
    # A program that fails has stored what it has stored.
    run(tmp_path, COUNTER + "raise ValueError\n", storage=kept)
    assert kept.read_bytes()[0] == 4
    for other in (bytes(513), b"print(1)\n"):
        kept.write_bytes(other)
        with pytest.raises(TwinError, match="and this hub stores 512: another file, or another"):
            run(tmp_path, COUNTER, storage=kept)
        assert kept.read_bytes() == other, "another file is not written over"
    kept.write_bytes(b"")
    assert run(tmp_path, COUNTER, storage=kept).endswith(" 0\n")


def test_command(tmp_path: Path, capfdbinary: pytest.CaptureFixture[bytes]) -> None:
    path = tmp_path / "main.py"
    path.write_text(ANGLES + COUNTER)
    words = ("--start", "A=90", "--storage", str(tmp_path / "hub.bin"), "--hub-name", "Ada")
    assert main(("run", str(path), *words)) == 0
    assert capfdbinary.readouterr().out == b"90 0\n0 0\nAda Ada 0\n"
    assert (tmp_path / "hub.bin").exists()
