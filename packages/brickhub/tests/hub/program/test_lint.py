"""Lint of hub programs."""

from __future__ import annotations

import pytest
from hypothesis import given
from hypothesis import strategies as st

from brickhub.errors import ProgramError
from brickhub.hub.program.lint import lint, require_clean
from brickhub.robot import HubKind

CLEAN = """
from pybricks.hubs import PrimeHub
from pybricks.parameters import Port
from pybricks.pupdevices import Motor
from pybricks.tools import wait, multitask, run_task
from umath import sin, pi
import ustruct, usys, ujson, urandom, uselect, uio, gc, micropython, uerrno

hub = PrimeHub()
motor = Motor(Port.A)

class Leg:
    def __init__(self, motor, *more, low=-1073741823, **options):
        self.motor = motor
        self.partition = 3

    def angle(self):
        return self.motor.angle() / 2 + sin(pi)

async def main():
    await wait(10)

def helper(n=1 << 29):
    for i, x in enumerate(reversed([1, 2])):
        yield f"{i}: {x:.2f}"

try:
    data = bytearray(4)
    view = memoryview(data)
    run_task(main())
except OSError as error:
    print(error, {1, 2}, [y for y in helper()], lambda z: z, 2 ** 3, 0x3FFFFFFF)
if (n := len(data)) > 1:
    raise SystemExit
if __name__ == "__main__":
    print(Leg(motor).partition, usys.stdin, n)
"""


def test_lint_accepts_valid_code() -> None:
    assert lint(CLEAN, HubKind.PRIME) == ()
    require_clean(CLEAN, HubKind.PRIME)


@pytest.mark.parametrize(
    ("source", "words"),
    [
        ("import time", "StopWatch"),
        ("import os.path", "no module os"),
        ("from collections import deque", "no module collections"),
        ("import struct", "use ustruct"),
        ("import numpy as np", "no module numpy"),
        ("from . import other", "relative"),
        ("import pybricks.cameras", "there is no pybricks.cameras"),
        ("from pybricks.hubs import TechnicHub", "PrimeHub"),
        ("x = list(filter(None, [1]))", "no filter"),
        ("@property\ndef f(self): pass", "no property"),
        ("open('x')", "no open"),
        ("x = frozenset()", "no frozenset"),
        ("import usys\nusys.exit()", "raise SystemExit"),
        ("from usys import exit", "raise SystemExit"),
        ("x = type(3).__name__", "__name__"),
        ("x = 'a-b'.partition('-')", "find()"),
        ("x = (5).bit_length()", "bit_length"),
        ("x = 1073741824", "long integer"),
        ("x = -0xFFFFFFFF", "long integer"),
        ("x = 1 << 31", "long integer"),
        ("x = 2 ** 40", "long integer"),
        ("x = 40000 * 40000", "long integer"),
        ("class A: pass\nclass B: pass\nclass C(A, B): pass", "2 bases"),
        ("class A(metaclass=int): pass", "metaclass"),
        ("def f(a, /): pass", "positional-only"),
        ("match 1:\n    case 1: pass", "match"),
        ("try: pass\nexcept* OSError: pass", "groups"),
        ("print(low_angle)", "low_angle is never defined"),
        (r"x = '\d'; y = filter(x, '')", "no filter"),
        ("x = = 1", "not Python"),
        ("x = '\0'", "not Python"),
    ],
)
def test_lint_finds_unsupported_code(source: str, words: str) -> None:
    findings = lint(source, HubKind.PRIME)
    assert len(findings) == 1
    assert words in findings[0].detail


def test_lint_findings_are_ordered_by_line() -> None:
    findings = lint("x = 1\nimport time\n\ny = filter(x, [])\n", HubKind.PRIME)
    assert [finding.name for finding in findings] == ["line 2", "line 4"]
    assert str(findings[0]).startswith("line 2: the prime hub has no module time; ")


@pytest.mark.parametrize(("kind", "count"), [(HubKind.PRIME, 0), (HubKind.ESSENTIAL, 0), (HubKind.TECHNIC, 1), (HubKind.CITY, 1)])
def test_memoryview_needs_large_hub(kind: HubKind, count: int) -> None:
    assert len(lint("x = memoryview(b'')", kind)) == count


@pytest.mark.parametrize("source", ["x = 1.5", "x = 1 / 2", "x = float(1)", "import ustruct", "x = {1, 2}", "import umath"])
def test_move_hub_supports_less(source: str) -> None:
    assert lint(source, HubKind.CITY) == ()
    assert len(lint(source, HubKind.MOVE)) == 1


def test_program_with_findings_raises() -> None:
    with pytest.raises(ProgramError, match=r"prime hub: line 1: .*no module time.* \(2 findings in all\)"):
        require_clean("import time\nimport os\n", HubKind.PRIME)


@given(st.text(max_size=60))
def test_lint_survives_any_text(source: str) -> None:
    for finding in lint(source, HubKind.PRIME):
        assert int(finding.name.removeprefix("line ")) >= 1
