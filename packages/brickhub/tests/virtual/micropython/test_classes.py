"""Classes, attributes and calls. Expected: MicroPython 1.26.1 with Pybricks' configuration."""

from __future__ import annotations

import pytest
from hub_programs import output

_SHAPES = """
class Shape:
    sides = 0
    def area(self):
        return 1
class Square(Shape):
    def __init__(self, side):
        try:
            super().__init__()
        except AttributeError as error:
            print(error)
        self.__side = side
    def area(self):
        return super().area() + self.__side + super().sides
class Tile(Square):
    def side(self):
        return self.__side
"""


def test_super_finds_base_class_but_not_object() -> None:
    assert (
        output(_SHAPES + "print(Square(4).area())")
        == "'super' object has no attribute '__init__'\n5"
    )
    assert (
        output(
            "class E(Exception):\n def __init__(self, a):\n  super().__init__(a, 2)\n"
            "print(repr(E(1)))"
        )
        == "E(1, 2)"
    )
    assert (
        output(
            "class L(list):\n def append(self, x):\n  super().append(2 * x)\na = L()\n"
            "a.append(3)\nprint(a)"
        )
        == "[6]"
    )


def test_private_names_are_not_mangled() -> None:
    assert output(
        _SHAPES + "tile = Tile(3)\nprint(tile.side(), tile.__side, '__side' in dir(tile))"
    ).endswith("3 3 True")
    with pytest.raises(AttributeError, match="'Square' object has no attribute '__edge'"):
        output(_SHAPES + "class A(Square):\n def f(self):\n  return Square(1).__edge\nA(1).f()")


def test_default_initializer_is_no_attribute() -> None:
    with pytest.raises(AttributeError, match="type object 'Shape' has no attribute '__init__'"):
        output(_SHAPES + "Shape.__init__(Shape())")
    assert (
        output(
            "class A:\n def __init__(self):\n  print('A')\nclass B(A):\n def __init__(self):\n"
            "  A.__init__(self)\nB()"
        )
        == "A"
    )


def test_attribute_hooks_are_ignored() -> None:
    source = """
class A:
    def __setattr__(self, name, value):
        print('set')
    def __del__(self):
        print('gone')
    def __getattr__(self, name):
        return name + '?'
a = A()
a.x = 1
print(a.x, a.y)
del a
"""
    assert output(source) == "1 y?"


@pytest.mark.parametrize(
    ("statement", "message"),
    [
        ("def f(): pass\nf.calls = 0", "'function' object has no attribute 'calls'"),
        ("import umath\numath.pi = 3", "'module' object has no attribute 'pi'"),
        ("import umath\numath.tau", "'module' object has no attribute 'tau'"),
        ("Exception().x = 1", "'Exception' object has no attribute 'x'"),
        ("int.x = 1", "'type' object has no attribute 'x'"),
        (("from pybricks.pupdevices import Motor\nfrom pybricks.parameters import Port\n"
         "motor = Motor(Port.A)\nmotor.angle = 0"),
         "'Motor' object has no attribute 'angle'"),
        ("from pybricks.tools import StopWatch\nwatch = StopWatch()\nwatch.lap = 1",
         "'StopWatch' object has no attribute 'lap'"),
        ("class A: pass\nA().__dict__", "'A' object has no attribute '__dict__'"),
    ],
)  # fmt: skip
def test_readonly_and_hidden_attributes(statement: str, message: str) -> None:
    with pytest.raises(AttributeError) as caught:
        output(statement)
    assert str(caught.value) == message


def test_classes_errors_modules_take_attributes() -> None:
    source = """
from pybricks.parameters import Color
class A: pass
class E(Exception): pass
a, e = A(), E()
a.x = A.y = e.z = 1
a.x += 4
a.x, a.q = a.x + 1, 2
Color.SKY = Color(200, 50, 100)
print(a.x, a.q, A.y, e.z, Color.SKY)
"""
    assert output(source) == "6 2 1 1 Color.SKY"


@pytest.mark.parametrize(
    "call",
    [
        "enumerate('ab', start=1)",
        "int('11', base=2)",
        "str(object=3)",
        "round(1.25, ndigits=1)",
        "sum([1], start=3)",
        "'a b'.split(sep=' ')",
        "zip('a', strict=True)",
        "(5).to_bytes(length=2, byteorder='little')",
        "int.from_bytes(b'ab', byteorder='big')",
        "range(stop=3)",
        "abs(x=1)",
    ],
)
def test_builtins_take_no_keywords(call: str) -> None:
    with pytest.raises(TypeError) as caught:
        output(call)
    assert str(caught.value) == "function doesn't take keyword arguments"


def test_builtins_with_keywords() -> None:
    source = "x = [3, -4]\nx.sort(key=abs, reverse=True)\nd = dict(a=1)\nd.update(b=2)\n"
    source += (
        "print(x, d, sorted(x, key=abs), max(x, key=abs), max([], default=7), "
        "'{a}'.format(a=1), sep='|', end='!')"
    )
    assert output(source) == "[-4, 3]|{'a': 1, 'b': 2}|[3, -4]|-4|7|1!"


def test_builtins_do_not_become_methods() -> None:
    source = "from pybricks.tools import wait\nclass A:\n    size, pause, show = abs, wait, print\n"
    source += "a = A()\na.pause(1)\na.show(a.size(-4), A.size(-5))"
    assert output(source) == "4 5"


def test_async_for_and_async_with() -> None:
    source = """
class Count:
    def __init__(self, n):
        self.n = n
    def __aiter__(self):
        return self
    async def __anext__(self):
        if self.n == 0:
            raise StopAsyncIteration
        self.n -= 1
        return self.n
class Guard:
    async def __aenter__(self):
        print('in')
        return 5
    async def __aexit__(self, kind, error, trace):
        print('out', kind)
async def main():
    async for i in Count(3):
        if i == 1:
            continue
        print(i)
    else:
        print('all')
    async for i in Count(2):
        async with Guard() as five:
            print(i, five)
            break
    else:
        print('never')
    async with Guard(), Guard():
        return 9
def run(task):
    try:
        task.send(None)
    except StopIteration as end:
        print(end.value)
run(main())
async def fails():
    async with Guard():
        raise ValueError
run(fails())
"""
    with pytest.raises(AttributeError, match="'ValueError' object has no attribute '__class__'"):
        output(source)
    assert (
        output(source.replace("run(fails())", ""))
        == "2\n0\nall\nin\n1 5\nout None\nin\nin\nout None\nout None\n9"
    )


@pytest.mark.parametrize(
    ("source", "expected"),
    [
        ("zip(), map(len, []), enumerate([]), reversed([]), iter([]), object()",
         "(<zip>, <map>, <enumerate>, <reversed>, <iterator>, <object>)"),
        ("type(iter('')), type({}.items())", "(<class 'iterator'>, <class 'dict_view'>)"),
        ("True & False, True | 2, {1} | {1}", "(0, 3, {1})"),
        ("int.from_bytes(b'\\x01\\x02'), int.from_bytes(b'\\x01' * 8, 'little'), int('1_000')",
         "(258, 16843009, 1000)"),
        ("b'%s|%d' % (b'ab', 5), '%d' % 3.9", "(b'ab|5', '3')"),
        ("dir(3)", "['from_bytes', 'to_bytes']"),
    ],
)  # fmt: skip
def test_values(source: str, expected: str) -> None:
    assert output(f"print(({source}))") == expected


@pytest.mark.parametrize(
    ("statement", "message"),
    [
        ("{1: 2} | {3: 4}", "unsupported types for __or__: 'dict', 'dict'"),
        ("x = [1, 2]\nx[0:1] = range(3)", "object 'range' isn't a tuple or list"),
        ("int.from_bytes(b'\\xff' * 4, 'little')", "small int overflow"),
        ("x = [1, 2]\ndel x[::2]", ""),
        ("x = [1, 2]\nx[::2] = [1]", ""),
        ("eval('1 +')", "invalid syntax"),
        ("'abc'['a']", "string indices must be integers, not str"),
    ],
)
def test_refusals(statement: str, message: str) -> None:
    source = (
        "try:\n"
        + "".join(f"    {line}\n" for line in statement.splitlines())
        + "except Exception as error:\n    print(error)"
    )
    assert output(source) == message


def test_objects_of_subclass_are_sortable() -> None:
    source = """
class Base:
    def __init__(self, n):
        self.n = n
    def __lt__(self, other):
        return self.n < other.n
class Child(Base):
    pass
print([one.n for one in sorted([Child(3), Base(2), Child(1), Base(4)])], Base(1) < Child(2), Child(1) < Base(2))
try:
    Base(1) > Base(2)
except TypeError as e:
    print(e)
"""  # noqa: E501
    assert output(source) == "[1, 2, 3, 4] True True\nunsupported types for __gt__: 'Base', 'Base'"


def test_exceptions_have_errno_and_value() -> None:
    """Firmware v4.1.0b2 prints this."""
    source = (
        "for error in (TypeError('a'), ValueError(), KeyError(7)):\n"
        "    print(error.errno, error.value)\n"
    )
    assert output(source) == "a a\nNone None\n7 7"
    assert (
        output("class E(Exception):\n    pass\ne = E('text', 2)\nprint(e.errno, e.value, e.args)")
        == "text text ('text', 2)"
    )


def test_firmware_classes_take_no_attributes() -> None:
    """Firmware v4.1.0b2 prints this."""
    source = "from pybricks.parameters import Port, Stop\n"
    source += (
        "for owner in (Port, Stop):\n    try:\n        owner.A = 4\n"
        "    except AttributeError as error:\n        print(error)\n"
    )
    assert output(source + "print(Port.A)") == "'type' object has no attribute 'A'\n" * 2 + "Port.A"
    assert output("class Shape:\n    pass\nShape.sides = 3\nprint(Shape.sides)") == "3"


def test_constant_folding_allows_large_intermediates() -> None:
    """Firmware v4.1.0b2 prints this."""
    source = (
        "print(2**30-1, (1 << 30) - 1, 2**10, 1024*1024*1023, -(2**30), 2**31 >> 2, 10**12 "
        "// 10**6, -7 // 2, -7 % 3)"
    )
    assert (
        output(source) == "1073741823 1073741823 1024 1072693248 -1073741824 536870912 1000000 -4 2"
    )


def test_nested_power_overflows() -> None:
    with pytest.raises(OverflowError):
        output("print((7**63)**63)")


def test_constant_division_by_zero_raises() -> None:
    source = "for text in ('1 // 0', '7 % 0'):\n    try:\n        exec(text)\n"
    source += "    except ZeroDivisionError as error:\n        print(error)"
    assert output(source) == "divide by zero\ndivide by zero"
    assert output("1 // 2\n10**99\nprint(1)") == "1"
    with pytest.raises(ZeroDivisionError):
        output("1 // 0")
