"""MicroPython on a hub: numbers, text, builtins, errors. Expected texts are from MicroPython."""

from __future__ import annotations

import struct

import pytest
from hub_programs import output
from hypothesis import given
from hypothesis import strategies as st

from brickhub.virtual.interpreter import Modules, execute
from brickhub.virtual.micropython.exceptions import reword
from brickhub.virtual.micropython.floats import float_text, to_single
from brickhub.virtual.micropython.numbers import struct_module
from brickhub.virtual.micropython.text import format_traceback


class Recorder:
    """A console that records output and has given input."""

    def __init__(self, data: bytes = b"") -> None:
        self.data = data
        self.written = b""

    def available(self) -> int:
        return len(self.data)

    def read(self, n: int) -> bytes:
        head, self.data = self.data[:n], self.data[n:]
        return head

    def write(self, data: bytes) -> None:
        self.written += data


def printed(source: str, data: bytes = b"") -> str:
    console = Recorder(data)
    execute(source, "main.py", {}, console)
    return console.written.decode().replace("\r\n", "\n").removesuffix("\n")


def traceback_of(source: str) -> str:
    with pytest.raises(Exception) as caught:  # noqa: PT011 - any error of a program
        printed(source)
    return format_traceback(caught.value, "main.py")


@pytest.mark.parametrize(
    ("expression", "expected"),
    [
        ("1/3", "0.33333334"),
        ("0.1+0.2", "0.3"),
        ("1e10", "10000000000.0"),
        ("123456.789", "123456.79"),
        ("1234567.0", "1234567.0"),
        ("12345678.0", "12345678.0"),
        ("1e-05", "1e-05"),
        ("-0.0", "-0.0"),
        ("3e38*10", "inf"),
        ("16777216.0 + 1", "16777216.0"),
        ("16777216.0 + 1 == 16777216.0", "True"),
        ("123456789 / 1000", "123456.79"),
        ("7.5 // 2", "3.0"),
        ("-7 // 2, -7 % 3, divmod(-7, 2)", "(-4, 2, (-4, 1))"),
        ("2**-1, 2**10, 2.0**0.5", "(0.5, 1024, 1.4142135)"),
        ("round(2.5), round(2.567, 2), int(-3.9)", "(2, 2.57, -3)"),
        ("sum([0.1] * 10)", "1.0000001"),
        ("float('0.1'), int('0x10', 0), int(' 12 ')", "(0.1, 16, 12)"),
        ("list(map(int, '1 2'.split())), list(map(str, [0.1]))", "([1, 2], ['0.1'])"),
    ],
)
def test_numbers(expression: str, expected: str) -> None:
    assert printed(f"print(({expression}))") == expected


@given(
    st.floats(width=32, allow_nan=False, allow_infinity=False),
    st.floats(width=32, allow_nan=False, allow_infinity=False),
)
def test_arithmetic_is_single_precision(a: float, b: float) -> None:
    given, wanted = struct.pack("<2f", a, b), struct.pack("<2f", to_single(a + b), to_single(a * b))
    source = (
        f"import struct\na, b = struct.unpack('<2f', {given!r})\n"
        f"print(struct.pack('<2f', a + b, a * b) == {wanted!r})"
    )
    console = Recorder()
    execute(source, "main.py", {"struct": struct_module()}, console)
    assert console.written == b"True\r\n"


@pytest.mark.parametrize(
    ("source", "expected"),
    [
        ("3.14159265, 0.1 + 0.2, 100 / 3, 2 / 3, 731.2715",
         "(3.1415928, 0.3, 33.333332, 0.6666667, 731.2715)"),
        ("1e15, 1e16, 0.0001, 0.00001, 16777216.0",
         "(1000000000000000.0, 1e+16, 0.0001, 1e-05, 16777216.0)"),
        ("'{:.8f} {:.2f} {:6.1f}|'.format(0.1, 123456789.0, -0.05)",
         "0.10000000 123456790.00   -0.0|"),
        ("'{:10}|{:<8}|{:*^9.1f}|{:08.2f}'.format(3.14159265, 2.0, 0.5, -1.005)",
         "   3.14159|2       |***0.5***|-0001.00"),
        ("'%f %e %g %8.3f|%-8.1f|%+05.1f' % (1/3, 12345.678, 1e-5, 2.5, 0.25, 9.99)",
         "0.333333 1.234568e+04 1e-05    2.500|0.2     |+10.0"),
        ("'{:.1%} {:n} {:+.1f} {: .1f} {:E}'.format(0.256, 1.5, 2, 2, 1e10)",
         "25.6% 1.5 +2.0  2.0 1.000000E+10"),
        ("1 + 2j, -2j, (1.5 - 0.5j) * 2", "((1+2j), -2j, (3-1j))"),
        ("float('3.14159265358979') == 3.14159265358979, float('1_000.5'), float('-inf')",
         "(True, 1000.5, -inf)"),
    ],
)  # fmt: skip
def test_float_text_is_single_precision(source: str, expected: str) -> None:
    """Expected: MicroPython 1.26.1, built for 32 bits with Pybricks' configuration."""
    assert printed(f"print(({source}))") == expected


@given(st.floats(width=32, allow_nan=False, allow_infinity=False, allow_subnormal=False))
def test_float_text_round_trip_is_close(x: float) -> None:
    text = float_text(x)
    assert float(text) == pytest.approx(x, rel=1e-6, abs=1e-44)
    assert set(text) & set(".en")


@given(st.integers(1, 0x7FFFFF))
def test_subnormal_floats(bits: int) -> None:
    """A hub scales them by missing bits: the text differs slightly."""
    (x,) = struct.unpack("<f", struct.pack("<I", bits))
    assert 0 < float(float_text(x)) < 2.0**-124
    assert float_text(-x) == "-" + float_text(x)


@pytest.mark.parametrize(
    "statement",
    [
        "x = 0x3fffffff; x += 1",
        "x = 1 << 15; x = x * x * x",
        "x = 1; x = x << 30",
        "x = -2; x = x ** 31",
        "x = [2**15]; x[0] *= 2**15",
    ],
)
def test_integers_have_31_bits(statement: str) -> None:
    assert traceback_of(statement).endswith("OverflowError: small int overflow\n")


def test_smallest_and_largest_integers_work() -> None:
    assert (
        printed("print(-1073741824, 0x3fffffff, -0x3fffffff - 1)")
        == "-1073741824 1073741823 -1073741824"
    )


@pytest.mark.parametrize(
    "number",
    [
        "1 << 40",
        "2 ** 31",
        "-2 ** 40",
        "(1, (2, 99999999999))",
        "(1, -0x40000000)",
        "0x7FFFFFFF if 0 else 1",
    ],
)
def test_long_constant_raises_before_execution(number: str) -> None:
    console = Recorder()
    with pytest.raises(OverflowError, match="long int not supported"):
        execute(
            f"print(1, 'text', b'bytes', 1.5)\ndef f():\n    return {number}",
            "main.py",
            {},
            console,
        )
    assert console.written == b""


def test_other_constants_are_allowed() -> None:
    source = (
        "x = ('text', b'bytes', 1.5, None, True, ..., (1, 2), 2j, 0x3FFFFFFF)\n"
        "print(len(x), x[6], -0x40000000)"
    )
    assert printed(source) == "9 (1, 2) -1073741824"


@pytest.mark.parametrize(
    ("source", "expected"),
    [
        ("f'{1/3} {5:03d} {0.5:.2f} {\"a\":>3}'", "0.33333334 005 0.50   a"),
        ("'{:.0f} {:.1f}'.format(2.5, 0.25)", "3 0.2"),
        (
            "'{:10}|{:<5}|{:^5}|{:+d}|{:x}|{}'.format('a', 1, 4, 5, 255, [0.1])",
            "a         |1    |  4  |+5|ff|[0.1]",
        ),
        (
            "'%5.2f|%-5d|%05d|%x|%s|%r|%%' % (3.14159, 3, 4, 255, None, 'a')",
            " 3.14|3    |00004|ff|None|'a'|%",
        ),
        ("'%d %s' % (1.9, [1.0, (2,)])", "1 [1.0, (2,)]"),
        ("\"it's\", b'a\\n\\xff', 'a\\tb\\u00e9'", "(\"it's\", b'a\\n\\xff', 'a\\tb\\xe9')"),
        (
            "range(3), range(0, 6, 2), set(), {1: 0.5}",
            "(range(0, 3), range(0, 6, 2), set(), {1: 0.5})",
        ),
        ("bytearray(b'x'), True, None, ...", "(bytearray(b'x'), True, None, Ellipsis)"),
        (
            "ValueError('x'), ValueError(), OSError(19)",
            "(ValueError('x',), ValueError(), OSError(19,))",
        ),
        ("OSError(5, 'a', 'b')", "(5, 'a', 'b')"),
        ("OSError(5, 'a', 'b', 'c').args", "(5, 'a', 'b', 'c')"),
        (
            "int, type(None), ValueError",
            "(<class 'int'>, <class 'NoneType'>, <class 'ValueError'>)",
        ),
    ],
)
def test_text_of_values(source: str, expected: str) -> None:
    assert printed(f"print(({source}))") == expected


def test_object_text_equals_hub() -> None:
    source = """
class A:
    pass
class B:
    def __str__(self):
        return 'b!'
class E(Exception):
    pass
print(B(), f'{B()}', '{}'.format(B()), '%s' % B(), [E('x')])
print(str(A())[:13])
"""
    assert printed(source) == "b! b! b! b! [E('x',)]\n<A object at "


@pytest.mark.parametrize(
    ("statement", "message"),
    [
        ("1/0", "ZeroDivisionError: divide by zero"),
        ("1.0 % 0", "ZeroDivisionError: divide by zero"),
        ("nope", "NameError: name 'nope' isn't defined"),
        ("1 + 'a'", "TypeError: unsupported types for __add__: 'int', 'str'"),
        ("'a' + 1", "TypeError: unsupported types for __add__: 'str', 'int'"),
        ("None < 1", "TypeError: unsupported types for __lt__: 'NoneType', 'int'"),
        ("-'a'", "TypeError: unsupported type for __neg__: 'str'"),
        ("5()", "TypeError: 'int' object isn't callable"),
        ("for i in 5: pass", "TypeError: 'int' object isn't iterable"),
        ("None[0]", "TypeError: 'NoneType' object isn't subscriptable"),
        ("(1, 2)[0] = 3", "TypeError: 'tuple' object doesn't support item assignment"),
        ("[1][3]", "IndexError: list index out of range"),
        ("{}['a']", "KeyError: a"),
        ("a, b = [1]", "ValueError: need more than 1 values to unpack"),
        ("[1].remove(5)", "ValueError: object not in sequence"),
        ("int('x')", "ValueError: invalid syntax for integer with base 10: 'x'"),
        ("float('x')", "ValueError: invalid syntax for number"),
        ("int(1e10)", "ValueError: float too big"),
        ("raise OSError(19, 'x')", "OSError: [Errno 19] ENODEV: x"),
        ("raise ValueError", "ValueError: "),
        ("'%d %d' % (1,)", "TypeError: format string needs more arguments"),
        ("import time", "ImportError: no module named 'time'"),
        ("def f(a): pass\nf()", "TypeError: f() takes 1 positional arguments but 0 were given"),
        ("def f(a): pass\nf(1, 2)", "TypeError: f() takes 1 positional arguments but 2 were given"),
        ("def f(a): pass\nf(b=1)", "TypeError: unexpected keyword argument 'b'"),
        (
            "x = 'abc'[::-1]",
            "NotImplementedError: only slices with step=1 (aka None) are supported",
        ),
        ("type(1).__name__", "AttributeError: type object 'int' has no attribute '__name__'"),
        ("'a'.encode()", "AttributeError: 'str' object has no attribute 'encode'"),
        ("(5).bit_length()", "AttributeError: 'int' object has no attribute 'bit_length'"),
        ("open('x')", "OSError: 2"),
        ("class C(int, str): pass", "NotImplementedError: multiple inheritance not supported"),
        ("range(1, 2, 0)", "ValueError: zero step"),
        ("bytes(-1)", "ValueError: "),
        ("1 in 'abc'", "TypeError: can't convert 'int' object to str implicitly"),
        (
            "'x'.join([1])",
            "TypeError: join expects a list of str/bytes objects consistent with self object",
        ),
        ("chr('a')", "TypeError: can't convert str to int"),
        ("min()", "TypeError: function missing 1 required positional arguments"),
        ("len()", "TypeError: function takes 1 positional arguments but 0 were given"),
        ("[].append()", "TypeError: function takes 2 positional arguments but 1 were given"),
        ("next(iter([]), 1)", "TypeError: function takes 1 positional arguments but 2 were given"),
        ("isinstance(1, 1)", "TypeError: issubclass() arg 2 must be a class or a tuple of classes"),
        ("int('1', 1)", "ValueError: int() arg 2 must be >= 2 and <= 36"),
        ("(300).to_bytes(1, 'little')", "OverflowError: buffer too small"),
        ("pow(2, 3, 4)", "NotImplementedError: 3-arg pow() not supported"),
        ("round(1234, -2)", "NotImplementedError: "),
        ("'{:z}'.format(1.5)", "ValueError: invalid format specifier"),
        ("bytes([256])", "ValueError: bytes value out of range"),
        ("bytearray(1.5)", "TypeError: 'float' object isn't iterable"),
        ("bytearray(2)[0] = 1.5", "TypeError: can't convert float to int"),
        ("bytearray().append('x')", "TypeError: can't convert str to int"),
        ("bytearray(x=1)", "TypeError: function doesn't take keyword arguments"),
        (
            "b = bytearray(3)\nb[1:2] = b'x'",
            "TypeError: 'bytearray' object doesn't support item assignment",
        ),
        ("(1).__class__", "AttributeError: 'int' object has no attribute '__class__'"),
        ("getattr('a', 'encode')", "AttributeError: 'str' object has no attribute 'encode'"),
        (
            "f = lambda a: a\nf()",
            "TypeError: <lambda>() takes 1 positional arguments but 0 were given",
        ),
        (
            "def f(a, b): pass\nf(b=1)",
            "TypeError: function missing required positional argument #0",
        ),
        (
            "def f():\n    def g(a): pass\n    g()\nf()",
            "TypeError: g() takes 1 positional arguments but 0 were given",
        ),
        (
            "class A:\n    def __lt__(self, other): return True\nA() > A()",
            "TypeError: unsupported types for __gt__: 'A', 'A'",
        ),
        ("class E(Exception):\n    def __str__(self): return 'x'\nraise E(7)", "E: 7"),
        (
            "class A:\n    @classmethod\n    def c(cls, x): pass\nA.c()",
            "TypeError: c() takes 2 positional arguments but 1 were given",
        ),
        (
            "list(map(lambda: 1, [1]))",
            "TypeError: <lambda>() takes 0 positional arguments but 1 were given",
        ),
        ("print(*5)", "TypeError: 'int' object isn't iterable"),
        ("'x' in None", "TypeError: 'NoneType' object isn't iterable"),
        ("'a'.replace(1, 2)", "TypeError: can't convert 'int' object to str implicitly"),
        ("'{'.format()", "ValueError: unmatched '{' in format"),
        ("[1][::0]", "ValueError: slice step can't be zero"),
    ],
)
def test_error_messages_equal_hub(statement: str, message: str) -> None:
    assert traceback_of(statement).splitlines()[-1] == message


@pytest.mark.parametrize(
    "name",
    [
        "property",
        "filter",
        "frozenset",
        "compile",
        "vars",
        "format",
        "ascii",
        "TimeoutError",
        "__file__",
    ],
)
def test_missing_builtins(name: str) -> None:
    assert traceback_of(name).endswith(f"NameError: name '{name}' isn't defined\n")


def test_memoryview_depends_on_hub() -> None:
    with pytest.raises(NameError, match="memoryview"):
        execute(
            "memoryview(b'')", "main.py", Modules({}, missing_builtins=("memoryview",)), Recorder()
        )
    execute("memoryview(b'')", "main.py", Modules({}), Recorder())


def test_handlers_see_hub_messages() -> None:
    source = """
try:
    1 / 0
except ZeroDivisionError as e:
    print(e, repr(e), e.args)
try:
    raise OSError(16)
except OSError as e:
    print(e.errno, e)
"""
    assert printed(source) == (
        "divide by zero ZeroDivisionError('divide by zero',) ('divide by zero',)\n16 [Errno "
        "16] EBUSY"
    )


def test_traceback_has_program_lines() -> None:
    source = (
        "def f(x):\n    x += 1\n    return (x *\n            'a' * None)\n\nprint(\n    f(1))\n"
    )
    assert traceback_of(source) == (
        "Traceback (most recent call last):\n"
        '  File "main.py", line 7, in <module>\n'
        '  File "main.py", line 3, in f\n'
        "TypeError: unsupported types for __mul__: 'str', 'NoneType'\n"
    )


def test_an_error_before_the_first_line_has_no_traceback() -> None:
    assert traceback_of("print(1 << 30)") == "OverflowError: long int not supported in this build\n"
    assert (
        traceback_of("print(2 ** 20000)") == "OverflowError: long int not supported in this build\n"
    )


@pytest.mark.parametrize(
    ("expression", "expected"),
    [
        (
            (
                "isinstance(True, int), isinstance(True, (int, str)), isinstance(True, bool), "
                "issubclass(bool, int)"
            ),
            "False False True False",
        ),
        ("'{:<3}|{:3}|{}'.format(True, True, True), f'{False:>2}'", "1  |  1|True  0"),
        ("(-1).to_bytes(2, 'little'), (5).to_bytes(2, 'big')", "b'\\xff\\xff' b'\\x00\\x05'"),
        ("type(len), type(lambda: 0)", "<class 'function'> <class 'function'>"),
        ("hasattr('', 'encode'), hasattr('', 'upper'), getattr(b'', 'hex', 5)", "False True 5"),
    ],
)
def test_differences_from_cpython(expression: str, expected: str) -> None:
    assert printed(f"print({expression})") == expected


def test_classes_have_no_slots_and_take_any_arguments_without_init() -> None:
    assert printed("class A:\n    __slots__ = ('x',)\na = A(1, b=2)\na.y = 5\nprint(a.y)") == "5"


def test_syntax_equals_hub_compiler() -> None:
    text = traceback_of("x = 1\nmatch x:\n    case 1: pass\n")
    assert text == (
        'Traceback (most recent call last):\n  File "main.py", line 2\n'
        "SyntaxError: invalid syntax\n"
    )


@pytest.mark.parametrize(
    ("source", "expected"),
    [
        ("x = [1, 2]\ny = x\nx += [3]\nprint(y)", "[1, 2, 3]"),
        ("class A:\n    n = 1\na = A()\na.n += 0.1\nprint(a.n)", "1.1"),
        ("d = {'a': [1, 2]}\nd['a'][1] += 5\nd['a'][0] -= 1\nprint(d)", "{'a': [0, 7]}"),
        (
            (
                "i = 0\ndef k():\n    global i\n    i += 1\n    return i\nl = [0, 0, 0]\n"
                "l[k()] += 5\nprint(l, i)"
            ),
            "[0, 5, 0] 1",
        ),
        ("s = 'a'\ns += 'b'\ns *= 2\nprint(s)", "abab"),
        ("x = 7\nx //= 2\nx **= 2\nx %= 5\nx /= 8\nprint(x)", "0.5"),
        ("x = 6\nx |= 1\nx &= 5\nx ^= 2\nx >>= 1\nx <<= 4\nprint(x)", "48"),
        ("t = '%s'\nt %= 5\nprint(t)", "5"),
    ],
)
def test_augmented_assignment(source: str, expected: str) -> None:
    assert printed(source) == expected


def test_annotations_are_skipped() -> None:
    source = (
        "class A:\n    n: List[int] = 1 / 3\ndef f(x: Nope = 2, *a: Nope) -> Nope:\n"
        "    y: Nope\n    return x\nprint(f(), A.n)"
    )
    assert printed(source) == "2 0.33333334"


def test_coroutines_are_generators() -> None:
    source = """
async def f():
    return 3
async def g():
    return await f() + 1
try:
    next(g())
except StopIteration as e:
    print(e.value)
print(str(g())[:21])
"""
    assert printed(source) == "4\n<generator object 'g'"


def test_await_makes_any_function_a_coroutine() -> None:
    source = "def f():\n    await g()\ndef g():\n    print('on')\n    yield 5\nprint(next(f()))"
    assert printed(source) == "on\n5"


def test_const_is_for_the_compiler() -> None:
    source = """
_A = const(2)
class B:
    C = const(_A + 1)
print(_A, B.C)
const(4)
"""
    assert traceback_of(source).endswith(
        "line 6, in <module>\nNameError: name 'const' isn't defined\n"
    )


def test_constants_stand_wherever_their_name_is_read() -> None:
    """In whatever scope, from its line on (mpy-cross, and the firmware built for a computer)."""
    source = """
def before():
    return LIMIT
class A:
    _N = const(4)
    LIMIT = const(5)
    def total(self, LIMIT):
        return _N + LIMIT
print(A().total(100), A.LIMIT, hasattr(A, "_N"))
def f():
    INNER = const(7)
f()
print(INNER)
try:
    before()
except NameError as e:
    print(e)
"""
    assert printed(source) == "9 5 False\n7\nname 'LIMIT' isn't defined"


def test_program_can_import_itself() -> None:
    assert printed("import __main__\nx = 5\nprint(__main__.x, __name__)") == "5 __main__"


def test_classes_have_module_and_qualname() -> None:
    source = """
class A:
    x = 1
def f():
    class B(Exception):
        pass
    return B
print([getattr(A, name) for name in dir(A)], A().__qualname__, f().__qualname__, f()().__module__)
print(hasattr(f, "__module__"), hasattr(int, "__module__"))
"""
    assert printed(source) == "['__main__', 'A', 1] A B __main__\nFalse False"


def test_input_echoes_and_returns_a_line() -> None:
    assert printed("print(input('name? '))", b"Bo\rrest") == "name? Bo\nBo"


def test_print_turns_newlines_into_carriage_returns() -> None:
    console = Recorder()
    execute("print('a\\nb', 1, sep='-', end='!\\n')", "main.py", {}, console)
    assert console.written == b"a\r\nb-1!\r\n"


def test_eval_and_exec_see_the_program() -> None:
    assert printed("x = 2\nprint(eval('x / 3'))\nexec('x += 0.1')\nprint(x)") == "0.6666667\n2.1"


def test_runs_are_independent() -> None:
    printed("import_me = 1")
    assert traceback_of("import_me").endswith("NameError: name 'import_me' isn't defined\n")


@pytest.mark.parametrize(
    ("source", "printed"),
    [
        (
            "x = 1\nx = [*range(3)]",
            '  File "main.py", line 2, in <module>\nSyntaxError: *x must be assignment target\n',
        ),
        (
            "def f():\n    break",
            "  File \"main.py\", line 2, in f\nSyntaxError: 'break'/'continue' outside loop\n",
        ),
        ("x = )", '  File "main.py", line 1\nSyntaxError: invalid syntax\n'),
    ],
)
def test_compiler_errors_have_file_and_line(source: str, printed: str) -> None:
    with pytest.raises(SyntaxError) as caught:
        output(source)
    assert (
        format_traceback(caught.value, "main.py")
        == "Traceback (most recent call last):\n" + printed
    )


def test_lone_number_is_omitted() -> None:
    assert output("10**9*3\nprint('on')") == "on"


def test_syntax_error_has_text_only() -> None:
    assert output(
        "try:\n    exec('x = (')\nexcept SyntaxError as e:\n    print(e.args, repr(e))"
    ) == ("('invalid syntax',) SyntaxError('invalid syntax',)")


def test_bytearray_keeps_the_last_eight_bits() -> None:
    """Of a stored, appended, added or first number (``mp_binary_set_val_array``), also in a copy or
    a part."""
    source = """
b = bytearray([256, -1, 515])
b[0] = 300
b[-1] -= 4
b.append(1023)
b.extend((257, -2))
b += bytearray([511])
b += "z"
part = b[1:3]
part[0] = 256
both = b[:1] + b"x"
both[1] += 256
print(b, part, both, type(b), bytearray(3), bytearray("ab", "utf-8"), b[1:3] == b"\\xff\\xff")
"""
    assert printed(source) == (
        "bytearray(b',\\xff\\xff\\xff\\x01\\xfe\\xffz') bytearray(b'\\x00\\xff') "
        "bytearray(b',x') <class 'bytearray'> "
        "bytearray(b'\\x00\\x00\\x00') bytearray(b'ab') True"
    )


@pytest.mark.parametrize("loop", ["[i for i in (1,)]", "{i: i for i in (1,)}", "{i for i in (1,)}",
    "any(i for i in (0,))",
                                  "[i for i in (1,) if i > 1]", "1 if m else 2"])  # fmt: skip
def test_a_comprehension_branches(loop: str) -> None:
    """``compile_scope_comp_iter`` jumps after each element and at each condition: the hub's
    clockwork goes on."""
    source = """
from pybricks.parameters import Port
from pybricks.pupdevices import Motor
from pybricks.tools import wait
m = Motor(Port.A)
m.run(1000)
wait(504)
{}
print(m.angle())
"""
    assert (output(source.format("()")), output(source.format(loop))) == ("251", "252")


@pytest.mark.parametrize(
    ("error", "message"),
    [
        (ValueError("min() iterable argument is empty"), "arg is an empty sequence"),
        (
            TypeError("argument of type 'int' is not a container or iterable"),
            "'int' object isn't iterable",
        ),
        (
            TypeError("cannot use 'list' as a dict key (unhashable type: 'list')"),
            "unsupported type for __hash__: 'list'",
        ),
        (
            TypeError("f() got an unexpected keyword argument 'blue'. Did you mean 'glue'?"),
            "unexpected keyword argument 'blue'",
        ),
        (
            TypeError(
                "Motor.run() got an unexpected keyword argument 'sped'. Did you mean 'speed'?"
            ),
            "extra keyword arguments given",
        ),
    ],
)
def test_messages_of_newer_python_are_understood(error: Exception, message: str) -> None:
    names: dict[str, object] = {"__builtins__": {"@n": None}}
    exec("def f(glue): pass", names)  # noqa: S102  its globals are those of a program
    assert reword(error, [names]).args == (message,)


def test_list_comprehensions_are_functions_of_their_own() -> None:
    source = """
numbers = iter([1, 2])
try:
    print([next(numbers) for _ in range(3)])
except StopIteration:
    print('stopped')
n = 5
print([n for n in range(3) if all(n % d for d in range(2, n))], n, [m + n for m in (1, 2) if [n for n in ()] == []])
class A:
    x = 3
    y = [i for i in range(x)]
print(A.y)
def f(k):
    return [lambda: k for k in range(2)], k
print([g() for g in f(7)[0]], f(7)[1])
"""  # noqa: E501
    assert printed(source) == "stopped\n[0, 1, 2] 5 [6, 7]\n[0, 1, 2]\n[1, 1] 7"
