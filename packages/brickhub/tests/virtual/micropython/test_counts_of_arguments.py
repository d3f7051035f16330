"""Calls with too few or too many arguments: each function of the language refuses them in the words
of ``mp_arg_check_num`` (``py/argcheck.c``), by the least and the largest number that it takes."""

from __future__ import annotations

import pytest
from hub_programs import output

FUNCTIONS = {
    "abs": (1, 1),
    "all": (1, 1),
    "any": (1, 1),
    "bin": (1, 1),
    "callable": (1, 1),
    "chr": (1, 1),
    "dir": (0, 1),
    "divmod": (2, 2),
    "eval": (1, 3),
    "exec": (1, 3),
    "getattr": (2, 3),
    "globals": (0, 0),
    "hasattr": (2, 2),
    "hash": (1, 1),
    "hex": (1, 1),
    "id": (1, 1),
    "isinstance": (2, 2),
    "issubclass": (2, 2),
    "iter": (1, 1),
    "len": (1, 1),
    "locals": (0, 0),
    "next": (1, 1),
    "oct": (1, 1),
    "ord": (1, 1),
    "pow": (2, 3),
    "repr": (1, 1),
    "round": (1, 2),
    "setattr": (3, 3),
    "sum": (1, 2),
    "umath.sqrt": (1, 1),
    "umath.atan2": (2, 2),
    "umath.pow": (2, 2),
    "umath.log": (1, 2),
    "umath.ldexp": (2, 2),
    "umath.modf": (1, 1),
    "umath.isnan": (1, 1),
    "umath.floor": (1, 1),
    "umath.degrees": (1, 1),
    "urandom.getrandbits": (1, 1),
    "urandom.randint": (2, 2),
    "urandom.randrange": (1, 3),
    "urandom.uniform": (2, 2),
    "urandom.choice": (1, 1),
    "urandom.seed": (0, 1),
    "ustruct.calcsize": (1, 1),
    "ustruct.unpack": (2, 3),
    "ustruct.unpack_from": (2, 3),
    "ujson.loads": (1, 1),
    "ujson.load": (1, 1),
}
"""Least and largest number of arguments."""
METHODS = {
    "[1].append": (2, 2),
    "[1].clear": (1, 1),
    "[1].copy": (1, 1),
    "[1].count": (2, 2),
    "[1].extend": (2, 2),
    "[1].index": (2, 4),
    "[1].insert": (3, 3),
    "[1].pop": (1, 2),
    "[1].remove": (2, 2),
    "[1].reverse": (1, 1),
    "(1,).count": (2, 2),
    "{1: 2}.clear": (1, 1),
    "{1: 2}.get": (2, 3),
    "{1: 2}.items": (1, 1),
    "{1: 2}.pop": (2, 3),
    "{1: 2}.popitem": (1, 1),
    "{1: 2}.setdefault": (2, 3),
    "{1}.add": (2, 2),
    "{1}.discard": (2, 2),
    "{1}.union": (2, 2),
    "'a'.count": (2, 4),
    "'a'.find": (2, 4),
    "'a'.index": (2, 4),
    "'a'.isdigit": (1, 1),
    "'a'.join": (2, 2),
    "'a'.lower": (1, 1),
    "'a'.replace": (3, 4),
    "'a'.strip": (1, 2),
    "bytearray(1).append": (2, 2),
}
"""The same of methods, of which the object itself is the first argument."""


def refusal(least: int, most: int, given: int) -> str:
    if least == most:
        return f"function takes {least} positional arguments but {given} were given"
    if given < least:
        return f"function missing {least - given} required positional arguments"
    return f"function expected at most {most} arguments, got {given}"


def told(call: str) -> str:
    source = f"import umath, urandom, ustruct, ujson\ntry:\n    print('answered', {call})\n"
    return output(f"{source}except TypeError as error:\n    print(error)")


def wrong_counts(least: int, most: int, first: int) -> list[int]:
    return [*range(first, least), most + 1, most + 2]


@pytest.mark.parametrize("name", FUNCTIONS)
def test_functions(name: str) -> None:
    least, most = FUNCTIONS[name]
    for count in wrong_counts(least, most, 0):
        arguments = ", ".join(["1"] * count)
        assert told(f"{name}({arguments})") == refusal(least, most, count)


@pytest.mark.parametrize("name", METHODS)
def test_methods(name: str) -> None:
    least, most = METHODS[name]
    for count in wrong_counts(least, most, 1):
        arguments = ", ".join(["1"] * (count - 1))
        assert told(f"{name}({arguments})") == refusal(least, most, count)
