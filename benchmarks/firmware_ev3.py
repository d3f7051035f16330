"""Random motor and drive base programs of an EV3: the virtual hub against the firmware's own motor
control, built for a computer with EV3's motors.

    git clone --branch v4.1.0b2 https://github.com/pybricks/pybricks-micropython
    python -m benchmarks firmware_ev3 pybricks-micropython

Builds ``lib/pbio`` with GCC: its control, observers, drive base and settings are unchanged; its
simulated motors get the steps of 1 ms of our bench (``bench_motor.py``), so that both sides move
the same motors. ``firmware_ev3.c`` gives it the commands of a program, as MicroPython would. A
program is the same if every angle is within 2 degrees and every time within 5 ms.
"""

from __future__ import annotations

import io
import random
import shutil
import statistics
import subprocess
import tempfile
from collections.abc import Sequence
from pathlib import Path
from typing import Any

from benchmarks.session import Session
from brickhub.errors import BricksError
from brickhub.robot import HubKind, MotorKind
from brickhub.virtual.bench_body import FittedBench
from brickhub.virtual.bench_motor import step_of
from brickhub.virtual.run import run_file

FIRMWARE = "v4.1.0b2"
MAX_DEG = 2
MAX_MS = 5
_TIMEOUT_S = 60.0
HEAD = """from pybricks.ev3devices import Motor
from pybricks.parameters import Direction, Port, Stop
from pybricks.robotics import DriveBase
from pybricks.tools import StopWatch, wait

watch = StopWatch()

def show():
    print(watch.time(), m[0].angle(), m[1].angle())

"""
STOPS = ("HOLD", "BRAKE", "COAST", "COAST_SMART", "BRAKE_SMART", "NONE")
KINDS = {"L": MotorKind.EV3_LARGE, "M": MotorKind.EV3_MEDIUM}
_PLATFORM = ("pbdrvconfig.h", "pbioconfig.h", "pbio_os_config.h", "pbsysconfig.h", "platform.c")
_INPUTS = ("speed", "current", "voltage", "torque")
_UNUSED = ("BLUETOOTH", "UART", "LED", "PWM", "BUTTON", "VCC_CONTROL")
_OFF = ("LIGHT", "LIGHT_MATRIX", "IMAGE", "PORT_LUMP", "PORT_LUMP_MODE_INFO", "PORT_LUMP_NUM_DEV")

# A line of a program, for the harness and in Python.
Line = tuple[str, str]


def wait_line(rng: random.Random) -> Line:
    time_ms = rng.randint(20, 600)
    return f"wait {time_ms}", f"wait({time_ms})"


def motor_line(rng: random.Random) -> Line:
    """A command of a motor, which ends at once or after a movement."""
    index = rng.randrange(2)
    speed = rng.choice((-1, 1)) * rng.randint(60, 900)
    angle = rng.choice((-1, 1)) * rng.randint(20, 700)
    then = rng.choice(STOPS)
    motor = f"m[{index}]"
    time_ms = rng.randint(50, 900)
    return rng.choice(
        (
            (f"mrun {index} {speed}", f"{motor}.run({speed})"),
            (f"mstop {index}", f"{motor}.stop()"),
            (f"mhold {index}", f"{motor}.hold()"),
            (f"mbrake {index}", f"{motor}.brake()"),
            (
                f"mtime {index} {speed} {time_ms} {then}",
                f"{motor}.run_time({speed}, {time_ms}, Stop.{then})",
            ),
            (
                f"mangle {index} {speed} {angle} {then}",
                f"{motor}.run_angle({speed}, {angle}, Stop.{then})",
            ),
            (
                f"mtarget {index} {speed} {angle} {then}",
                f"{motor}.run_target({speed}, {angle}, Stop.{then})",
            ),
        )
    )


def base_line(rng: random.Random) -> Line:
    """A command of the drive base."""
    distance = rng.choice((-1, 1)) * rng.randint(20, 400)
    angle = rng.choice((-1, 1)) * rng.randint(15, 270)
    radius = rng.choice((-1, 1)) * rng.randint(40, 250)
    speed = rng.randint(-250, 250)
    rate = rng.randint(-150, 150)
    then = rng.choice(STOPS)
    return rng.choice(
        (
            (f"bdrive {speed} {rate}", f"b.drive({speed}, {rate})"),
            ("bstop", "b.stop()"),
            (f"bstraight {distance} 0 {then}", f"b.straight({distance}, Stop.{then})"),
            (f"bturn {angle} 0 {then}", f"b.turn({angle}, Stop.{then})"),
            (f"bcurve {radius} {angle} {then}", f"b.curve({radius}, {angle}, Stop.{then})"),
        )
    )


def program(number: int, *, is_base: bool) -> tuple[list[str], str, str]:
    """Arguments and commands of a program for the harness, and its text in Python."""
    rng = random.Random(f"ev3 {number} {is_base}")
    first = "L" if is_base else rng.choice("LM")
    directions = rng.choice(((-1, 1), (1, -1))) if is_base else rng.choices((-1, 1), k=2)
    lines: list[Line] = []
    if is_base:
        wheel_mm = rng.choice((43.2, 56, 62.4, 81.6))
        track_mm = rng.choice((96, 112, 120, 152.5))
        sizes = f"{round(wheel_mm * 1000)} {round(track_mm * 1000)}"
        lines.append((f"base {sizes}", f"b = DriveBase(m[0], m[1], {wheel_mm}, {track_mm})"))
    for _ in range(rng.randint(4, 9)):
        lines.append(base_line(rng) if is_base else motor_line(rng))
        lines.append(("show", "show()"))
        lines.append(wait_line(rng))
        lines.append(("show", "show()"))
    ports = ("C" if first == "M" else "A", "B")
    names = {1: "CLOCKWISE", -1: "COUNTERCLOCKWISE"}
    motors = [
        f"Motor(Port.{port}, Direction.{names[direction]})"
        for port, direction in zip(ports, directions, strict=True)
    ]
    text = HEAD + f"m = [{', '.join(motors)}]\n"
    text += "".join(f"{python}\n" for _, python in lines)
    commands = "".join(f"{command}\n" for command, _ in lines)
    return [*map(str, directions), first], commands, text


def build(firmware: Path, folder: Path) -> Path:
    """The harness with the firmware's motor control. Raises BricksError if it cannot be built."""
    pbio = firmware / "lib" / "pbio"
    for name in (
        "pbdrvconfig.h",
        "pbioconfig.h",
        "pbio_os_config.h",
        "pbsysconfig.h",
        "platform.c",
    ):
        shutil.copy(pbio / "platform" / "test" / name, folder)
    _edit(folder / "pbdrvconfig.h", _without_unused)
    _edit(folder / "pbioconfig.h", _switched_off)
    _edit(folder / "platform.c", _with_motors)
    simulation = folder / "simulation.c"
    shutil.copy(pbio / "drv/motor_driver/motor_driver_virtual_simulation.c", simulation)
    _edit(simulation, _with_models)
    sources = [*(pbio / "src").glob("*.c"), *(pbio / "src/motor").glob("*.c")]
    sources += [pbio / "drv/clock/clock_test.c", pbio / "drv/battery/battery_test.c"]
    sources += [folder / "platform.c", simulation, Path(__file__).with_suffix(".c")]
    places = (folder, pbio, pbio / "include", pbio / "drv/motor_driver", firmware / "lib/lego")
    harness = folder / "harness"
    command = [
        "gcc",
        "-O1",
        "-w",
        "-DNDEBUG",
        *(f"-I{place}" for place in places),
        *map(str, sources),
    ]
    done = subprocess.run(  # noqa: S603 - the compiler of this computer
        [*command, "-lm", "-o", str(harness)], capture_output=True, text=True, check=False
    )
    if done.returncode:
        raise BricksError(f"gcc: {done.stderr.splitlines()[0]}; take the firmware {FIRMWARE}")
    return harness


def _edit(path: Path, change: Any) -> None:
    path.write_text(change(path.read_text(encoding="utf-8")), encoding="utf-8")


def _without_unused(text: str) -> str:
    lines = text.splitlines()
    return "\n".join(line for line in lines if not any(word in line for word in _UNUSED)) + "\n"


def _switched_off(text: str) -> str:
    lines = []
    for line in text.splitlines():
        words = line.split()
        if len(words) == 3 and words[1].removeprefix("PBIO_CONFIG_") in _OFF:
            line = f"#define {words[1]} (0)"
        lines.append(line)
    return "\n".join(lines) + "\n"


def _with_motors(text: str) -> str:
    """A large motor on ports A and B, a medium one on C, and nothing that stops them."""
    text = text.partition("const pbdrv_led_array_pwm")[0]
    text = text.replace('#include "../../drv/led/led_array_pwm.h"\n', "").replace(
        '"../../drv', '"drv'
    )
    text = text.replace("SPIKE_M_MOTOR", "EV3_LARGE_MOTOR").replace("= 123456", "= 0")
    text = text.replace("SPIKE_L_MOTOR", "EV3_MEDIUM_MOTOR", 1).replace("142000", "INFINITY")
    return text.replace(
        "PBIO_PORT_MODE_LEGO_DCM | PBIO_PORT_MODE_UART", "PBIO_PORT_MODE_QUADRATURE"
    )


def _with_models(text: str) -> str:
    """The steps of our bench's motors."""
    models = cases = ""
    for name, kind in (("LARGE", MotorKind.EV3_LARGE), ("MEDIUM", MotorKind.EV3_MEDIUM)):
        step = step_of(kind)
        rows = {"angle": step.angle, "speed": step.speed, "current": step.current}
        entries = ""
        for row, values in rows.items():
            for column, value in zip(
                ("speed", "current", "voltage", "torque"), values, strict=True
            ):
                entries += f".d_{row}_d_{column} = {value!r}, "
        entries += f".torque_friction = {step.friction_unm!r}"
        models += f"static const pbio_simulation_model_t ev3_{name} = {{ {entries} }};\n"
        cases += f"case LEGO_DEVICE_TYPE_ID_EV3_{name}_MOTOR: driver->model = &ev3_{name}; break;\n"
    place = "static pbdrv_motor_driver_dev_t motor_driver_devs"
    text = text.replace(place, models + place, 1)
    first_case = "case LEGO_DEVICE_TYPE_ID_SPIKE_S_MOTOR:"
    return text.replace(first_case, cases + first_case, 1)


def on_firmware(harness: Path, arguments: Sequence[str], commands: str) -> list[list[int]]:
    """Times and angles that the firmware shows."""
    done = subprocess.run(  # noqa: S603 - what we have built
        [str(harness), *arguments],
        input=commands,
        capture_output=True,
        text=True,
        timeout=_TIMEOUT_S,
        check=False,
    )
    return _rows(done.stdout)


def on_virtual_hub(folder: Path, text: str) -> list[list[int]]:
    """Times and angles that the virtual hub shows."""
    path = folder / "main.py"
    path.write_text(text, encoding="utf-8")
    out = io.BytesIO()
    bench = FittedBench(HubKind.EV3, devices={"C": MotorKind.EV3_MEDIUM})
    run_file(path, bench, stdout=out, stderr=io.StringIO(), time_limit_s=300)
    return _rows(out.getvalue().decode())


def _rows(text: str) -> list[list[int]]:
    return [[int(word) for word in line.split()] for line in text.splitlines()]


def compare(harness: Path, folder: Path, number: int, *, is_base: bool) -> dict[str, Any]:
    """Largest differences of a program."""
    arguments, commands, text = program(number, is_base=is_base)
    ours = on_virtual_hub(folder, text)
    theirs = on_firmware(harness, arguments, commands)
    pairs = list(zip(ours, theirs, strict=False))
    angle_deg = [
        abs(a - b) for one, other in pairs for a, b in zip(one[1:], other[1:], strict=True)
    ]
    time_ms = [abs(one[0] - other[0]) for one, other in pairs]
    return {
        "kind": "drive base" if is_base else "motors",
        "moments": len(theirs),
        "complete": len(ours) == len(theirs) > 0,
        "deg": max(angle_deg, default=0),
        "ms": max(time_ms, default=0),
        "s": theirs[-1][0] / 1000 if theirs else 0.0,
    }


def main(session: Session) -> None:
    parser = session.parser
    parser.add_argument("firmware", type=Path, help="a clone of the firmware")
    parser.add_argument("--programs", type=int, default=30, help="of each kind (default: 30)")
    args = session.parse()
    rows = []
    with tempfile.TemporaryDirectory() as name:
        folder = Path(name)
        harness = build(args.firmware.absolute(), folder)
        for is_base in (False, True):
            for number in range(args.programs):
                rows.append(compare(harness, folder, number, is_base=is_base))
                print(number, rows[-1], flush=True)
    same = [row["complete"] and row["deg"] <= MAX_DEG and row["ms"] <= MAX_MS for row in rows]
    result = {
        "firmware": FIRMWARE,
        "programs": len(rows),
        "same": sum(same),
        "moments": sum(row["moments"] for row in rows),
        "simulated_s": round(sum(row["s"] for row in rows), 1),
        "largest_deg": max(row["deg"] for row in rows),
        "largest_ms": max(row["ms"] for row in rows),
        "mean_of_largest_deg": round(statistics.fmean(row["deg"] for row in rows), 3),
        "differ": [{"number": i, **row} for i, row in enumerate(rows) if not same[i]],
    }
    print(result)
    session.write(result)
