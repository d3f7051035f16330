"""Exceptions and their messages on a hub."""

import builtins
import dis
import inspect
import re
from collections.abc import Callable, Mapping, Sequence
from types import (
    BuiltinFunctionType,
    FrameType,
    FunctionType,
    MethodType,
    ModuleType,
    TracebackType,
)
from typing import Any, TypeGuard

from brickhub.errors import SceneError, WriteError
from brickhub.virtual import error_numbers

FIRMWARE = __name__.partition(".")[0] + "."
"""Beginning of the names of modules with native classes."""
# A list of texts would take a line for each.
EXCEPTIONS = """
    ArithmeticError AssertionError AttributeError BaseException EOFError Exception GeneratorExit
    ImportError IndentationError IndexError KeyError KeyboardInterrupt LookupError MemoryError
    NameError NotImplementedError OverflowError RuntimeError StopAsyncIteration StopIteration
    SyntaxError SystemExit TypeError UnicodeError ValueError ZeroDivisionError
""".split()  # noqa: SIM905
"""Exceptions common to hub and CPython; ``OSError`` is replaced."""
# The firmware raises only these few.
ERROR_NAMES = {
    error_numbers.EPERM: "EPERM",
    error_numbers.EIO: "EIO",
    error_numbers.EBUSY: "EBUSY",
    error_numbers.ENODEV: "ENODEV",
    error_numbers.EINVAL: "EINVAL",
    error_numbers.EOPNOTSUPP: "EOPNOTSUPP",
    error_numbers.EAGAIN: "EAGAIN",
    error_numbers.ETIMEDOUT: "ETIMEDOUT",
    error_numbers.ECANCELED: "ECANCELED",
}
CATCHABLE = (Exception, SystemExit, KeyboardInterrupt, GeneratorExit)
"""Errors that a program can catch, which do not include what stops it from outside."""
# A hub names an operation by its method.
_OPERATORS = {
    "+": "__add__",
    "-": "__sub__",
    "*": "__mul__",
    "/": "__truediv__",
    "//": "__floordiv__",
    "%": "__mod__",
    "** or pow()": "__pow__",
    "<<": "__lshift__",
    ">>": "__rshift__",
    "&": "__and__",
    "|": "__or__",
    "^": "__xor__",
    "@": "__matmul__",
    "<": "__lt__",
    "<=": "__le__",
    ">": "__gt__",
    ">=": "__ge__",
    # A hub falls back from an operation in place to the plain one, which its message then names.
    "+=": "__add__",
    "-=": "__sub__",
    "&=": "__and__",
    "|=": "__or__",
    "^=": "__xor__",
    "divmod()": "__divmod__",
}
_UNARY = {"-": "__neg__", "+": "__pos__", "~": "__invert__", "abs()": "__abs__"}
_CLASS_NAMES = (
    (r"\bbuiltin_function_or_method\b", "function"),
    (r"(?<!attribute ')\b\w+_iterator\b", "iterator"),
    (r"\b\w+_reverseiterator\b", "reversed"),
    (r"(?<=['\"])ellipsis(?=['\"])|(?<=convert )ellipsis(?= to)", ""),
    (r"^byte(?= indices)", "bytes"),
    # An attribute or argument of the program may have this name, and is left alone.
    (r"(?<!attribute )(?<!argument )(['\"])method(?=['\"])", r"\1bound_method"),
    (r"(?<=convert )method(?= to)", "bound_method"),
)
"""Names of classes that differ on a hub."""
_FUNCTION = re.compile(r"(?<!argument ')(?<=['\"])function(?=['\"])|(?<=convert )function(?= to)")
"""A function's class as an operand, for which a hub has several names."""
_COMPARISONS = ("<", "<=", ">", ">=")
_RAISE = dis.opmap["RAISE_VARARGS"]
_LANGUAGE = f"{__package__}."
_FUNCTIONS = (FunctionType, BuiltinFunctionType, MethodType)


class HostStop(BaseException):
    """Ends a program past its exception handlers and reaches the caller; derive the host's own ends
    from it. Whatever else is raised while a program runs is an error of the program, but for a
    failing scene and a film that cannot be written."""


class SwitchedOff(HostStop):
    """The hub was switched off."""


class ProgramInterrupt(KeyboardInterrupt):
    """The hub's KeyboardInterrupt, unrelated to this computer's keyboard."""


# A program and its traceback use this name.
ProgramInterrupt.__name__ = "KeyboardInterrupt"


def is_program_error(error: BaseException) -> bool:
    """Whether the program raised it, not an external stop, a failing scene or a film that cannot be
    written."""
    # This comes first, because it is a KeyboardInterrupt too.
    if isinstance(error, ProgramInterrupt):
        return True
    return not isinstance(error, HostStop | SceneError | WriteError | KeyboardInterrupt)


class HubOSError(OSError):
    """``OSError`` of a hub: ``errno`` is the first argument, there are no subclasses."""

    # CPython takes a third argument for a file's name, and leaves it out of `args`.
    def __init__(self, *args: object) -> None:
        self.args = args

    @property
    def errno(self) -> object:  # type: ignore[override]
        return self.args[0] if self.args else None


HubOSError.__name__ = HubOSError.__qualname__ = "OSError"


def _types(
    operator: str,
    left: str,
    right: str,
) -> str:
    """Refusal of two operands; a truth value refuses as the number that it is, but not on the right
    of a comparison."""
    left = "int" if left == "bool" else left
    right = "int" if right == "bool" and operator not in _COMPARISONS else right
    # An integer beside a float is refused before the plain operation is tried, and an operation in
    # place has no name then (`mp_binary_op`, `py/runtime.c`).
    is_in_place = operator in ("&=", "|=", "^=")
    is_nameless = is_in_place and left == "int" and right in ("float", "complex")
    name = "" if is_nameless else _OPERATORS.get(operator, operator)
    return f"unsupported types for {name}: '{left}', '{right}'"


def _argument_count(name: str, arguments: str) -> int:
    """Number of arguments, including ``self`` for methods."""
    return int(arguments) + (not hasattr(builtins, name))


# The first rule that fits counts. So special messages stand before general ones, such as those of
# the containers below before that of any function.
_RULES: tuple[tuple[type[BaseException], str, str | Callable[[re.Match[str]], str]], ...] = (
    (
        AttributeError,
        r"(?:partially initialized )?module '.*' has no attribute '(\w+)'.*",
        r"'module' object has no attribute '\1'",
    ),
    (
        TypeError,
        r"'\w+' is an invalid keyword argument for sort\(\)",
        "extra keyword arguments given",
    ),
    (
        TypeError,
        r".*takes no keyword arguments|.*positional-only arguments passed as keyword.*",
        "function doesn't take keyword arguments",
    ),
    (
        TypeError,
        (
            r".*(?:argument|Value) after \* must be an iterable, not (.*)|argument of type "
            r"'(.*)' is "
            r"not (?:a container or )?iterable"
        ),
        r"'\1\2' object isn't iterable",
    ),
    (
        TypeError,
        r"cannot unpack non-iterable (.*) object|can't extend bytearray with (.*)",
        r"'\1\2' object isn't iterable",
    ),
    (TypeError, r"must be real number, not (.*)", r"can't convert \1 to float"),
    # Programs mostly get this from `values[len(values) / 2 :]`.
    (TypeError, r"slice indices must be integers or None .*", "can't convert float to int"),
    (
        TypeError,
        r"complex\(\) (?:first )?argument must be a string or a number, not '?(\w*)'?",
        r"can't convert \1 to complex",
    ),
    (ValueError, r"complex\(\) arg is a malformed string", "invalid syntax for number"),
    (TypeError, r"cannot create ('.*' instances)", r"can't create \1"),
    (
        TypeError,
        r"object\(\) takes no arguments",
        "function takes 0 positional arguments but 1 were given",
    ),
    (
        TypeError,
        r"map\(\) must have at least two arguments\.",
        "function missing 1 required positional arguments",
    ),
    (
        TypeError,
        r"(?:encoding|errors) without a string argument|bytes\(\) takes at most 3 .*",
        "wrong number of arguments",
    ),
    (TypeError, r"type\(\) (takes 1 or 3 arguments)", r"type \1"),
    (
        TypeError,
        (
            r"\w+\(\) argument \d+ must be str, not (\w+)|ord\(\) expected string of length 1, but "
            r"(\w+) found"
        ),
        r"can't convert '\1\2' object to str implicitly",
    ),
    (
        TypeError,
        r"'in <string>' requires string as left operand, not (.*)",
        r"can't convert '\1' object to str implicitly",
    ),
    (ValueError, r"slice step cannot be zero", "slice step can't be zero"),
    (
        ValueError,
        r"Single '}' encountered in format string",
        "single '}' encountered in format string",
    ),
    (
        ValueError,
        (
            r"Single '{' encountered in format string|unmatched '{' in format spec|expected '}' "
            r"before end of string"
        ),
        "unmatched '{' in format",
    ),
    (ZeroDivisionError, r".*(zero|modulo|negative power|divmod).*", "divide by zero"),
    (UnboundLocalError, r".*", "local variable referenced before assignment"),
    (RuntimeError, r"No active exception to reraise", "no active exception to reraise"),
    (NameError, r"name '(.*)' is not defined", r"name '\1' isn't defined"),
    (NameError, r"cannot access free variable.*", "local variable referenced before assignment"),
    (
        TypeError,
        r"unsupported operand type\(s\) for (.*): '(.*)' and '(.*)'",
        lambda m: _types(m[1], m[2], m[3]),
    ),
    (
        TypeError,
        r"'(.*)' not supported between instances of '(.*)' and '(.*)'",
        lambda m: _types(m[1], m[2], m[3]),
    ),
    (
        TypeError,
        r"can only concatenate (.*) \(not \"(.*)\"\) to .*",
        lambda m: _types("+", m[1], m[2]),
    ),
    (TypeError, r"can't concat (.*) to bytes", lambda m: _types("+", "bytes", m[1])),
    (
        TypeError,
        r"bad operand type for (?:unary )?(.*): '(.*)'",
        lambda m: f"unsupported type for {_UNARY[m[1]]}: '{m[2]}'",
    ),
    (
        TypeError,
        r"(.*) indices must be integers or slices, not (.*)",
        r"\1 indices must be integers, not \2",
    ),
    (
        TypeError,
        r"string indices must be integers, not '(.*)'",
        r"string indices must be integers, not \1",
    ),
    (TypeError, r"cannot convert ('.*' object) to bytes(?:array)?", r"\1 isn't iterable"),
    (TypeError, r"'(.*)' object is not reversible", r"object of type '\1' has no len()"),
    (TypeError, r"type '.*' is not subscriptable", "'type' object isn't subscriptable"),
    (
        TypeError,
        r"('.*' object) is not (callable|iterable|subscriptable|an iterator)",
        r"\1 isn't \2",
    ),
    (TypeError, r"('.*' object) does(?: not|n't) support item (.*)", r"\1 doesn't support item \2"),
    (
        TypeError,
        r"(?:cannot use .* \()?unhashable type: '(.*?)'\)?",
        r"unsupported type for __hash__: '\1'",
    ),
    (
        IndexError,
        r"(list) assignment index out of range|pop index out of range",
        "list index out of range",
    ),
    (IndexError, r"range object index out of range", "range index out of range"),
    (IndexError, r"Matrix index out of range", "index out of range"),
    (IndexError, r"index out of bounds on dimension 1", "memoryview index out of range"),
    (
        TypeError,
        r"cannot modify read-only memory",
        "'memoryview' object doesn't support item assignment",
    ),
    (TypeError, r"cannot delete memory", "'memoryview' object doesn't support item deletion"),
    (
        TypeError,
        (
            r"memoryview: a bytes-like object is required, .*|can't concat .* to "
            r"bytearray|decoding "
            r"to str: .*"
        ),
        "object with buffer protocol required",
    ),
    (IndexError, r"index out of range", "bytes index out of range"),
    (IndexError, r"Replacement index \d+ out of range.*", "tuple index out of range"),
    (
        ValueError,
        r"not enough values to unpack \(expected .*, got (.*)\)",
        r"need more than \1 values to unpack",
    ),
    (
        ValueError,
        r"list.remove\(x\): x not in list|.* is not in list|tuple.index.*",
        "object not in sequence",
    ),
    (
        ValueError,
        r"(?:max|min)\(\) (?:iterable argument is empty|arg is an empty sequence)",
        "arg is an empty sequence",
    ),
    (ValueError, r"bytes? must be in range\(0, 256\)", "bytes value out of range"),
    (ValueError, r"range\(\) arg 3 must not be zero", "zero step"),
    (ValueError, r"negative count", ""),
    (
        TypeError,
        r"is(?:instance|subclass)\(\) arg 2 must be .*",
        "issubclass() arg 2 must be a class or a tuple of classes",
    ),
    (
        TypeError,
        r"\w+(?: expected|\(\) takes) at least (\d+) arguments?(?:, got | \()(\d+)(?: given\))?",
        lambda m: f"function missing {int(m[1]) - int(m[2])} required positional arguments",
    ),
    (
        TypeError,
        (
            r"(?!function )(\w+)(?: expected|\(\) takes) at most (\d+) arguments?(?:, got | "
            r"\()(\d+)(?: given\))?"
        ),
        lambda m: (
            f"function expected at most {_argument_count(m[1], m[2])} arguments, got "
            f"{_argument_count(m[1], m[3])}"
        ),
    ),
    (
        TypeError,
        r"(\w+) expected (\d+) arguments?, got (\d+)",
        lambda m: (
            f"function takes {_argument_count(m[1], m[2])} positional arguments but "
            f"{_argument_count(m[1], m[3])} were given"
        ),
    ),
    (
        TypeError,
        (
            r"Hub(?:Dict|Set|Bytearray)\.\w+\(\) takes from \d+ to (\d+) positional arguments but "
            r"(\d+) were given"
        ),
        r"function expected at most \1 arguments, got \2",
    ),
    (
        TypeError,
        (
            r"Hub(?:Dict|Set|Bytearray)\.\w+\(\) takes (\d+) positional arguments? but (\d+) "
            r"were given"
        ),
        r"function takes \1 positional arguments but \2 were given",
    ),
    (
        TypeError,
        r"HubDict\.(?:pop|setdefault|fromkeys)\(\) missing 1 required positional argument: .*",
        "function missing 1 required positional arguments",
    ),
    (
        TypeError,
        r"Hub(?:Set|Bytearray)\.\w+\(\) missing 1 required positional argument: .*",
        "function takes 2 positional arguments but 1 were given",
    ),
    (
        TypeError,
        r"sequence item \d+: expected .*",
        "join expects a list of str/bytes objects consistent with self object",
    ),
    (
        TypeError,
        (
            r"'(.*)' object cannot be interpreted as an integer|argument should be integer "
            r"or None, "
            r"not '(.*)'"
        ),
        r"can't convert \1\2 to int",
    ),
    (
        TypeError,
        (
            r"a(?: bytes-like object is required|rgument should be integer or bytes-like object), "
            r"not 'str'"
        ),
        "can't convert 'str' object to bytes implicitly",
    ),
    (
        TypeError,
        (
            r"a(?: bytes-like object is required|rgument should be integer or bytes-like object), "
            r"not '(.*)'"
        ),
        r"can't convert '\1' object to str implicitly",
    ),
    (
        TypeError,
        (
            r"(?:\w+ first arg )?must be (?:str|bytes)(?: or None| or a tuple of (?:str|bytes))?, "
            r"not (.*)"
        ),
        r"can't convert '\1' object to str implicitly",
    ),
    (
        TypeError,
        r"(\w+)\(\) takes exactly one argument \((\d+) given\)",
        r"function takes 1 positional arguments but \2 were given",
    ),
    (
        TypeError,
        r"\w+\.\w+\(\) takes exactly one argument \((\d+) given\)",
        lambda m: f"function takes 2 positional arguments but {int(m[1]) + 1} were given",
    ),
    (
        TypeError,
        r"\w+\.\w+\(\) takes no arguments \((\d+) given\)",
        lambda m: f"function takes 1 positional arguments but {int(m[1]) + 1} were given",
    ),
    (ImportError, r"cannot import name '(.*?)' .*", r"can't import name \1"),
    (RecursionError, r".*", "maximum recursion depth exceeded"),
)
"""Classes of errors, the whole message of CPython, and the hub's, a template or a function of the
match."""


def reword(error: BaseException, namespaces: Sequence[Mapping[str, object]]) -> BaseException:
    """Replace CPython's message by the hub's; ``namespaces`` are the globals of the program's
    modules. Returns the error."""
    if _is_raised_by_program(error):
        return error
    # A hub raises a UnicodeError without a message.
    if isinstance(error, UnicodeError):
        error.args = ()
    has_message = len(error.args) == 1 and isinstance(error.args[0], str)
    if not has_message or not isinstance(error, Exception):
        return error
    message = error.args[0]
    # Names of classes are replaced first, because the rules below are for the rest of a message.
    if isinstance(error, TypeError):
        message = _FUNCTION.sub(lambda match: _operand_name(error), message)
    if isinstance(error, TypeError | AttributeError):
        for pattern, name in _CLASS_NAMES:
            message = re.sub(pattern, name, message)
    reworded = _by_rule(error, message)
    if reworded is not None:
        error.args = (reworded,) if reworded else ()
        # An ImportError shows this attribute and not its argument.
        if isinstance(error, ImportError):
            error.msg = reworded
        return error
    if isinstance(error, TypeError) and "()" in message:
        message = _call_message(message, namespaces, error)
    if isinstance(error, AttributeError) and isinstance(error.obj, _FUNCTIONS):
        name = f"'{function_name(error.obj)}'"
        message = re.sub(r"^'\w+'(?= object has no attribute)", name, message)
    if message != error.args[0]:
        error.args = (message,)
    return error


def _is_raised_by_program(error: BaseException) -> bool:
    """Whether a ``raise`` of the program made it, with the program's own message."""
    traces = _traces(error)
    if not traces:
        return False
    trace = traces[-1]
    if "@n" not in trace.tb_frame.f_builtins:
        return False
    code = trace.tb_frame.f_code.co_code
    operation = code[trace.tb_lasti]
    arguments = code[trace.tb_lasti + 1]
    # A bare `raise` raises an error again and has no argument.
    return operation == _RAISE and arguments > 0


def _by_rule(error: BaseException, message: str) -> str | None:
    """The hub's message by the first rule that fits; ``None`` if none does."""
    for kind, pattern, text in _RULES:
        if not isinstance(error, kind):
            continue
        match = re.fullmatch(pattern, message, re.DOTALL)
        if match is not None:
            return match.expand(text) if isinstance(text, str) else text(match)
    return None


def function_name(function: object) -> str:
    """Name of a function's class on a hub."""
    if not isinstance(function, FunctionType):
        is_bound = not isinstance(getattr(function, "__self__", None), ModuleType)
        return "bound_method" if is_bound else "function"
    if function.__closure__ and is_own(function):
        return "closure"
    # A method stands in a class, which may itself be inside of a function.
    local_name = function.__qualname__.rsplit("<locals>.", maxsplit=1)[-1]
    if "." in local_name:
        return "bound_method"
    is_generator = function.__code__.co_flags & inspect.CO_GENERATOR
    return "generator" if is_generator else "function"


def _traces(error: BaseException) -> list[TracebackType]:
    """Entries of the traceback, the innermost last."""
    traces = []
    trace = error.__traceback__
    while trace is not None:
        traces.append(trace)
        trace = trace.tb_next
    return traces


def _operand_name(error: BaseException) -> str:
    """Name of the class of the only function of the program in the line that failed, if it has
    one."""
    names = {"function"}
    for trace in _traces(error):
        frame = trace.tb_frame
        if "@n" not in frame.f_builtins:
            continue
        # These are the names that the line had loaded before it failed, by its byte code.
        values = {**frame.f_globals, **frame.f_locals}
        names = set()
        for step in dis.get_instructions(frame.f_code):
            is_in_line = step.positions and step.positions.lineno == trace.tb_lineno
            if step.offset > trace.tb_lasti or not is_in_line:
                continue
            value = values.get(step.argval)
            if is_own(value):
                names.add(function_name(value))
    # If there are several, nobody knows which one failed.
    return names.pop() if len(names) == 1 else "function"


def local_values(frame: FrameType) -> list[Any]:
    """Values of the local variables of a function; none of a module, which has globals."""
    is_function = frame.f_code.co_flags & inspect.CO_OPTIMIZED
    return [*frame.f_locals.values()] if is_function else []


def _call_message(
    message: str,
    namespaces: Sequence[Mapping[str, object]],
    error: BaseException,
) -> str:
    """Message for a call with wrong arguments, which differs between program and firmware
    functions."""
    match = re.fullmatch(r"(.*?)\(\) (.*?)(?:\. Did you mean '\w+'\?)?", message)
    if match is None:
        return message
    name = match[1]
    problem = match[2]
    traces = _traces(error)
    function = _function_of_program(name, namespaces, traces)
    multiple = re.fullmatch(r"got multiple values for (?:keyword )?argument '(.*)'", problem)
    if multiple is not None:
        return f"function got multiple values for argument '{multiple[1]}'"
    if function is not None:
        return _own_call_message(
            message,
            problem,
            function,
            traces,
        )

    given = re.match(r"takes (\d+) positional .* but (\d+) w", problem)
    if name.endswith("<lambda>") and given is not None:
        # Lambdas of the modules here stand for functions of the firmware.
        label = "function" if "_module." in name else "<lambda>()"
        return f"{label} takes {given[1]} positional arguments but {given[2]} were given"
    of_language = None
    if traces:
        of_language = _language_call_message(name, problem, traces[-1].tb_frame)
    if of_language:
        return of_language
    return _builtin_call_message(problem, name.startswith("tools_module")) or message


def _function_of_program(
    name: str,
    namespaces: Sequence[Mapping[str, object]],
    traces: Sequence[TracebackType],
) -> FunctionType | None:
    """The program's function that CPython's message names, or ``None``."""
    for names in namespaces:
        function = _find(name, names)
        if function is not None:
            return function
    # A lambda or an inner function has no name in a namespace, so it is looked for among the values
    # of all variables.
    values = [value for trace in traces for value in local_values(trace.tb_frame)]
    for names in namespaces:
        values += names.values()
    for value in values:
        if is_own(value) and value.__qualname__ == name:
            return value
    return None


def _own_call_message(
    message: str,
    problem: str,
    function: FunctionType,
    traces: Sequence[TracebackType],
) -> str:
    """Message for a call of a function of the program."""
    keyword = re.fullmatch(r"got an unexpected keyword argument '(.*)'", problem)
    if keyword is not None:
        return f"unexpected keyword argument '{keyword[1]}'"
    code = function.__code__
    # With a keyword, in the call or in the function, the firmware looks for each argument
    # separately.
    checks_each = bool(function.__kwdefaults__)
    for trace in traces[-1:]:
        instructions = dis.get_instructions(trace.tb_frame.f_code)
        steps = [step.opname for step in instructions if step.offset <= trace.tb_lasti]
        checks_each |= any("KW" in name for name in steps[-3:])
    missing = re.match(r"missing \d+ required keyword-only arguments?: '(\w+)'", problem)
    if missing is not None:
        if checks_each:
            return f"function missing required keyword argument '{missing[1]}'"
        return "function missing keyword-only argument"

    # On a hub, the first arguments of an inner function are what it keeps of the function around
    # it.
    cells = len(code.co_freevars)
    total = code.co_argcount + cells
    required = total - len(function.__defaults__ or ())
    given = re.search(r"but (\d+) (?:positional arguments? .*)?(?:was|were) given", problem)
    if given is not None:
        count = int(given[1]) + cells
        return f"{function.__name__}() takes {total} positional arguments but {count} were given"
    missing = re.match(r"missing (\d+) required positional arguments?: .*?'(\w+)'$", problem)
    if missing is None:
        return message
    if checks_each:
        index = code.co_varnames.index(missing[2]) + cells
        return f"function missing required positional argument #{index}"
    count = required - int(missing[1])
    return f"{function.__name__}() takes {required} positional arguments but {count} were given"


def _language_call_message(
    name: str,
    problem: str,
    frame: FrameType,
) -> str | None:
    """Message for a wrong number of arguments of a builtin or of a module of the language, which
    are not named."""
    # A program can call its variables, the builtins, and what is in its modules.
    values = [*frame.f_globals.values(), *frame.f_locals.values()]
    modules = [value for value in values if isinstance(value, ModuleType)]
    values += frame.f_builtins.values()
    for module in modules:
        values += vars(module).values()
    function: Any = None
    for value in values:
        if getattr(value, "__qualname__", None) == name:
            function = value
            break
    is_method = isinstance(function, MethodType)
    if is_method:
        function = function.__func__
    numbers = [int(number) for number in re.findall(r"\d+", problem)]
    is_of_language = isinstance(function, FunctionType) and function.__module__.startswith(
        _LANGUAGE
    )
    if not is_of_language or not numbers:
        return None
    # `self` does not count, because the program does not write it.
    total = function.__code__.co_argcount - is_method
    required = total - len(function.__defaults__ or ())
    # CPython says either how many arguments are missing or how many were given.
    is_missing = problem.startswith("missing")
    given = required - numbers[0] if is_missing else numbers[-1] - is_method
    if required == total and not function.__code__.co_flags & inspect.CO_VARARGS:
        return f"function takes {total} positional arguments but {given} were given"
    if given < required:
        return f"function missing {required - given} required positional arguments"
    return f"function expected at most {total} arguments, got {given}"


def _builtin_call_message(problem: str, is_module_function: bool) -> str | None:
    """``is_module_function``: a module's function has named arguments in the firmware."""
    missing = re.match(r"missing \d+ required positional arguments?: '(\w+)'", problem)
    if missing is not None:
        return f"'{missing[1]}' argument required"
    if "unexpected keyword" in problem or "takes no keyword" in problem:
        return "extra keyword arguments given"
    given = re.fullmatch(
        r"takes (?:from \d+ to )?(\d+) positional arguments? but (\d+) (?:was|were) given", problem
    )
    if given is None:
        return None
    # A method without arguments has only the object itself.
    takes_itself_only = given[1] == "1" and "from" not in problem
    if takes_itself_only and not is_module_function:
        return f"function takes 1 positional arguments but {given[2]} were given"
    return "extra positional arguments given"


def _find(qualified_name: str, names: Mapping[str, object]) -> FunctionType | None:
    """The program's function with a qualified name."""
    # Names in a namespace do not tell the functions around, so these are cut off.
    first, *others = qualified_name.rsplit(".<locals>.", maxsplit=1)[-1].split(".")
    value = names.get(first)
    for part in others:
        value = getattr(value, part, None)
    if isinstance(value, type):
        value = value.__dict__.get("__init__")
    value = getattr(value, "__func__", value)
    # Another value may have the same last name.
    if is_own(value) and value.__qualname__.startswith(qualified_name):
        return value
    return None


def is_own(value: object) -> TypeGuard[FunctionType]:
    """Whether a value is a function of the program."""
    return isinstance(value, FunctionType) and "@n" in value.__globals__.get("__builtins__", ())


def is_native(kind: type) -> bool:
    """Whether a class is not a program's."""
    return kind.__module__.startswith((FIRMWARE, "builtins", "_io"))


def class_name(kind: type) -> str:
    """Name of an exception's class, or of its nearest base class on a hub."""
    for ancestor in kind.__mro__:
        name = ancestor.__name__
        is_known = name in EXCEPTIONS or name == "OSError"
        # A hub lacks many of CPython's own exceptions, such as UnboundLocalError.
        is_of_cpython = getattr(builtins, name, None) is ancestor
        if is_known or not is_of_cpython:
            return name
    return kind.__name__
