"""Random programs on the virtual hub and on the firmware, built for a computer.

    git clone --branch v4.1.0b2 https://github.com/pybricks/pybricks-micropython
    cd pybricks-micropython
    sed -i 's/% 16/% 50000/' lib/pbio/drv/clock/clock_test.c
    sed -i 's/initial_angle = 123456/initial_angle = 0/' lib/pbio/platform/virtual_hub/platform.c
    make -C bricks/virtualhub BUILD=build CI_MODE=1
    FIRMWARE=pybricks-micropython/bricks/virtualhub/build/pybricks-virtualhub
    python -m benchmarks firmware_programs $FIRMWARE

A program is the same if both print the same, to the last digit. The others are kept in ``--keep``
with both outputs. The firmware is changed twice: its clock stands still while a program computes,
and its motors start at 0 degrees, as here. It compiles programs with ``pybricksdev``, which has to
be on the path.
"""

from __future__ import annotations

import io
import random
import re
import subprocess
import tempfile
from collections.abc import Callable
from concurrent.futures import ThreadPoolExecutor
from pathlib import Path
from typing import Any

from benchmarks.session import Session
from brickhub.virtual.run import run_file

FIRMWARE = "v4.1.0b2"
HEAD = """from pybricks.parameters import Direction, Port, Stop
from pybricks.pupdevices import Motor
from pybricks.robotics import DriveBase
from pybricks.tools import StopWatch, multitask, run_task, wait

s = StopWatch()
"""
STOPS = ("Stop.HOLD", "Stop.BRAKE", "Stop.COAST", "Stop.COAST_SMART", "Stop.NONE")
BRANCH = "if s.time() < 0: print()"
TIME_LIMIT_S = 300.0
NO_END = "no end"
_TIMEOUT_S = 60.0


def motor_command(rng: random.Random, motor: str) -> str:
    """A command that ends at once."""
    speed = rng.choice((-1, 1)) * rng.randint(0, 1100)
    return rng.choice(
        (
            f"{motor}.run({speed})",
            f"{motor}.dc({rng.randint(-100, 100)})",
            f"{motor}.track_target({rng.randint(-400, 400)})",
            f"{motor}.stop()",
            f"{motor}.brake()",
            f"{motor}.hold()",
            f"{motor}.reset_angle({rng.randint(-400, 400)})",
            *(f"{call[:-1]}, wait=False)" for call in motor_moves(rng, motor)),
        )
    )


def motor_moves(rng: random.Random, motor: str) -> tuple[str, ...]:
    """Commands that end after a movement."""
    speed, then = rng.choice((-1, 1)) * rng.randint(20, 1100), rng.choice(STOPS)
    return (
        f"{motor}.run_time({speed}, {rng.randint(0, 700)}, {then})",
        f"{motor}.run_angle({speed}, {rng.randint(-400, 400)}, {then})",
        f"{motor}.run_target({speed}, {rng.randint(-400, 400)}, {then})",
    )


def motor_reading(rng: random.Random, motor: str) -> str:
    readings = (
        "angle()",
        "speed()",
        f"speed({rng.choice((20, 50, 100, 200))})",
        "load()",
        "stalled()",
        "done()",
    )
    return (
        f"print(s.time(), {', '.join(f'{motor}.{reading}' for reading in rng.sample(readings, 3))})"
    )


def motor_setting(rng: random.Random, motor: str) -> str:
    return rng.choice(
        (
            (
                f"{motor}.control.limits({rng.randint(100, 1200)}, {rng.randint(200, 5000)}, "
                f"{rng.randint(50, 700)})"
            ),
            (
                f"{motor}.control.limits(acceleration=({rng.randint(200, 5000)}, "
                f"{rng.randint(200, 5000)}))"
            ),
            (
                f"{motor}.control.pid({rng.randint(2000, 40000)}, {rng.randint(0, 20000)}, "
                f"{rng.randint(0, 3000)})"
            ),
            f"{motor}.control.target_tolerances({rng.randint(0, 100)}, {rng.randint(1, 30)})",
            f"{motor}.control.stall_tolerances({rng.randint(1, 200)}, {rng.randint(10, 500)})",
            f"{motor}.settings({rng.randint(2000, 9000)})",
        )
    )


def base_command(rng: random.Random) -> str:
    """A command of the drive base that ends at once."""
    return rng.choice(
        (
            f"b.drive({rng.randint(-250, 250)}, {rng.randint(-200, 200)})",
            "b.stop()",
            "b.brake()",
            f"b.reset({rng.randint(-400, 400)}, {rng.randint(-400, 400)})",
            *(f"{call[:-1]}, wait=False)" for call in base_moves(rng)),
        )
    )


def base_moves(rng: random.Random) -> tuple[str, ...]:
    then = rng.choice(STOPS)
    radius = rng.choice((-1, 1)) * rng.randint(20, 250)
    return (
        f"b.straight({rng.randint(-200, 200)}, {then})",
        f"b.turn({rng.randint(-200, 200)}, {then})",
        f"b.curve({radius}, {rng.randint(-180, 180)}, {then})",
        f"b.arc({radius}, angle={rng.randint(-180, 180)}, then={then})",
        f"b.arc({radius}, distance={rng.randint(-200, 200)}, then={then})",
    )


def base_setting(rng: random.Random) -> str:
    return rng.choice(
        (
            (
                f"b.settings({rng.randint(50, 400)}, {rng.randint(100, 1500)}, "
                f"{rng.randint(50, 400)}, {rng.randint(100, 1500)})"
            ),
            (
                f"b.settings(straight_acceleration=({rng.randint(100, 1500)}, "
                f"{rng.randint(100, 1500)}))"
            ),
            (
                f"b.distance_control.pid({rng.randint(2000, 40000)}, {rng.randint(0, 20000)}, "
                f"{rng.randint(0, 3000)})"
            ),
            f"b.heading_control.target_tolerances({rng.randint(1, 100)}, {rng.randint(1, 30)})",
        )
    )


def base_reading(rng: random.Random) -> str:
    return rng.choice(
        (
            "print(s.time(), b.distance(), b.angle(), b.state(), b.done(), b.stalled())",
            'print("%d %d" % (b.distance(), b.angle()))',
            "print(b.settings())",
        )
    )


def read(rng: random.Random, reading: str) -> list[str]:
    """Reading after a wait, or in some turns of a loop."""
    if rng.random() < 0.5:
        return [f"wait({rng.randint(0, 400)})", reading]
    return [
        f"for i in range({rng.randint(1, 5)}):",
        f"    wait({rng.randint(1, 60)})",
        f"    {reading}",
    ]


def motors(rng: random.Random) -> list[str]:
    """Commands and settings of two motors in any order."""
    lines = []
    for name, port in (("m", "A"), ("n", "B")):
        direction = rng.choice(("CLOCKWISE", "COUNTERCLOCKWISE"))
        gears = rng.choice(("", "", f", gears=[{rng.randint(8, 40)}, {rng.randint(8, 40)}]"))
        lines.append(f"{name} = Motor(Port.{port}, Direction.{direction}{gears})")
    for _ in range(rng.randint(3, 9)):
        name = rng.choice("mn")
        if rng.random() < 0.3:
            lines += [f"{name}.stop()", motor_setting(rng, name)]
        lines.append(rng.choice((motor_command(rng, name), rng.choice(motor_moves(rng, name)))))
        lines += read(rng, motor_reading(rng, name))
    return lines


def base(rng: random.Random) -> list[str]:
    """The two motors and their drive base."""
    one, other = rng.choice((("CLOCKWISE", "COUNTERCLOCKWISE"), ("COUNTERCLOCKWISE", "CLOCKWISE")))
    return [
        f"m = Motor(Port.A, Direction.{one})",
        f"n = Motor(Port.B, Direction.{other})",
        (
            f"b = DriveBase(m, n, {rng.choice((46, 56, 62.4, 88))}, "
            f"{rng.choice((80, 88.5, 112, 140))})"
        ),
    ]


def drives(rng: random.Random) -> list[str]:
    """Commands and settings of a drive base in any order."""
    lines = base(rng)
    for _ in range(rng.randint(3, 9)):
        if rng.random() < 0.3:
            lines += ["b.stop()", base_setting(rng)]
        lines.append(rng.choice((base_command(rng), rng.choice(base_moves(rng)))))
        lines += read(rng, base_reading(rng))
    return lines


def tasks(rng: random.Random) -> list[str]:
    """Tasks that interrupt each other's motors and drive base."""
    names = ["one", "two", "three"][: rng.randint(2, 3)]
    lines = base(rng)
    for name in names:
        lines.append(f"async def {name}():")
        for _ in range(rng.randint(1, 5)):
            motor = rng.choice("mn")
            move = rng.choice((*base_moves(rng), *motor_moves(rng, motor)))
            here = f'print("{name}", s.time(), m.angle(), n.angle(), b.done())'
            step = rng.choice(
                (
                    [f"await wait({rng.randint(0, 300)})"],
                    [f"await {move}"],
                    [motor_command(rng, motor)],
                    [base_command(rng)],
                    [
                        f"for i in range({rng.randint(1, 4)}):",
                        f"    await wait({rng.randint(0, 60)})",
                        f"    {here}",
                    ],
                    [
                        (
                            f"await multitask(wait({rng.randint(0, 300)}), {move}, "
                            f"race={rng.random() < 0.5})"
                        )
                    ],
                )
            )
            lines += [f"    {line}" for line in step]
            lines.append(f"    {here}")
    calls = ", ".join(f"{name}()" for name in names)
    lines += [
        "async def main():",
        f"    print(await multitask({calls}, race={rng.random() < 0.4}))",
    ]
    return [*lines, "run_task(main())", "print(s.time(), m.angle(), n.angle())"]


def branching(lines: list[str]) -> list[str]:
    """The program with a branch after each line that may take time."""
    timed = re.compile(r"( *)(wait|\w\.run_|\w\.(straight|turn|curve|arc))")
    with_branches = []
    for line in lines:
        match = timed.match(line)
        with_branches += [line] if match is None else [line, f"{match[1]}{BRANCH}"]
    return with_branches


KINDS: dict[str, Callable[[random.Random], list[str]]] = {
    "tasks": tasks,
    "motors": motors,
    "motors-branching": lambda rng: branching(motors(rng)),
    "drives": drives,
    "drives-branching": lambda rng: branching(drives(rng)),
}


def guarded(lines: list[str]) -> str:
    """The program, which prints the class of an error that ends it."""
    body = "".join(f"    {line}\n" for line in lines)
    return f"{HEAD}\ntry:\n{body}except Exception as error:\n    print(type(error), error)\n"


def on_virtual_hub(program: Path) -> str:
    out, err = io.BytesIO(), io.StringIO()
    run_file(program, stdout=out, stderr=err, time_limit_s=TIME_LIMIT_S)
    if "at the time limit" in err.getvalue():
        return NO_END
    return out.getvalue().decode("utf-8", "replace") + err.getvalue()


def on_firmware(binary: Path, program: Path) -> str:
    try:
        process = subprocess.run(  # noqa: S603 - the firmware that the caller has built
            [binary.absolute(), program],
            stdin=subprocess.DEVNULL,
            capture_output=True,
            timeout=_TIMEOUT_S,
            check=False,
        )
    except subprocess.TimeoutExpired:
        return NO_END
    return process.stdout.decode("utf-8", "replace").replace("\r\n", "\n")


def compare(kind: str, number: int, binary: Path, folder: Path) -> tuple[str, str, str]:
    """A program, and what the virtual hub and the firmware print."""
    program = folder / f"{kind}_{number}.py"
    source = guarded(KINDS[kind](random.Random(f"{kind} {number}")))
    program.write_text(source, encoding="utf-8")
    return source, on_virtual_hub(program), on_firmware(binary, program)


def main(session: Session) -> None:
    parser = session.parser
    parser.add_argument("binary", type=Path, help="the firmware, built for a computer")
    parser.add_argument(
        "--programs", type=int, default=300, help="programs of each kind (default: 300)"
    )
    parser.add_argument("--first", type=int, default=0, help="number of the first one (default: 0)")
    parser.add_argument("--kinds", nargs="+", choices=KINDS, default=list(KINDS))
    parser.add_argument("--keep", type=Path, help="folder for the programs that differ")
    args = session.parse()
    numbers = range(args.first, args.first + args.programs)
    result: dict[str, Any] = {"firmware": FIRMWARE, "kinds": {}}
    for kind in args.kinds:
        differ = []
        with tempfile.TemporaryDirectory() as folder, ThreadPoolExecutor(2) as pool:
            compared = pool.map(
                lambda number, kind=kind: compare(kind, number, args.binary, Path(folder)), numbers
            )
            for number, (source, ours, theirs) in zip(numbers, compared, strict=True):
                if ours != theirs:
                    differ.append(number)
                    if args.keep is not None:
                        args.keep.mkdir(parents=True, exist_ok=True)
                        for name, text in (
                            (f"{number}.py", source),
                            (f"{number}.ours", ours),
                            (f"{number}.firmware", theirs),
                        ):
                            (args.keep / f"{kind}_{name}").write_text(text, encoding="utf-8")
        print(
            f"{kind}: {len(numbers) - len(differ)} of {len(numbers)} the same; differ: {differ}",
            flush=True,
        )
        result["kinds"][kind] = {
            "programs": len(numbers),
            "same": len(numbers) - len(differ),
            "differ": differ,
        }
    if args.first == 0:
        session.write(result)
