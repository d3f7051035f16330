"""Time, tasks and matrices of ``pybricks.tools``."""

from __future__ import annotations

import pytest
from hub_programs import output

from brickhub import robot as robots
from brickhub.errors import TwinError
from brickhub.robot import HubKind, Robot


def tool(source: str) -> str:
    return output("from pybricks.tools import *\n" + source)


def test_stopwatch_excludes_pauses() -> None:
    source = """
watch = StopWatch()
wait(100)
watch.pause()
wait(50)
print(watch.time())
watch.resume()
wait(7.9)
print(watch.time())
watch.reset()
print(watch.time())
watch.pause()
watch.reset()
wait(5)
print(watch.time())
"""
    assert tool(source) == "100\n107\n0\n0"


def test_polling_loop_ends() -> None:
    assert tool("watch = StopWatch()\nwhile watch.time() < 30:\n    pass\nprint('end')") == "end"


@pytest.mark.parametrize("argument", ["'1'", "None", "[1]"])
def test_wait_needs_number(argument: str) -> None:
    with pytest.raises(TypeError, match="can't convert .* to int"):
        tool(f"wait({argument})")


def test_wait_needs_argument() -> None:
    with pytest.raises(TypeError, match="'time' argument required"):
        tool("wait()")


def test_multitask_returns_all_results() -> None:
    source = """
watch = StopWatch()
async def slow(name, n, pause):
    for i in range(n):
        await wait(pause)
        print(name, i, watch.time())
    return name
async def main():
    print(await multitask(slow('a', 2, 30), slow('b', 3, 25)))
    print(watch.time())
run_task(main())
print(run_task())
"""
    assert tool(source) == "b 0 25\na 0 30\nb 1 50\na 1 60\nb 2 75\n('a', 'b')\n75\nFalse"


def test_race_ends_with_the_first_and_cancels_the_others() -> None:
    source = """
watch = StopWatch()
async def other():
    try:
        while True:
            await wait(10)
    finally:
        print('cancelled', watch.time())
async def first():
    await wait(35)
    return 1
async def main():
    print(await multitask(other(), first(), race=True))
run_task(main())
"""
    assert tool(source) == "cancelled 35\n(None, 1)"


def test_error_in_one_task_cancels_the_others() -> None:
    source = """
async def fails():
    await wait(5)
    1 / 0
async def other():
    try:
        await wait(100)
    finally:
        print('closed')
async def main():
    try:
        await multitask(other(), fails())
    except ZeroDivisionError as e:
        print(e)
run_task(main())
"""
    assert tool(source) == "closed\ndivide by zero"


def test_multitask_refuses_non_tasks() -> None:
    with pytest.raises(TypeError, match="'int' object isn't iterable"):
        tool("async def main():\n    await multitask(5)\nrun_task(main())")


def test_run_loop_ends_after_error() -> None:
    source = """
async def inner():
    pass
async def main():
    print(run_task())
    run_task(inner())
try:
    run_task(main())
except RuntimeError as e:
    print(e)
wait(1)
run_task(inner())
"""
    assert tool(source) == "True\nRun loop already active."


def test_zero_wait_yields() -> None:
    source = """
order = []
async def one(name):
    for i in range(2):
        order.append(name)
        await wait(0)
async def main():
    await multitask(one('a'), one('b'))
run_task(main())
print(order)
"""
    assert tool(source) == "['a', 'b', 'a', 'b']"


def test_read_input_byte() -> None:
    source = (
        "from pybricks.tools import *\nprint(read_input_byte())\nwait(5)\n"
        "print(read_input_byte(), read_input_byte(chr=True))\n"
    )
    assert (
        output(
            source + "print(read_input_byte(last=True, chr=True), read_input_byte())", {5: b"abcd"}
        )
        == "None\n97 b\nd None"
    )


@pytest.mark.parametrize(
    ("byte", "character"), [(31, "None"), (32, "' '"), (126, "'~'"), (127, "None"), (200, "None")]
)
def test_only_a_printable_byte_is_a_character(byte: int, character: str) -> None:
    source = "from pybricks.tools import *\nwait(10)\nprint(repr(read_input_byte(chr=True)))\n"
    assert output(source, {5: bytes([byte])}) == character


def test_matrix_arithmetic_and_text() -> None:
    source = """
A = Matrix([[1, 2], [3, -4.5]])
b = vector(1, 0.0625)
print(A)
print(A * b, A.T[1, 0], A.shape, A[-1], (A + A)[0], (-A / 2)[3], abs(vector(3, 4)))
print(b.T * b, Matrix([[2]]), list(A), cross(vector(1, 0, 0), vector(0, 1, 0)).T, 2 * b)
"""
    assert tool(source) == (
        "Matrix([\n    [   1.000,    2.000],\n    [   3.000,   -4.500],\n])\n"
        "Matrix([\n    [   1.125],\n    [   2.718],\n]) 2.0 (2, 2) -4.5 2.0 2.25 5.0\n"
        "1.0039062 2.0 [1.0, 2.0, 3.0, -4.5] Matrix([\n    [   0.000,    0.000,    1.000],\n]) "
        "Matrix([\n    [   2.000],\n    [   0.125],\n])"
    )


@pytest.mark.parametrize(
    ("expression", "kind"),
    [
        ("Matrix([[1, 2], [3]])", ValueError),
        ("Matrix([])", ValueError),
        ("Matrix(5)", TypeError),
        ("vector(1, 2) * vector(1, 2)", ValueError),
        ("vector(1, 2)[2]", IndexError),
        ("vector(1)", TypeError),
    ],
)
def test_matrix_refuses(expression: str, kind: type[Exception]) -> None:
    with pytest.raises(kind):
        tool(expression)


def test_hub_menu_without_presses_raises() -> None:
    with pytest.raises(TwinError, match="nobody presses"):
        tool("hub_menu('a', 'b')")
    with pytest.raises(ImportError, match="can't import name hub_menu"):
        output("from pybricks.tools import hub_menu", robot=Robot("small", HubKind.TECHNIC))


def test_objects_are_made_before_multitasking_starts() -> None:
    source = """
from pybricks.tools import run_task
from pybricks.pupdevices import Motor
from pybricks.parameters import Port
async def main():
    Motor(Port.A)
run_task(main())
"""
    with pytest.raises(RuntimeError, match="before multitasking starts"):
        output(source, robot=robots.BENCH)


def test_yielding_takes_little_time() -> None:
    source = """
from pybricks.tools import wait, run_task, multitask, StopWatch
watch = StopWatch()
async def polite():
    for i in range(1000):
        await wait(0)
    print(watch.time() <= 10)
async def patient():
    await wait(50)
    print(watch.time())
run_task(multitask(polite(), patient()))
"""
    assert output(source) == "True\n50"


@pytest.mark.parametrize("time", ["0", "-100", "0.4"])
def test_waits_for_nothing_take_no_time_but_many_of_them_do(time: str) -> None:
    """Else a program that does nothing else would never end."""
    few, many = (
        tool(
            f"watch = StopWatch()\nfor _ in range({count}):\n    wait({time})\nprint(watch.time())"
        )
        for count in (10, 5000)
    )
    assert int(few) == 0 < int(many)
