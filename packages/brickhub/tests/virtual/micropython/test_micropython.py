"""MicroPython's modules against values from a hub."""

from __future__ import annotations

import pytest
from hub_programs import Console, output
from hypothesis import given
from hypothesis import strategies as st

from brickhub import robot as robots
from brickhub.robot import HubKind, Robot
from brickhub.virtual.bench_body import BenchBody
from brickhub.virtual.interpreter import execute
from brickhub.virtual.machine import Machine
from brickhub.virtual.micropython.numbers import random_module, struct_module
from brickhub.virtual.pybricks import modules


@pytest.mark.parametrize(
    "name",
    [
        "time",
        "utime",
        "os",
        "uos",
        "array",
        "collections",
        "re",
        "binascii",
        "asyncio",
        "machine",
        "numpy",
    ],
)
def test_missing_modules(name: str) -> None:
    with pytest.raises(ImportError, match=f"no module named '{name}'"):
        output(f"import {name}")


@pytest.mark.parametrize(
    "name", ["struct", "sys", "select", "math", "random", "json", "io", "errno"]
)
def test_modules_have_u_names(name: str) -> None:
    assert output(f"import {name}\nimport u{name}\nprint({name} is u{name})") == "True"


def test_math_is_single_precision() -> None:
    source = (
        "import umath\nprint(umath.pi, umath.sqrt(2), umath.sin(1), umath.floor(-1.5), "
        "umath.log(10), umath.modf(1.25))"
    )
    assert output(source) == "3.1415928 1.4142135 0.84147096 -2 2.3025852 (0.25, 1.0)"


def test_angle_conversion_factors_equal_hub() -> None:
    """From MicroPython 1.26.1; the factors are single-precision quotients."""
    source = (
        "import umath\nprint(umath.degrees(1), umath.degrees(-2.5), umath.radians(77), "
        "umath.radians(-140), umath.degrees(3e38))"
    )
    assert output(source) == "57.295776 -143.23944 1.3439036 -2.443461 inf"


@pytest.mark.parametrize(
    ("call", "error"), [("sqrt(-1)", "math domain error"), ("log(0)", "math domain error")]
)
def test_math_refuses(call: str, error: str) -> None:
    with pytest.raises(ValueError, match=error):
        output(f"import umath\numath.{call}")


@pytest.mark.parametrize("name", ["sinh", "gamma", "log2", "hypot", "tau", "isclose"])
def test_math_lacks_functions(name: str) -> None:
    with pytest.raises(AttributeError):
        output(f"import umath\numath.{name}")


@given(st.lists(st.integers(-(2**15), 2**15 - 1), min_size=1, max_size=8))
def test_struct_round_trip(values: list[int]) -> None:
    struct = struct_module()
    layout = f"<{len(values)}h"
    assert struct.unpack(layout, struct.pack(layout, *values)) == tuple(values)


def test_struct_wraps_values_and_checks_buffers() -> None:
    source = """
import ustruct
print(ustruct.pack('<hb', 70000, 300), ustruct.calcsize('<hBl'), ustruct.unpack('>f', ustruct.pack('>f', 0.1)))
print(ustruct.unpack('<h', b'\\x01\\x02\\x03'), ustruct.unpack_from('<B', b'abc', 1))
b = bytearray(4)
ustruct.pack_into('<h', b, 1, -2)
print(b)
try:
    ustruct.unpack('<h', b'a')
except ValueError as e:
    print(e)
try:
    ustruct.unpack('<I', b'\\xff\\xff\\xff\\xff')
except OverflowError as e:
    print(e)
"""  # noqa: E501
    assert output(source) == (
        "b'p\\x11,' 7 (0.1,)\n(513,) (98,)\nbytearray(b'\\x00\\xfe\\xff\\x00')\n"
        "buffer too small\nsmall int overflow"
    )


def test_random_numbers_follow_seed() -> None:
    first, second = random_module(1), random_module(99)
    second.seed(1)
    assert [first.getrandbits(8) for _ in range(20)] == [second.getrandbits(8) for _ in range(20)]
    assert first.random() == second.random()


@given(st.integers(-1000, 1000), st.integers(1, 1000), st.integers(0, 2**30 - 1))
def test_random_numbers_stay_in_range(low: int, span: int, seed: int) -> None:
    source = random_module(seed)
    assert low <= source.randint(low, low + span) <= low + span
    assert low <= source.randrange(low, low + span) < low + span
    assert 0 <= source.random() < 1
    assert source.choice([low]) == low


def test_json_round_trip() -> None:
    source = (
        "import ujson\ns = ujson.dumps({'a': [1, 0.5, None, True, 'x\"']})\nprint(s)\n"
        "print(ujson.loads(s))"
    )
    assert (
        output(source)
        == '{"a": [1, 0.5, null, true, "x\\""]}\n' + "{'a': [1, 0.5, None, True, 'x\"']}"
    )
    with pytest.raises(ValueError, match="syntax error in JSON"):
        output("import ujson\nujson.loads('{')")


@pytest.mark.parametrize(
    ("text", "printed"),
    [
        ("[1,]", "[1]"),
        ("{1: 2}", "{1: 2}"),
        ("[1 2]", "[1, 2]"),
        ('{"a" 1}', "{'a': 1}"),
        ('{"a"}', "{}"),
        ('[{"a"}, {"b": 1}]', "[{}, {'a': 'b'}]"),
        ("[1}", "[1]"),
        ('"\\u00e4\\n\\x"', "'\\xe4\\nx'"),
        ("{", "ValueError('syntax error in JSON',)"),
        ("nul", "ValueError('syntax error in JSON',)"),
        ('"abc', "ValueError('syntax error in JSON',)"),
        ("1 2", "ValueError('syntax error in JSON',)"),
        ("]", "ValueError('syntax error in JSON',)"),
        ("{[1]: 2}", "ValueError('syntax error in JSON',)"),
        ("-", "ValueError(\"invalid syntax for integer with base 10: ''\",)"),
        ("1.2.3", "ValueError('invalid syntax for number',)"),
        ("-1073741824", "OverflowError('long int not supported in this build',)"),
        ('{"zeta": 1, "alpha": [null, {}]}', "{'alpha': [None, {}], 'zeta': 1}"),
    ],
)
def test_json_parser_is_lenient(text: str, printed: str) -> None:
    """Printed by MicroPython 1.26.1."""
    source = (
        f"from ujson import loads\ntry:\n    print(repr(loads({text!r})))\n"
        "except Exception as e:\n    print(repr(e))"
    )
    assert output(source) == printed


@pytest.mark.parametrize(
    ("call", "printed"),
    [
        ("int('-1073741824')", "OverflowError('long int not supported in this build',)"),
        ("int('-1073741823')", "-1073741823"),
        ("int(' -3x')", "ValueError(\"invalid syntax for integer with base 10: '3x'\",)"),
        ("int('0b2', 0)", "ValueError(\"invalid syntax for integer with base 2: '2'\",)"),
        ("int('', 16)", "ValueError(\"invalid syntax for integer with base 16: ''\",)"),
    ],
)
def test_integers_are_read_digit_by_digit(call: str, printed: str) -> None:
    assert output(f"try:\n    print({call})\nexcept Exception as e:\n    print(repr(e))") == printed


def test_poll_waits_for_input_in_simulated_time() -> None:
    source = """
from usys import stdin, stdout
from uselect import poll, POLLIN
from pybricks.tools import StopWatch
from micropython import kbd_intr
kbd_intr(-1)
watch = StopWatch()
keyboard = poll()
keyboard.register(stdin, POLLIN)
print(keyboard.poll(0), keyboard.poll(20), watch.time())
events = keyboard.poll()
print(len(events), events[0][0] is stdin, events[0][1], watch.time())
print(stdin.buffer.read(3), watch.time(), keyboard.poll(0))
stdout.buffer.write(b'raw\\n')
stdout.write('cooked\\n')
"""
    assert (
        output(source, {100: b"\x03a", 150: b"b"})
        == "[] [] 20\n1 True 1 100\nb'\\x03ab' 150 []\nraw\ncooked"
    )


def test_select_waits_for_input_in_simulated_time() -> None:
    source = """
from usys import stdin, stdout
from uselect import select
from pybricks.tools import StopWatch
watch = StopWatch()
print(select([stdin], [], [], 0.02), watch.time())
print(select([stdin], (), []) == ([stdin], [], []), watch.time())
for wrong in (5, [5]):
    try:
        select(wrong, [], [])
    except Exception as e:
        print(e)
"""
    wrong = "object 'int' isn't a tuple or list\nstream operation not supported"
    assert output(source, {100: b"a"}) == f"([], [], []) 20\nTrue 100\n{wrong}"


def test_module_of_the_builtins() -> None:
    source = (
        "import builtins\nprint(builtins, builtins.len([1]), builtins.print is print, "
        "hasattr(builtins, 'filter'))"
    )
    assert output(source) == "<module 'builtins'> 1 True False"


def test_raw_output_is_unchanged() -> None:
    machine = Machine(BenchBody(robots.BENCH))
    console = Console(machine, {})
    source = "import usys\nusys.stdout.buffer.write(b'a\\n')\nusys.stdout.write('b\\n')\nprint('c')"
    execute(source, "main.py", modules(machine, console), console)
    assert console.written == b"a\nb\r\nc\r\n"


def test_interrupt_byte_stops_program() -> None:
    with pytest.raises(KeyboardInterrupt):
        output("import usys\nusys.stdin.buffer.read(1)", {0: b"\x03"})


def test_stdin_as_text() -> None:
    assert (
        output("from usys import stdin\nprint(stdin.read(2), stdin.readline())", {5: b"okline\n"})
        == "ok line\n"
    )


def test_sys_has_no_exit() -> None:
    with pytest.raises(AttributeError):
        output("import usys\nusys.exit()")


def test_print_exception_shows_the_line() -> None:
    source = "import usys\ntry:\n    1 / 0\nexcept Exception as e:\n    usys.print_exception(e)"
    assert output(source).splitlines()[1:] == [
        '  File "main.py", line 3, in <module>',
        "ZeroDivisionError: divide by zero",
    ]


def test_small_hub_has_less() -> None:
    city = Robot("small", HubKind.CITY)
    with pytest.raises(NameError, match="memoryview"):
        output("memoryview(b'')", robot=city)
    assert output("import micropython, uerrno\nprint(uerrno.ENODEV)", robot=city) == "19"


@pytest.mark.parametrize(
    ("expression", "answer"),
    [
        ("bytes(5, 'utf8')", "TypeError wrong number of arguments"),
        ("bytes(b'a', 'utf8')", "TypeError wrong number of arguments"),
        ("b'a' < 'b'", "True"),
        ("b'b' <= 'a'", "False"),
        ("bytearray(b'c') > 'b'", "True"),
        ("'a' < b'b'", "TypeError unsupported types for __lt__: 'str', 'bytes'"),
        ("5 in 6", "TypeError unsupported types for : 'int', 'int'"),
        ("5 not in 2.0", "TypeError unsupported types for : 'int', 'float'"),
        ("5 in None", "TypeError 'NoneType' object isn't iterable"),
        ("'a' in 5", "TypeError 'int' object isn't iterable"),
        ("True in 5", "TypeError unsupported types for __contains__: 'int', 'int'"),
        ("OSError([1])", "[1]"),
        ("OSError(11.0)", "11.0"),
        ("OSError(True)", "True"),
        ("OSError(11)", "[Errno 11] EAGAIN"),
        ("round(True, 1)", "1.0"),
        ("round(True)", "1"),
        ("round(7, 1)", "NotImplementedError "),
        ("type((2,))[1:]", "TypeError 'type' object isn't subscriptable"),
        ("kind[0]", "TypeError 'type' object isn't subscriptable"),
        ("other[0]", "1"),
        ("umath.isfinite((1,))", "TypeError can't convert tuple to float"),
        ("umath.isnan('a')", "TypeError can't convert str to float"),
        (
            "str(b'a', 'utf-8', 'ignore', 1)",
            "TypeError function expected at most 3 arguments, got 4",
        ),
        ("str(b'a', 'utf-8', 'ignore')", "a"),
        ("uerrno.errorcode.pop(1)", "TypeError "),
        ("uerrno.errorcode.setdefault(1, 2)", "TypeError "),
        ("uerrno.errorcode.update({})", "TypeError "),
        ("uerrno.errorcode.clear()", "TypeError "),
        ("len(dict(uerrno.errorcode))", "9"),
        ("uerrno.errorcode.copy().pop(5)", "EIO"),
        ("gc.threshold(100), gc.threshold()", "None 96"),
        ("gc.threshold(-1), gc.threshold()", "None -1"),
    ],
)
def test_small_things_are_as_the_firmware_has_them(expression: str, answer: str) -> None:
    """As its code, built for a computer (v4.1.0b2), answers."""
    source = (
        "import gc, uerrno, umath\nkind, other = type([]), [1]\nkind = type([])\ntry:\n"
        f"    print({expression})\n"
    )
    assert (
        output(source + "except Exception as e:\n    print(repr(e).split('(')[0], e)").rstrip()
        == answer.rstrip()
    )


@pytest.mark.parametrize(
    ("value", "written"),
    [
        ("'ü☃'", '"ü☃"'),
        ("b'ab'", '"ab"'),
        ("{1: 'a'}", '{"1": "a"}'),
        ("{None: ()}", '{"null": []}'),
        ("[True, 0.5, -3]", "[true, 0.5, -3]"),
        (r"'a\n\"\\'", r'"a\n\"\\"'),
    ],
)
def test_json_is_written_as_by_a_hub(value: str, written: str) -> None:
    """Letters beyond ASCII stay, a key is a text, bytes are one."""
    printed = output(f"import ujson\nprint(ujson.dumps({value}))")
    # A hub sends bytes, each of which is a letter here.
    assert printed.encode("latin-1").decode() == written


def test_json_goes_through_streams() -> None:
    source = """
import uio, ujson
stream = uio.StringIO()
ujson.dump({"a": [1, 2]}, stream, separators=(",", ":"))
print(stream.getvalue())
stream.seek(0)
print(ujson.load(stream))
"""
    assert output(source).splitlines() == ['{"a":[1,2]}', "{'a': [1, 2]}"]


def test_streams_have_a_place() -> None:
    source = """
import uio
data = uio.BytesIO(b"abcdef")
print(data.seek(2), data.read(2), data.seek(-1, 2), data.read(), data.seek(1), data.tell())
print(data.write(b"XY"), data.getvalue(), data.read())
text = uio.StringIO("one\\ntwo")
print(repr(text.readline()), text.seek(0), text.read(), text.read())
"""
    assert output(source).splitlines() == [
        "2 b'cd' 5 b'f' 1 1",
        "2 b'aXYdef' b'def'",
        "'one\\n' 0 one",
        "two ",
    ]


def test_names_of_executed_text() -> None:
    """In the program's own names, in one given dict, or in two: assignments go to the second."""
    source = """
exec("own = 1")
print(own)
names = {"a": 2}
exec("b = a + 1", names)
print(names["b"], "a" in names, "own" in names, "__name__" in names)
exec("c = a + b", names, names)
print(names["c"])
inner = {}
exec("d = a; a = 9", names, inner)
print(inner["d"], inner["a"], names["a"], "d" in names)
print(eval("a + x", {"a": 1}, {"x": 5}), eval("own + 1"))

def function():
    local = 7
    exec("made = 8")
    return made

print(function(), made)
"""
    assert output(source).splitlines() == [
        "1",
        "3 True False False",
        "5",
        "2 9 2 False",
        "6 2",
        "8 8",
    ]


def test_small_things_that_programs_of_others_use() -> None:
    source = """
import micropython, usys
print(micropython.heap_unlock(), micropython.heap_lock(), micropython.heap_lock())
print(micropython.heap_unlock(), micropython.heap_unlock(), micropython.heap_unlock())
print(micropython.opt_level(), micropython.opt_level(2), micropython.opt_level())
print(micropython.const(5), micropython.stack_use())
with usys.stdout as out:
    print(out is usys.stdout, out.close())
def function(): pass
def generator(): yield
print(function, generator, print)
print([].append is not None, iter([]), reversed([]), zip(), enumerate([]), map(len, []))
class Thing: pass
print(type(3), Thing, OSError, type(None), object())
"""
    assert output(source).splitlines() == [
        "0 None None",
        "1 0 0",
        "0 None 2",
        "5 0",
        "True None",
        "<function> <generator> <function>",
        "True <iterator> <reversed> <zip> <enumerate> <map>",
        "<class 'int'> <class 'Thing'> <class 'OSError'> <class 'NoneType'> <object>",
    ]


def test_globals_are_shown_without_what_python_adds() -> None:
    assert output("a = 1\nprint(globals())") == "{'__name__': '__main__', 'a': 1}"
