"""Running of programs for LEGO's package, as far as no device is needed."""

from __future__ import annotations

import io
import sys
import time
from pathlib import Path
from typing import Any

import pytest
from kit_world import ROBOT

from brickhub.errors import HubTimeoutError, ProgramError, TwinError
from brickhub.kits import kit_run
from brickhub.kits.kit_run import beside, run_kit_file, run_source
from brickhub.kits.virtual_kit import VirtualKit
from brickhub.robot import HubKind, KitKind, Motor, MotorKind, Robot
from brickhub.virtual.bench_body import BenchBody
from brickhub.virtual.given_readings import parse_reading
from brickhub.virtual.panel import parse_press
from brickhub.virtual.run import Operation, ProgramStopped

PATH = Path("walk.py")


def ran(source: str) -> tuple[int, str]:
    """Exit code of a program, and what it says on standard error."""
    stderr = io.StringIO()
    code = run_source(source, PATH, lambda program: program(), stderr)
    return code, stderr.getvalue()


@pytest.mark.parametrize(
    ("end", "code", "said"),
    [
        ("x = 1", 0, ""),
        ("exit()", 0, ""),
        ("quit(4)", 4, ""),
        ("exit('no motor')", 1, "no motor\n"),
        ("exit([])", 1, ""),
        ("exit(True)", 1, ""),
        ("raise SystemExit", 0, ""),
        ("assert __name__ == '__main__' and __file__ == 'walk.py'", 0, ""),
    ],
)
def test_end_of_a_program(end: str, code: int, said: str) -> None:
    assert ran(f"{end}\n") == (code, said)


def test_traceback_begins_at_the_programs_own_line() -> None:
    code, said = ran("def f():\n    return 1 / 0\n\n\nf()\n")
    assert code == 1
    lines = said.splitlines()
    assert lines[0] == "Traceback (most recent call last):"
    assert lines[1] == '  File "walk.py", line 5, in <module>'
    assert lines[-1] == "ZeroDivisionError: division by zero"
    assert "kit_run.py" not in said
    code, said = ran("x = = 1\n")
    assert code == 1
    assert said.splitlines()[-1].startswith("SyntaxError")


def test_program_that_was_stopped() -> None:
    def stop(program: object) -> None:
        raise ProgramStopped

    stderr = io.StringIO()
    assert run_source("x = 1\n", PATH, stop, stderr) == 0
    assert stderr.getvalue() == "The program was stopped (SystemExit).\n"

    def time_out(program: object) -> None:
        raise HubTimeoutError("nothing answered")

    with pytest.raises(HubTimeoutError, match="nothing answered"):
        run_source("x = 1\n", PATH, time_out, stderr)


def test_program_finds_what_lies_beside_it_and_its_own_arguments(tmp_path: Path) -> None:
    arguments, path = sys.argv, list(sys.path)
    program = tmp_path / "walk.py"

    def fail() -> None:
        with beside(program):
            assert sys.argv == [str(program)]
            assert sys.path == [str(tmp_path), *path]
            sys.path.append("elsewhere")
            raise ZeroDivisionError

    with pytest.raises(ZeroDivisionError):
        fail()
    assert sys.argv is arguments
    assert sys.path == path


BENCH = BenchBody(ROBOT, readings={"light": lambda angles: 50.0})
HUB = BenchBody(Robot("rover", HubKind.PRIME))


@pytest.mark.parametrize(
    ("body", "operation", "says"),
    [
        (
            None,
            Operation(presses=[parse_press("left@1s")]),
            "the devices of LEGO's kits have no buttons that a program reads; leave out the",
        ),
        (
            None,
            Operation(devices={"A": MotorKind.SPIKE_LARGE}),
            "the bench of LEGO's kits has a Double Motor, a Single Motor and a Color Sensor; leave",
        ),
        (
            BENCH,
            Operation(readings=[parse_reading("D=red")]),
            "readings, end stops and devices on ports are for the bench; omit them, or the robot",
        ),
        (
            BENCH,
            Operation(end_stops={"C": (-9.0, 9.0)}),
            "readings, end stops and devices on ports are for the bench; omit them, or the robot",
        ),
        (
            BENCH,
            Operation(devices={"A": None}),
            "readings, end stops and devices on ports are for the bench; omit them, or the robot",
        ),
        (
            HUB,
            Operation(),
            "'rover' has a prime hub, not devices of LEGO's kits; take --robot cart",
        ),
    ],
)
def test_what_does_not_suit_a_kit_is_refused(
    tmp_path: Path, body: Any, operation: Operation, says: str
) -> None:
    program = tmp_path / "walk.py"
    program.write_text("import legoeducation\n")
    with pytest.raises(TwinError, match=says):
        run_kit_file(program, body, operation=operation)


def test_file_and_time_limit_are_looked_at_first(tmp_path: Path) -> None:
    program = tmp_path / "walk.py"
    with pytest.raises(ProgramError, match="cannot read the program"):
        run_kit_file(program)
    program.write_text("x = 1\n")
    with pytest.raises(ProgramError, match="the time limit is -1 s"):
        run_kit_file(program, time_limit_s=-1)


def kit_of(body: Any, **operation: Any) -> VirtualKit:
    return kit_run._kit(body, Operation(**operation), VirtualKit)


def test_bench_has_a_device_of_each_kind() -> None:
    kit = kit_of(None)
    assert [peer.address for peer in kit.peers] == [
        "virtual-AB",
        "virtual-C",
        "virtual-D",
        "virtual-controller",
    ]
    assert not kit.is_realtime
    assert kit_of(None, realtime=True).is_realtime
    assert kit_of(BENCH).robot is ROBOT
    assert kit_of(BENCH, realtime=True).is_realtime


def test_both_wheels_turn_the_bench() -> None:
    """Wheels of 56 mm, 112 mm apart: the left one is mounted the other way round."""
    kit = kit_of(None)
    for port in "AB":
        kit.machine.servos[port].setup_plain(ROBOT.motors[1].direction)
        kit.machine.servos[port].dc(-100)
    kit.sleep(1.0)
    turned_deg = kit.body.heading_deg()
    wheels_deg = [kit.body.angle_mdeg(port) / 1000 for port in "AB"]
    assert turned_deg == pytest.approx(-sum(wheels_deg) / 4, abs=2)
    assert turned_deg > 100


def test_clock_of_a_program_is_that_of_the_devices() -> None:
    kit = kit_of(None)
    began_s = time.time()
    with kit_run._clock_of(kit):
        clock: Any = sys.modules["time"]
        assert clock is not time
        assert clock.monotonic() == clock.perf_counter() == 0.0
        assert clock.time() == pytest.approx(began_s, abs=5.0)
        kit.sleep(1.5)
        assert clock.monotonic() == clock.perf_counter() == 1.5
        assert clock.monotonic_ns() == clock.perf_counter_ns() == 1_500_000_000
        assert clock.time() == pytest.approx(began_s + 1.5, abs=5.0)
        assert clock.time_ns() == pytest.approx((began_s + 1.5) * 1e9, abs=5e9)
        assert clock.sleep == kit.wait
        assert clock.strftime is time.strftime
    assert sys.modules["time"] is time


def test_devices_of_two_robots_have_seeds_of_their_own() -> None:
    one = Robot("one", KitKind.SINGLE_MOTOR, (Motor("a", "A"),))
    seeds = []
    for seed in (0, 1, 2):
        kit = VirtualKit(BenchBody(one), seed=seed)
        seeds += [peer._radio._rng.random() for peer in kit.peers]
    assert len(set(seeds)) == 6
