"""Running programs for LEGO's package ``legoeducation`` on virtual devices."""

import sys
import time
import traceback
import types
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from pathlib import Path
from typing import TextIO

from brickhub.errors import HubTimeoutError, TwinError
from brickhub.hub.program.run_program import (
    TIME_LIMIT_EXIT_CODE,
    check_time_limit,
    read_program,
    time_limit_note,
)
from brickhub.kits.virtual_kit import VirtualKit
from brickhub.robot import KitKind
from brickhub.virtual.bench_body import FittedBench
from brickhub.virtual.body import Body
from brickhub.virtual.run import Operation, ProgramStopped

BENCH_PORTS = {"A": "Motor", "B": "Motor", "C": "Motor", "D": "ColorSensor"}
"""Bench of a program without a robot: a Double Motor, a Single Motor and a Color Sensor; there is
always a Controller too."""
_TURN_PER_MDEG = -0.25 / 1000.0
"""Clockwise turn of the Double Motor on the bench, for wheels of 56 mm, 112 mm apart."""


def run_kit_file(
    path: Path,
    body: Body | None = None,
    *,
    stderr: TextIO | None = None,
    time_limit_s: float | None = None,
    operation: Operation | None = None,
    kit_class: type[VirtualKit] = VirtualKit,
) -> int:
    """Run a Python program that imports ``legoeducation`` to its end, on virtual devices and in
    their time.

    Args:
        path: the program; imports from its folder work.
        body: the robot; ``None`` for a bench with a device of each kind.
        stderr: for a traceback or a stop message; ``None`` for this process's.
        time_limit_s: simulated seconds until the program is stopped.
        kit_class: virtual devices, and how they and the program take turns.
        operation: readings, pace, and what watches the machine. Buttons are refused: the devices'
            own start no programs.

    Returns:
        Exit code of the program: 1 if it raises, `TIME_LIMIT_EXIT_CODE` if the time limit ends it.

    Raises:
        MediumUnavailableError: LEGO's package is not installed.
        ProgramError: the file cannot be read, or the time limit is invalid.
        TwinError: the robot is not of LEGO's kits, or what is given does not suit it.
    """
    operation = operation or Operation()
    stderr = stderr or sys.stderr
    source = read_program(path)
    check_time_limit(time_limit_s)
    kit = _kit(body, operation, kit_class)
    kit.attach()
    from brickhub.kits.lego_transport import VirtualTransport

    if operation.attend is not None:
        operation.attend(kit.machine)
    VirtualTransport.in_reach.append(kit)
    try:
        with beside(path), _clock_of(kit):
            return run_source(
                source,
                path,
                lambda program: kit.run(program, time_limit_s),
                stderr,
            )
    except HubTimeoutError:
        stderr.write(time_limit_note(time_limit_s or 0.0))
        return TIME_LIMIT_EXIT_CODE
    finally:
        VirtualTransport.in_reach.remove(kit)
        kit.machine.stop_motors()


def run_source(
    source: str,
    path: Path,
    run: Callable[[Callable[[], object]], object],
    stderr: TextIO,
) -> int:
    """Run a Python program to its end; returns its exit code. What it raises is written to
    ``stderr``, but for a HubTimeoutError, which is raised.

    Args:
        path: its name in a traceback.
        run: calls the program.
    """
    try:
        code = compile(source, str(path), "exec")
        namespace = {
            "__name__": "__main__",
            "__file__": str(path),
            # The functions of Python's `site` close standard input, which belongs to this process.
            "exit": sys.exit,
            "quit": sys.exit,
        }
        run(lambda: exec(code, namespace))  # noqa: S102  the user's program
    except ProgramStopped:
        stderr.write("The program was stopped (SystemExit).\n")
    except HubTimeoutError:
        raise
    except SystemExit as end:
        # As in Python, a text is an error and is printed, and nothing is success.
        if isinstance(end.code, str):
            stderr.write(f"{end.code}\n")
        return end.code if isinstance(end.code, int) else int(end.code is not None)
    except Exception as error:  # noqa: BLE001  whatever the user's program raises
        # The traceback begins at the first line of the program, because what is around it is ours.
        trace = error.__traceback__
        while trace is not None and trace.tb_frame.f_code.co_filename != str(path):
            trace = trace.tb_next
        stderr.write("".join(traceback.format_exception(error.with_traceback(trace))))
        return 1
    return 0


def _kit(
    body: Body | None,
    operation: Operation,
    kit_class: type[VirtualKit],
) -> VirtualKit:
    if operation.presses:
        raise TwinError(
            "the devices of LEGO's kits have no buttons that a program reads; leave out the presses"
        )
    on_bench = operation.readings or operation.end_stops or operation.devices
    if body is not None:
        if on_bench:
            raise TwinError(
                "readings, end stops and devices on ports are for the bench; omit them, or "
                "the robot"
            )
        if body.robot.hub.model.runs_programs:
            raise TwinError(
                f"'{body.robot.name}' has a {body.robot.hub.value} hub, not devices of LEGO's "
                "kits; take --robot cart"
            )
        return kit_class(body, realtime=operation.realtime)
    if operation.devices:
        raise TwinError(
            "the bench of LEGO's kits has a Double Motor, a Single Motor and a Color Sensor; "
            "leave out the devices"
        )
    bench = FittedBench(KitKind.DOUBLE_MOTOR, operation.readings, operation.end_stops)
    for port, device in BENCH_PORTS.items():
        bench.plug_in(port, device)
    # Both wheels turn the bench, so that a turn by the IMU has an end there.
    bench.put_on_wheels({"A": _TURN_PER_MDEG, "B": _TURN_PER_MDEG})
    sensor_ports = [port for port, device in BENCH_PORTS.items() if device != "Motor"]
    return kit_class(bench, realtime=operation.realtime, sensor_ports=sensor_ports)


@contextmanager
def beside(path: Path) -> Iterator[None]:
    """Context in which a program finds what lies beside it, and its own arguments."""
    arguments_before = sys.argv
    path_before = sys.path[:]
    sys.argv = [str(path)]
    sys.path.insert(0, str(path.parent))
    try:
        yield
    finally:
        sys.argv = arguments_before
        # The same list is filled again, because others may hold it.
        sys.path[:] = path_before


@contextmanager
def _clock_of(kit: VirtualKit) -> Iterator[None]:
    """Context in which a program's clock is that of the devices."""
    before = sys.modules["time"]
    # The program gets a `time` module of its own. LEGO's package and ours have already imported
    # Python's, and keep real time.
    sys.modules["time"] = _clock(kit)
    try:
        yield
    finally:
        sys.modules["time"] = before


def _clock(kit: VirtualKit) -> types.ModuleType:
    """Module ``time`` of a program: its sleep and its clocks are those of the devices."""
    clock = types.ModuleType("time")
    vars(clock).update(vars(time))
    clock.sleep = kit.wait  # type: ignore[attr-defined]
    # The time of day begins now. The other clocks begin at 0, because a program only takes
    # differences of them.
    began_s = time.time()
    for name, offset_s in (("monotonic", 0.0), ("perf_counter", 0.0), ("time", began_s)):
        setattr(clock, name, _clock_in_s(kit, offset_s))
        setattr(clock, f"{name}_ns", _clock_in_ns(kit, offset_s))
    return clock


def _clock_in_s(kit: VirtualKit, offset_s: float) -> Callable[[], float]:
    return lambda: offset_s + kit.now_s()


def _clock_in_ns(kit: VirtualKit, offset_s: float) -> Callable[[], int]:
    return lambda: round((offset_s + kit.now_s()) * 1e9)
