"""Memory of a hub: whether a program's objects fit into its heap, and how deep its functions can
call each other.

Sizes of objects are those of MicroPython 1.26 on 32 bits (``py/gc.c``, ``py/obj*.c``), without the
program itself and fragmentation: a program that runs out of memory here does so on a hub, a little
earlier. The stack goes by the firmware (Pybricks 4.1: ``_common/micropython.c``, ``py/objfun.c``).
"""

import gc
import itertools
import sys
from collections.abc import Callable, Iterable
from contextvars import ContextVar
from types import CellType, CoroutineType, FrameType, FunctionType, GeneratorType, MethodType
from typing import Any

from brickhub.robot import AnyHub, HubKind, HubModel
from brickhub.virtual.micropython.exceptions import FIRMWARE, is_native, is_own, local_values

MEMORY_BYTES: ContextVar[int] = ContextVar("memory", default=HubKind.PRIME.model.memory_bytes)
"""Memory of the hub whose program runs in this thread."""
BLOCK_BYTES = 16
"""Bytes of a block of MicroPython's heap."""
_REFERENCE_BYTES = 4
_PAIR_BYTES = 2 * _REFERENCE_BYTES
"""Slot of a dict: key and value."""
_TABLES_SHARE = 12 / 524
"""Share of the garbage collector's tables: 1 byte for each 4 blocks, 1 for each 8
(``gc_setup_area``)."""
_OBJECT = 2 * BLOCK_BYTES
"""Object of the firmware, such as a motor; an estimate."""
_LONG_BYTES = 256
"""Least size of an object for which a hub that is full has memory for the message."""
_LONGEST_INTERVAL = 1024
"""Branches between two checks of a program that does not grow."""
_KEPT_BYTES = 1024 + 250
"""Kept free for what interrupts a program; before its first line, and to look at the stack."""
_MOST_PLAYED = 600
"""Largest number of nested calls that is played, as this computer's Python has a limit too."""
_VARIABLES_BYTES = 40
"""Variables of a small function. They take 24 to 64 bytes; those that need more are on the heap."""


def check_allocation(size_bytes: int) -> None:
    """Raise MemoryError for an object that the hub has no memory for."""
    if size_bytes > MEMORY_BYTES.get():
        raise MemoryError(f"memory allocation failed, allocating {size_bytes} bytes")


def items_of(values: Iterable[Any], *, item_bytes: int = _REFERENCE_BYTES) -> list[Any]:
    """A list of an iterable's items. Raises MemoryError if there are more than fit on the hub."""
    items: list[Any] = []
    extend(items, values, item_bytes)
    return items


def extend(
    items: list[Any],
    values: Iterable[Any],
    item_bytes: int = _REFERENCE_BYTES,
) -> None:
    """Append an iterable's items one by one. Raises MemoryError if there are more than fit on the
    hub."""
    # One more than fits is taken, so that a list that is too long shows, and an endless iterable
    # ends.
    items.extend(itertools.islice(values, MEMORY_BYTES.get() // item_bytes + 1))
    check_allocation(item_bytes * len(items))


class Heap:
    """Heap of one kind of hub, for the program that runs next in this thread.

    Attributes:
        size_bytes: for objects.
        namespaces: globals of the program and of its modules.
    """

    def __init__(self, hub: HubModel) -> None:
        MEMORY_BYTES.set(hub.memory_bytes)
        self.size_bytes = int((hub.memory_bytes - hub.stored_bytes) * (1.0 - _TABLES_SHARE))
        self.namespaces: list[dict[str, Any]] = []
        self._used_bytes = 0
        self._interval = 1

    def statistics(self) -> tuple[int, int]:
        """Bytes of all objects that the program can reach, and of the rest, negative if they do not
        fit."""
        # A program can reach its globals, and the variables of functions that are running.
        reachable: list[Any] = [*self.namespaces]
        frame: FrameType | None = sys._getframe()
        while frame is not None:
            if "@n" in frame.f_builtins:
                reachable += local_values(frame)
            frame = frame.f_back
        used_bytes = 0
        seen = set[int]()
        while reachable:
            value = reachable.pop()
            # A hub keeps integers inside of references, so they take no memory.
            if value is None or isinstance(value, int) or id(value) in seen:
                continue
            seen.add(id(value))
            size, parts = _size_and_parts(value)
            used_bytes += size
            reachable += parts
        return used_bytes, self.size_bytes - used_bytes

    def check(self) -> int:
        """The number of branches until the next check: the earlier, the faster the program grows.
        Raises MemoryError if the objects do not fit."""
        used_bytes, free_bytes = self.statistics()
        growth = max(0, used_bytes - self._used_bytes)
        self._used_bytes = used_bytes
        branch_bytes = growth // self._interval
        # Looking at all objects takes long. A program that does not grow is looked at less and
        # less, and one that does again when it has taken a quarter of what is free.
        stretch = 2.0
        if growth:
            stretch = min(2.0, free_bytes / (4 * growth))
        longest = self._interval * stretch
        self._interval = max(1, min(round(longest), _LONGEST_INTERVAL))
        if free_bytes < 0:
            # Small objects have filled the heap, so nothing is left for a message.
            if branch_bytes < _LONG_BYTES:
                raise MemoryError
            raise MemoryError(f"memory allocation failed, allocating {branch_bytes} bytes")
        return self._interval


def _size_and_parts(value: Any) -> tuple[int, Iterable[Any]]:
    """Size of an object itself, and the objects that it refers to."""
    match value:
        case bytearray() | bytes():
            return _with_block(len(value)), ()
        case str():
            zero_byte = 1
            data = value.encode("utf-8", "surrogatepass")
            return _with_block(len(data) + zero_byte), ()
        case list():
            return _with_block(_REFERENCE_BYTES * _slots(value)), value
        case tuple():
            # A tuple has no block beside the object, because its items stand in it, behind its
            # class and their number.
            items_bytes = _REFERENCE_BYTES * len(value)
            return _blocks(8 + items_bytes), value
        case dict():
            return _size_and_parts_of_dict(value)
        case set() | frozenset():
            return _with_block(_REFERENCE_BYTES * len(value)), value
        case float():
            return BLOCK_BYTES, ()
        case FunctionType() if not value.__module__.startswith(FIRMWARE):
            return _size_and_parts_of_function(value)
        case CellType():
            return BLOCK_BYTES, gc.get_referents(value)
        case MethodType():
            return BLOCK_BYTES, (value.__self__,)
        case GeneratorType() | CoroutineType():
            return _size_of_generator(value), gc.get_referents(value)
        case type() if not is_native(value):
            return BLOCK_BYTES, (dict(value.__dict__),)
        case _ if not is_native(type(value)) and hasattr(value, "__dict__"):
            attributes = value.__dict__
            return _with_block(_PAIR_BYTES * len(attributes)), attributes.values()
    # Native classes and functions are in the firmware's flash memory, and take none.
    if isinstance(value, type | FunctionType):
        return 0, ()
    return _OBJECT, ()


def _size_and_parts_of_function(function: FunctionType) -> tuple[int, Iterable[Any]]:
    cells = function.__closure__ or ()
    defaults = function.__defaults__ or ()
    # A closure takes a second object beside its function.
    objects = 2 if cells else 1
    return objects * BLOCK_BYTES, (*cells, *defaults)


def _size_of_generator(value: "GeneratorType[Any, Any, Any] | CoroutineType[Any, Any, Any]") -> int:
    code = value.gi_code if isinstance(value, GeneratorType) else value.cr_code
    # A generator keeps the variables of its function, and room for what that computes.
    kept = code.co_nlocals + code.co_stacksize
    return _with_block(_REFERENCE_BYTES * kept)


def _size_and_parts_of_dict(value: dict[Any, Any]) -> tuple[int, Iterable[Any]]:
    # CPython keeps names such as `__builtins__` in a namespace, but a hub does not.
    names = [name for name in value if not (isinstance(name, str) and name.startswith("__"))]
    # Most texts are in the table of names, which belongs to the program and not to its heap.
    keys = [name for name in names if not isinstance(name, str)]
    values = [value[name] for name in names]
    size_bytes = _with_block(_PAIR_BYTES * len(names))
    return size_bytes, [*keys, *values]


def _with_block(size_bytes: int) -> int:
    """Size of an object of one block that keeps its contents elsewhere in the heap."""
    return BLOCK_BYTES + _blocks(size_bytes)


def _blocks(size_bytes: int) -> int:
    """A size in whole blocks, bytes."""
    return -(-size_bytes // BLOCK_BYTES) * BLOCK_BYTES


def _slots(items: list[Any]) -> int:
    """Slots of a list: as many as items at first, at least 4; twice as many whenever it is full."""
    # CPython's list has spare slots too, of 8 bytes, but only after it has grown.
    spare_bytes = sys.getsizeof(items) - sys.getsizeof([]) - 8 * len(items)
    if spare_bytes <= 0:
        return max(4, len(items))
    return 1 << max(2, (len(items) - 1).bit_length())


def most_nested_calls(hub: AnyHub) -> int:
    """Number of functions, with the program itself, that can wait for each other on a kind of
    hub."""
    free_bytes = hub.model.stack_bytes - _KEPT_BYTES
    return min(free_bytes // (hub.model.call_bytes + _VARIABLES_BYTES), _MOST_PLAYED)


def check_of_calls(most: int) -> Callable[[Any], Any]:
    """A function that returns its argument, which is called next. It raises RuntimeError if that is
    a function of the program and ``most`` calls are nested already."""

    def callee(function: Any) -> Any:
        if is_own(getattr(function, "__func__", function)):
            # Calls are counted anew, because an exception may have left any number of them at once.
            nested = 0
            frame: FrameType | None = sys._getframe(1)
            while frame is not None:
                nested += "@n" in frame.f_builtins
                frame = frame.f_back
            if nested >= most:
                raise RuntimeError("maximum recursion depth exceeded")
        return function

    return callee
