"""What the hub's compiler does before a program runs: constants, and where `:=` stores."""

from __future__ import annotations

import ast

import pytest
from hub_programs import output

from brickhub.virtual.micropython.compiler import compile_source, compile_string
from brickhub.virtual.micropython.transform import fold


def folded(expression: str) -> int | None:
    return fold(ast.parse(expression, mode="eval").body)


@pytest.mark.parametrize(
    ("expression", "value"),
    [
        ("5", 5),
        ("-5", -5),
        ("+5", 5),
        ("~5", -6),
        ("--5", 5),
        ("2 + 3", 5),
        ("2 - 3", -1),
        ("2 * 3", 6),
        ("7 // 2", 3),
        ("-7 // 2", -4),
        ("-7 % 3", 2),
        ("0 // 5", 0),
        ("2 ** 10", 1024),
        ("2 ** 0", 1),
        ("0 ** 0", 1),
        ("1 << 4", 16),
        ("1 << 0", 1),
        ("17 >> 2", 4),
        ("17 >> 0", 17),
        ("6 | 3", 7),
        ("6 & 3", 2),
        ("6 ^ 3", 5),
        ("(1 << 40) - (1 << 40) + 3", 3),
        ("2 ** 2048", 2**2048),
        ("1 << 4096", 1 << 4096),
        ("-(2 ** 3) * 2", -16),
    ],
)
def test_operations_on_constants_are_computed_by_the_compiler(expression: str, value: int) -> None:
    """With integers of any size, as it runs on a computer."""
    assert folded(expression) == value


@pytest.mark.parametrize(
    "expression",
    [
        "7 / 2",
        "7 // 0",
        "7 % 0",
        "2 ** -1",
        "1 << -1",
        "1 >> -1",
        "2 ** 2049",
        "1 << 4097",
        "True",
        "True + 1",
        "1 + True",
        "-True",
        "1.5",
        "1 + 1.5",
        "1.5 + 1",
        "'a'",
        "not 5",
        "a",
        "a + 1",
        "1 + a",
        "-a",
        "f(1)",
        "1 < 2",
    ],
)
def test_other_operations_are_left_to_the_hub(expression: str) -> None:
    assert folded(expression) is None


@pytest.mark.parametrize(
    ("source", "printed"),
    [
        ("print(2 ** 40 - 2 ** 40 + 5)", "5"),
        ("print(0x3FFFFFFF, -0x40000000)", "1073741823 -1073741824"),
        ("2 ** 5000\nprint('on')", "OverflowError"),
        ("2 ** 100\nprint('on')", "on"),
    ],
)
def test_constants_in_programs(source: str, printed: str) -> None:
    if printed == "OverflowError":
        with pytest.raises(OverflowError):
            output(source)
        return
    assert output(source) == printed


# ---- assignment expressions in comprehensions


@pytest.mark.parametrize(
    ("source", "printed"),
    [
        ("[x := i for i in range(3)]\nprint(x)", "2"),
        ("{(x := i) for i in range(3)}\nprint(x)", "2"),
        ("{(x := i): 5 for i in range(3)}\nprint(x)", "2"),
        ("any((x := i) > 5 for i in range(3))\nprint(x)", "2"),
        ("class A:\n    y = 5\n    if (x := 7): pass\nprint(A.x)", "7"),
        ("if (x := 5) > 3:\n    print(x)", "5"),
    ],
)
def test_assignments_outside_of_functions_are_kept(source: str, printed: str) -> None:
    assert output(source) == printed


EACH = "[x := i for i in range(3)]"
SUM = "[(x := x + i) for i in range(3)]"


@pytest.mark.parametrize(
    ("parameters", "before", "comprehension", "returned"),
    [
        # It does not read the variable.
        ("", "x = 9", EACH, "9"),
        ("x=9", "pass", EACH, "9"),
        ("", "x = 9", "any((x := i) > 5 for i in range(3))", "9"),
        # It reads the variable, and there is no other one.
        ("", "x = 9", SUM, "12"),
        ("x=9", "pass", SUM, "12"),
        # It reads the variable, but not all others of the function.
        ("", "x = 9; y = 1", SUM, "9"),
        ("y=1", "x = 9", SUM, "9"),
        ("*y", "x = 9", SUM, "9"),
        ("", "x = 9; import gc", SUM, "9"),
        ("", "x = 9; import gc as y", SUM, "9"),
        ("", "x = 9\ndef g(): pass", SUM, "9"),
        ("", "x = 9\nclass G: pass", SUM, "9"),
        ("", "x = 9\nfor y in (1,): pass", SUM, "9"),
        ("", "x = 9\ntry: 1 / 0\nexcept ZeroDivisionError as y: pass", SUM, "9"),
        # It reads all of them.
        ("", "x = 9; y = 1", "[(x := x + y) for i in range(3)]", "12"),
        ("y=1", "x = 9", "[(x := x + y) for i in range(3)]", "12"),
        # What a function in it assigns is none of its variables.
        ("", "x = 9\n(lambda z: z)(1)", SUM, "12"),
    ],
)
def test_a_function_mostly_loses_what_a_comprehension_assigns(
    parameters: str, before: str, comprehension: str, returned: str
) -> None:
    """A hub keeps it where the comprehension reads the variable and all others of the function, as
    both then have the same numbers."""
    lines = [*before.split("\n"), comprehension, "return x"]
    body = "".join(f"    {line}\n" for line in lines)
    assert output(f"def f({parameters}):\n{body}print(f())") == returned


def test_declared_names_are_kept() -> None:
    source = f"""
x = 9
def of_module():
    global x
    {EACH}
    return x
def of_function():
    x = 9
    def inner():
        nonlocal x
        {EACH}
    inner()
    return x
print(of_module(), of_function(), x)
"""
    assert output(source) == "2 2 2"


def test_a_function_inside_of_another_one_always_loses_it() -> None:
    source = f"""
def outer():
    def inner():
        x = 9
        {SUM}
        return x
    return inner()
print(outer())
"""
    assert output(source) == "9"


def test_outside_of_a_comprehension_nothing_is_lost() -> None:
    source = """
def f():
    x = 9
    return (x := 5) + x, (lambda: (x := 3))(), x
print(f())
"""
    assert output(source) == "(10, 3, 5)"


# ---- text that a program compiles


@pytest.mark.parametrize(
    ("source", "mode", "error", "line", "says"),
    [
        ("x = 012", "exec", SyntaxError, 1, "invalid syntax for integer with base 0: '012'"),
        ("x = 0_12", "exec", SyntaxError, 1, "invalid syntax for integer with base 0: '012'"),
        (" 5", "eval", IndentationError, 1, "unexpected indent"),
        ("\t5", "eval", IndentationError, 1, "unexpected indent"),
        ("\n5", "eval", SyntaxError, 1, "invalid syntax"),
        ("\r5", "eval", SyntaxError, 1, "invalid syntax"),
        ("x = 1\ny = f'{x}'", "exec", SyntaxError, 2, "invalid syntax"),
        ("f'{5}'", "eval", SyntaxError, 1, "invalid syntax"),
        ("1 +", "eval", SyntaxError, 1, "invalid syntax"),
        ("x = 1\nx = )", "exec", SyntaxError, 2, "invalid syntax"),
    ],
)
def test_compiler_on_the_hub_is_stricter(
    source: str, mode: str, error: type[SyntaxError], line: int, says: str
) -> None:
    with pytest.raises(error) as caught:
        compile_string(source, mode)
    assert type(caught.value) is error
    assert (caught.value.lineno, caught.value.args[0]) == (line, says)


@pytest.mark.parametrize("number", ["1073741824", "-1073741824", "1073741823 + 1073741824"])
def test_compiler_on_the_hub_reads_the_digits_before_the_sign(number: str) -> None:
    with pytest.raises(OverflowError, match="long int not supported in this build"):
        compile_string(f"x = {number}")


@pytest.mark.parametrize(
    ("source", "value"),
    [
        ("5 ", 5),
        ("5\n\n", 5),
        ("0", 0),
        ("00", 0),
        ("0.5", 0.5),
        ("10.0625", 10.0625),
        ("1.25", 1.25),
        ("x012", 7),
        ("'012'", "012"),
        ("1073741823", 1073741823),
        ("-1073741823", -1073741823),
        ("'f{5}'", "f{5}"),
    ],
)
def test_what_the_compiler_on_the_hub_accepts(source: str, value: object) -> None:
    assert eval(compile_string(source, "eval"), {"x012": 7}) == value  # noqa: S307


@pytest.mark.parametrize(
    "constants",
    [
        "1073741823",
        "-1073741823",
        "(1, 'a', b'b', 1.5, None, True, (2, 3))",
        "'x' * 3, 'y' + 'z'",
        "{'" + "a" * 200 + "': 5}",
        "('" + "b" * 70 + "', 123456789, 2.5)",
    ],
)
def test_constants_of_all_kinds_are_compiled(constants: str) -> None:
    """The compiled program is read for integers that are too large."""
    compile_source(f"x = {constants}", "main.py")
    with pytest.raises(OverflowError, match="long int not supported in this build"):
        compile_source(f"x = {constants}\ny = (0, {constants}, 1073741824)", "main.py")
