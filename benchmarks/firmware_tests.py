"""Programs with expected output, run on the virtual hub, such as the firmware's tests.

    git clone https://github.com/pybricks/pybricks-micropython
    python -m benchmarks firmware_tests pybricks-micropython/tests/virtualhub

Runs every program below the folder with a file of its expected output (``x.py.exp`` or ``x.exp``),
on the bench. Programs that cannot run on a hub are counted separately, with the reason: they skip
themselves, or need a module or long integers that no hub has. Other differences are listed by name,
with the first differing line. Two tests of the firmware need a motor with end stops, and some of
MicroPython's own tests expect the configuration for a PC.
"""

from __future__ import annotations

import re
import subprocess
import sys
from collections import Counter, defaultdict
from pathlib import Path

from benchmarks.session import Session

_RUN = """
import sys
from brickhub.target import find
from brickhub.virtual import run_file
sys.exit(run_file(sys.argv[1], find(sys.argv[2]).make_body(), time_limit_s=float(sys.argv[3])))
"""
_REASONS = (
    (r"(?m)^SKIP$", "skips itself"),
    (r"ImportError: no module named '(.*)'", "needs the module {}"),
    (r"OverflowError: (?:long int not supported|small int overflow)", "needs long integers"),
)


def expected_output(program: Path) -> Path | None:
    """The file with the expected output of a program."""
    candidates = (program.with_name(f"{program.name}.exp"), program.with_suffix(".exp"))
    return next((path for path in candidates if path.is_file()), None)


def output(program: Path, robot: str, time_limit_s: float, timeout_s: float) -> str:
    """Output and errors of a program."""
    arguments = [sys.executable, "-c", _RUN, str(program), robot, str(time_limit_s)]
    try:
        process = subprocess.run(  # noqa: S603 - the programs run in the virtual hub
            arguments, stdin=subprocess.DEVNULL, capture_output=True, timeout=timeout_s, check=False
        )
    except subprocess.TimeoutExpired:
        return f"no end within {timeout_s:g} s"
    return (process.stdout + process.stderr).decode("utf-8", "replace").replace("\r\n", "\n")


def verdict(printed: str, expected: str) -> str:
    """``passed``, ``differs: <the first line>``, or why the program cannot run on a hub."""
    if printed.rstrip() == expected.rstrip():
        return "passed"
    for pattern, reason in _REASONS:
        if match := re.search(pattern, printed):
            return reason.format(*match.groups())
    lines = zip([*printed.splitlines(), "(end)"], [*expected.splitlines(), "(end)"], strict=False)
    actual, right = next(
        ((actual, right) for actual, right in lines if actual != right), ("(end)", "(more)")
    )
    return f"differs: {actual!r}, expected {right!r}"


def main(session: Session) -> None:
    parser = session.parser
    parser.add_argument("folder", type=Path, help="where the programs are")
    parser.add_argument(
        "--robot", default="bench", help="the virtual robot that they run on (default: bench)"
    )
    parser.add_argument(
        "--time-limit-s", type=float, default=60.0, help="simulated seconds for each (default: 60)"
    )
    parser.add_argument(
        "--timeout-s", type=float, default=60.0, help="real seconds for each (default: 60)"
    )
    args = session.parse()
    folders: defaultdict[str, Counter[str]] = defaultdict(Counter)
    differences: dict[str, str] = {}
    for program in sorted(args.folder.rglob("*.py")):
        exp = expected_output(program)
        if exp is None:
            continue
        name = program.relative_to(args.folder)
        result = verdict(
            output(program, args.robot, args.time_limit_s, args.timeout_s),
            exp.read_text(encoding="utf-8"),
        )
        if result.startswith("differs"):
            differences[name.as_posix()] = result
            print(f"{name.as_posix()} {result}")
        folders[name.parent.as_posix()][result.partition(":")[0]] += 1
    for folder, counts in folders.items():
        print(folder, dict(counts))
    session.write(
        {"folders": {name: dict(c) for name, c in folders.items()}, "differences": differences}
    )
