"""What programs read from their console and write to it: lines, characters, polls, streams."""

from __future__ import annotations

import pytest
from hub_programs import Console, output

from brickhub import robot as robots
from brickhub.virtual.bench_body import BenchBody
from brickhub.virtual.interpreter import execute
from brickhub.virtual.machine import Machine
from brickhub.virtual.pybricks import modules

HEAD = """
from pybricks.tools import StopWatch
from uselect import POLLERR, POLLHUP, POLLIN, POLLOUT, poll, select
from usys import stderr, stdin, stdout
import micropython, uio, ujson
watch = StopWatch()
def error(call, *values, **named):
    try:
        return call(*values, **named)
    except BaseException as raised:
        return repr(raised)
"""


def sent(source: str, arrivals: dict[int, bytes]) -> bytes:
    """Bytes that a program sends, with this input at these times."""
    machine = Machine(BenchBody(robots.BENCH))
    console = Console(machine, arrivals)
    execute(HEAD + source, "main.py", modules(machine, console), console)
    return console.written


def shown(source: str, arrivals: dict[int, bytes] | None = None) -> list[str]:
    return output(HEAD + source, arrivals).splitlines()


# ---- the line editor of input()


@pytest.mark.parametrize(
    ("typed", "line", "echo"),
    [
        (b"\r", "", b""),
        (b"ab\r", "ab", b"ab"),
        (b"a b~!\r", "a b~!", b"a b~!"),
        (b"a\nb\r", "ab", b"ab"),
        (b"a\x1f\x80\xffb\r", "ab", b"ab"),
        (b"ab\x08c\r", "ac", b"ab\b\x1b[Kc"),
        (b"ab\x7fc\r", "ac", b"ab\b\x1b[Kc"),
        (b"\x08\x7fab\r", "ab", b"ab"),
        (b"a\x08\x08b\r", "b", b"a\b\x1b[Kb"),
        (b"a\x04b\r", "ab", b"ab"),
    ],
)
def test_a_line_is_edited_and_echoed(typed: bytes, line: str, echo: bytes) -> None:
    written = sent("line = input('? ')\nprint(repr(line))", {0: typed})
    assert written == b"? " + echo + b"\r\n" + repr(line).encode() + b"\r\n"


def test_a_line_ends_by_control_keys() -> None:
    assert shown("print(error(input))", {0: b"\x04"})[-1] == "EOFError()"
    source = "micropython.kbd_intr(-1)\nprint(error(input, 5))"
    assert shown(source, {0: b"ab\x03"})[-1].endswith("KeyboardInterrupt()")


# ---- standard streams


def test_texts_and_bytes_of_standard_input() -> None:
    source = """
print(repr(stdin.read(3)), repr(stdin.read(0)), repr(stdin.read(1)))
print(stdin.buffer.read(2), stdin.buffer.read(0))
"""
    data = "a\u00e9\u2603\U0001f600".encode() + b"\r\x00"
    printed = sent(source, {0: data + b"\x01\x02"}).decode().splitlines()
    assert printed[0] == "'a\\xe9\\u2603' '' '\\U0001f600'"
    assert printed[1] == "b'\\r\\x00' b''", "the bytes are as they came"


def test_lines_end_at_a_line_feed_or_at_a_size() -> None:
    source = """
print(repr(stdin.readline()), repr(stdin.readline(2)), repr(stdin.readline(9)), repr(stdin.readline()))
print(stdin.buffer.readline(), stdin.buffer.readline(3), stdin.buffer.readline(0))
"""  # noqa: E501
    arrivals = {0: b"one\rtwo\nthree\nfour\nabcdef"}
    assert shown(source, arrivals) == [
        "'one\\n' 'tw' 'o\\n' 'three\\n'",
        "b'four\\n' b'abc' b''",
    ]


def test_reading_into_a_buffer() -> None:
    source = """
buffer = bytearray(4)
print(stdin.buffer.readinto(buffer), buffer)
print(stdin.buffer.readinto(buffer, 2), buffer)
print(stdin.buffer.readinto(buffer, 9), buffer)
print(stdin.buffer.readinto(memoryview(buffer)[1:3]), buffer)
print(error(stdin.buffer.readinto, b"abcd"))
"""
    assert shown(source, {0: b"abcdefghijkl"}) == [
        "4 bytearray(b'abcd')",
        "2 bytearray(b'efcd')",
        "4 bytearray(b'ghij')",
        "2 bytearray(b'gklj')",
        "TypeError('object with buffer protocol required',)",
    ]


def test_what_is_written_is_counted_in_bytes() -> None:
    source = """
counts = [stdout.write("a\\n"), stdout.write("\\u00e9"), stdout.write(b"xyz", 2)]
counts += [stdout.write("abcdef", 1, 3), stdout.write("abc", 1, -1), stdout.buffer.write(b"1\\n")]
counts += [stdout.write("abc", -1), stderr.write("e")]
print()
print(counts)
"""
    assert sent(source, {}) == (b"a\r\n\xc3\xa9xybcdbc1\nabce\r\n[2, 2, 2, 3, 2, 2, 3, 1]\r\n")


def test_each_standard_stream_has_its_direction() -> None:
    source = """
print(error(stdin.write, "a"), error(stdout.read, 1), error(stderr.read))
print(stdin, stdout, stderr, stdin.buffer, stdout.buffer)
"""
    assert shown(source) == [
        "OSError(1,) OSError(1,) OSError(1,)",
        (
            "<io.TextIOWrapper 0> <io.TextIOWrapper 1> <io.TextIOWrapper 2> <io.FileIO 0> "
            "<io.FileIO 0>"
        ),
    ]


def test_a_byte_of_ones_own_interrupts() -> None:
    source = "micropython.kbd_intr({})\nprint(error(stdin.buffer.read, 1))"
    arrivals = {0: b"\x03"}
    assert shown(source.format(3), arrivals) == ["KeyboardInterrupt()"]
    assert shown(source.format(-1), arrivals) == ["b'\\x03'"]
    assert shown(source.format(4), arrivals) == ["b'\\x03'"]
    assert shown(source.format(0), {0: b"\x00"}) == ["KeyboardInterrupt()"]
    assert shown('print(error(micropython.kbd_intr, "a"))') == [
        'TypeError("can\'t convert str to int",)'
    ]


def test_printing_to_a_stream_writes_each_piece() -> None:
    source = """
class Stream(uio.IOBase):
    def __init__(self):
        self.pieces = []
    def write(self, piece):
        self.pieces.append(piece)
stream = Stream()
print("a", 5, end="!", sep="-", file=stream)
print(stream.pieces)
print(error(print, "a", file=5), error(print, 1, sep=5), error(print, 1, end=None))
"""
    try_none = "TypeError(\"can't convert 'NoneType' object to str implicitly\",)"
    printed = shown(source)
    assert printed[0] == ("[bytearray(b'a'), bytearray(b'-'), bytearray(b'5'), bytearray(b'!')]")
    assert printed[1] == (
        "OSError('stream operation not supported',) "
        f"TypeError(\"can't convert 'int' object to str implicitly\",) {try_none}"
    )


# ---- polls


def test_a_poll_looks_at_what_is_registered() -> None:
    source = """
keys = poll()
print(keys.poll(0), error(keys.modify, stdin, POLLIN), error(keys.register, 5))
keys.register(stdin)
print([event for _, event in keys.poll(0)], [stream is stdin for stream, _ in keys.poll(0)])
print(keys.modify(stdin, POLLOUT), keys.poll(0), keys.modify(stdin, POLLIN), len(keys.poll(0)))
print(keys.unregister(stdin), keys.poll(0), keys.unregister(stdin))
keys.register(stdin, POLLOUT)
print(keys.poll(0), POLLIN, POLLOUT, POLLERR, POLLHUP)
"""
    assert shown(source, {0: b"a"}) == [
        "[] OSError(2,) OSError('stream operation not supported',)",
        "[1] [True]",
        "None [] None 1",
        "None [] None",
        "[] 1 4 8 16",
    ]


def test_a_one_shot_stream_is_ready_once() -> None:
    source = """
keys = poll()
keys.register(stdin, POLLIN)
print(len(list(keys.ipoll(0))), len(keys.poll(0, 0)), len(keys.poll(0, 2)))
print(len(list(keys.ipoll(0, 1))), keys.poll(0), list(keys.ipoll(0)))
keys.modify(stdin, POLLIN)
print(len(keys.poll(0, 3)), keys.poll(0))
"""
    assert shown(source, {0: b"a"}) == ["1 1 1", "1 [] []", "1 []"]


def test_a_poll_ends_when_something_comes_or_after_its_time() -> None:
    source = """
keys = poll()
keys.register(stdin, POLLIN)
print(keys.poll(30), watch.time())
print(len(keys.poll(500)), watch.time())
stdin.read(1)
print(len(list(keys.ipoll(50))), watch.time())
print(len(keys.poll()), watch.time())
stdin.read(1)
print(len(list(keys.ipoll())), watch.time())
"""
    arrivals = {100: b"a", 1400: b"b", 4000: b"c"}
    assert shown(source, arrivals) == ["[] 30", "1 100", "0 150", "1 1400", "1 4000"]


def test_select_sorts_streams_by_what_they_are_ready_for() -> None:
    source = """
def counts(groups):
    return [len(group) for group in groups]
print(counts(select([stdin], [], [], 0)), counts(select([], [stdin], [], 0)))
print(counts(select([], [], [stdin], 0)), counts(select([stdin], [stdin], [stdin], 0)))
print(counts(select((), (), (), 0.25)), watch.time())
stdin.read(1)
print(counts(select([stdin], [], [], 0.0159)), watch.time())
print(counts(select([stdin], [], [], -1)), watch.time())
stdin.read(1)
print(counts(select([stdin], [], [])), watch.time())
for groups in ((5, [], []), ([], 5, []), ([], [], "a")):
    print(error(select, *groups))
"""
    arrivals = {0: b"a", 1000: b"b", 2500: b"c"}
    assert shown(source, arrivals) == [
        "[1, 0, 0] [0, 0, 0]",
        "[0, 0, 0] [1, 0, 0]",
        "[0, 0, 0] 250",
        "[0, 0, 0] 265",
        "[1, 0, 0] 1000",
        "[1, 0, 0] 2500",
        "TypeError(\"object 'int' isn't a tuple or list\",)",
        "TypeError(\"object 'int' isn't a tuple or list\",)",
        "TypeError(\"object 'str' isn't a tuple or list\",)",
    ]


# ---- streams in memory


def test_streams_in_memory() -> None:
    source = """
data = uio.BytesIO(b"abcdef")
buffer = bytearray(4)
print(data.readinto(buffer, 2), bytes(buffer))
print(data.readinto(buffer), bytes(buffer), data.readinto(buffer))
print(data.seek(0), data.write(b"xyz", 2), data.write(b"12345", 1, 2), data.getvalue())
print(error(data.seek, -1), data.seek(-2, 2), data.read(), data.seek(1, 1), data.read())
print(uio.BytesIO(20).getvalue(), uio.StringIO(20).getvalue() == "", uio.BytesIO("a").read())
text = uio.StringIO("one\\ntwo\\n\\nfour")
print([line for line in text], error(next, text))
text = uio.StringIO("abc")
print(text.read(2), repr(text.read(5)), repr(text.read()), text.seek(1), text.readline(1))
print(text.write("XYZ"), text.getvalue())
print(str(data)[:14], str(text)[:15])
"""
    assert shown(source) == [
        "2 b'ab\\x00\\x00'",
        "4 b'cdef' 0",
        "0 2 2 b'xy23ef'",
        "OSError(22,) 4 b'ef' 7 b''",
        "b'' True b'a'",
        "['one\\n', 'two\\n', '\\n', 'four'] StopIteration()",
        "ab 'c' '' 1 b",
        "3 abXYZ",
        "<io.BytesIO 0x <io.StringIO 0x",
    ]


# ---- JSON


@pytest.mark.parametrize(
    ("text", "value"),
    [
        ("null", "None"),
        ("[true, false]", "[True, False]"),
        (" \t\r\n[ 1 , 2 ] \v\f", "[1, 2]"),
        ("[]", "[]"),
        ("{}", "{}"),
        ("[[], {}, [[1]]]", "[[], {}, [[1]]]"),
        ('{"a": {"b": [1, {"c": 2}]}}', "{'a': {'b': [1, {'c': 2}]}}"),
        ('{"a": [1], "b": []}', "{'a': [1], 'b': []}"),
        ("1e3", "1000.0"),
        ("-1.5", "-1.5"),
        ("2E2", "200.0"),
        ("-7", "-7"),
        ('"\\b\\f\\n\\r\\t\\/\\\\"', "'\\x08\\x0c\\n\\r\\t/\\\\'"),
        ('"\\u0041\\u00e9"', "'A\\xe9'"),
        ("1073741823", "1073741823"),
        ("-1073741823", "-1073741823"),
        ("1073741824", "OverflowError('long int not supported in this build',)"),
        ('"\\u00g0"', "ValueError('syntax error in JSON',)"),
        ("[1", "ValueError('syntax error in JSON',)"),
        ("{{}: 1}", "ValueError('syntax error in JSON',)"),
        ("[] []", "ValueError('syntax error in JSON',)"),
        ("", "ValueError('syntax error in JSON',)"),
        ("True", "ValueError('syntax error in JSON',)"),
    ],
)
def test_json_is_read(text: str, value: str) -> None:
    source = f"""
try:
    print(repr(ujson.loads({text!r})))
except Exception as raised:
    print(repr(raised))
"""
    assert shown(source) == [value]


def test_json_is_written_with_separators() -> None:
    source = """
value = [1, {"a": 2}, (True, None)]
print(ujson.dumps(value))
print(ujson.dumps(value, separators=(";", "=")))
stream = uio.StringIO()
ujson.dump(value, stream)
print(stream.getvalue())
print(ujson.load(uio.StringIO("[1, 2]")), ujson.loads(b"[3]"), ujson.loads(bytearray(b"4")))
print(error(ujson.load, 5), ujson.dumps(0.1), ujson.dumps({0.5: 1, True: 2}))
"""
    assert shown(source) == [
        '[1, {"a": 2}, [true, null]]',
        '[1;{"a"=2};[true;null]]',
        '[1, {"a": 2}, [true, null]]',
        "[1, 2] [3] 4",
        ('OSError(\'stream operation not supported\',) 0.1 {"0.5": 1, "true": 2}'),
    ]
