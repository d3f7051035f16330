"""``pybricks.parameters``."""

from __future__ import annotations

from collections.abc import Iterable, Iterator
from types import ModuleType
from typing import Any

from brickhub.robot import HubModel
from brickhub.virtual.micropython.containers import HubDict, HubSet
from brickhub.virtual.micropython.numbers import module
from brickhub.virtual.micropython.text import representation
from brickhub.virtual.pybricks.context import expect_type, get_int, get_number
from brickhub.virtual.pybricks.icons import Icon
from brickhub.virtual.pybricks.matrix import vector


class _Member:
    """A constant that prints as ``Class.NAME``."""

    __slots__ = ("_name",)

    def __init__(self, name: str) -> None:
        self._name = name

    def __repr__(self) -> str:
        return f"{type(self).__name__}.{self._name}"

    def __new__(cls, *args: Any) -> _Member:
        if "_sealed" in cls.__dict__:
            raise TypeError(f"can't create '{cls.__name__}' instances")
        return super().__new__(cls)


def _enumeration(name: str, names: str) -> type[Any]:
    kind: Any = type(name, (_Member,), {"__slots__": ()})
    for member in names.split():
        setattr(kind, member, kind(member))
    kind._sealed = True
    return kind  # type: ignore[no-any-return]


Direction = _enumeration("Direction", "CLOCKWISE COUNTERCLOCKWISE")
Stop = _enumeration("Stop", "COAST BRAKE HOLD NONE COAST_SMART BRAKE_SMART")
Side = _enumeration("Side", "RIGHT FRONT TOP LEFT BACK BOTTOM")
_REMOTE_BUTTONS = "LEFT RIGHT CENTER LEFT_PLUS LEFT_MINUS RIGHT_PLUS RIGHT_MINUS"
_BUTTONS = (
    f"{_REMOTE_BUTTONS} UP DOWN LEFT_UP LEFT_DOWN RIGHT_UP RIGHT_DOWN BEACON "
    "BLUETOOTH A B X Y LB RB VIEW MENU GUIDE LJ RJ UPLOAD P1 P2 P3 P4"
)
Button = _enumeration("Button", _BUTTONS)


class _Buttons:
    """``Button``: not a class but an object with buttons as attributes."""

    def __init__(self, names: Iterable[str]) -> None:
        self._names = frozenset(names)

    def __getattr__(self, name: str) -> Any:
        if name not in self._names:
            raise AttributeError(f"'Button' object has no attribute '{name}'")
        return getattr(Button, name)

    def __repr__(self) -> str:
        return "Button"


def buttons(names: Iterable[str], hub: HubModel) -> HubSet | tuple[Any, ...]:
    """A set of ``Button`` from lower-case names; a tuple on a Move hub, which has no sets."""
    members = [getattr(Button, name.upper()) for name in names]
    return HubSet(members) if hub.has_float else tuple(members)


class Color:
    """Hue 0..359, saturation 0..100, value -100..100. Only the named objects print their names.

    Equal colors are the same dict key, as in a full hash table of a hub; ``hash()`` is the address.
    """

    __slots__ = ("_name", "h", "s", "v")
    h: int
    s: int
    v: int
    _name: str | None
    hash_is_address = True

    def __init__(self, h: Any, s: Any = 100, v: Any = 100, name: str | None = None) -> None:
        object.__setattr__(self, "h", get_int(h) % 360)
        object.__setattr__(self, "s", max(0, min(100, get_int(s))))
        object.__setattr__(self, "v", max(-100, min(100, get_int(v))))
        object.__setattr__(self, "_name", name)

    def __setattr__(self, name: str, value: Any) -> None:
        raise AttributeError(f"'Color' object has no attribute '{name}'")

    def __repr__(self) -> str:
        return f"Color(h={self.h}, s={self.s}, v={self.v})" if self._name is None else f"Color.{self._name}"

    def named(self, name: str) -> None:
        """Set the printed name, if there is none yet."""
        if self._name is None:
            object.__setattr__(self, "_name", name)

    def __iter__(self) -> Iterator[int]:
        return iter((self.h, self.s, self.v))

    def __getitem__(self, index: int) -> int:
        if not 0 <= get_int(index) <= 2:
            raise IndexError
        return (self.h, self.s, self.v)[index]

    def __eq__(self, other: object) -> bool:
        return isinstance(other, Color) and tuple(self) == tuple(other)

    def __hash__(self) -> int:
        return self.h + self.s + self.v

    def __mul__(self, scale: Any) -> Color:
        return Color(self.h, self.s, get_number(scale) * self.v)

    __rmul__ = __mul__

    def __truediv__(self, scale: Any) -> Color:
        divisor = get_number(scale)
        return Color(self.h, self.s, self.v / divisor if divisor else 100 * ((self.v > 0) - (self.v < 0)))

    __floordiv__ = __truediv__

    def __rshift__(self, shift: Any) -> Color:
        return Color(self.h + get_int(shift), self.s, self.v)

    def __lshift__(self, shift: Any) -> Color:
        return Color(self.h - get_int(shift), self.s, self.v)


_COLORS = {
    "RED": (0, 100, 100), "BROWN": (30, 100, 50), "ORANGE": (30, 100, 100), "YELLOW": (60, 100, 100), "GREEN": (120, 100, 100),
    "CYAN": (180, 100, 100), "BLUE": (240, 100, 100), "MAGENTA": (300, 100, 100), "VIOLET": (270, 100, 100), "BLACK": (0, 0, 10),
    "GRAY": (0, 0, 50), "WHITE": (0, 0, 100), "NONE": (0, 0, 0),
}  # fmt: skip
NAMED_COLORS = {name: Color(*hsv, name) for name, hsv in _COLORS.items()}


class _Palette:
    """``Color``: not a class but a dict of named colors, which a program may change."""

    __slots__ = ("_colors",)
    _colors: HubDict

    def __init__(self) -> None:
        object.__setattr__(self, "_colors", HubDict.sized(len(NAMED_COLORS), NAMED_COLORS.items()))

    def __call__(self, h: Any, s: Any = 100, v: Any = 100) -> Color:
        return Color(h, s, v)

    def __getitem__(self, name: Any) -> Any:
        return self._colors[name]

    def __setitem__(self, name: Any, color: Any) -> None:
        expect_type(color, Color)
        self._colors[name] = color
        if isinstance(name, str):
            color.named(name)

    def __delitem__(self, name: Any) -> None:
        del self._colors[name]

    def __getattr__(self, name: str) -> Any:
        if name.startswith("__"):  # Python's own queries, such as whether this is a class
            raise AttributeError(name)
        return self._colors[name]

    def __setattr__(self, name: str, color: Any) -> None:
        self[name] = color

    def __delattr__(self, name: str) -> None:
        del self._colors[name]

    def __iter__(self) -> Iterator[Any]:
        return iter(self._colors)

    def __repr__(self) -> str:
        return representation(self._colors)


_Palette.__name__ = _Palette.__qualname__ = "Color"


class Axis:
    """Unit vectors of the robot's frame."""

    X = vector(1, 0, 0)
    Y = vector(0, 1, 0)
    Z = vector(0, 0, 1)

    def __new__(cls, *args: Any) -> Axis:
        raise TypeError("can't create 'Axis' instances")


class _NumberedAxis:
    """``Axis`` of a hub without floating-point numbers."""

    X, Y, Z = 1, 2, 3


_NumberedAxis.__name__ = _NumberedAxis.__qualname__ = "Axis"


class Parameters:
    """Enumerations of a kind of hub, with its ports only."""

    def __init__(self, hub: HubModel) -> None:
        self.Port = _enumeration("Port", " ".join(hub.ports))
        self._has_display, self._has_float = hub.has_display, hub.has_float

    def port_letter(self, port: Any) -> str:
        """Letter of a ``Port``; raises TypeError for other values."""
        expect_type(port, self.Port)
        return str(port._name)

    def module(self) -> ModuleType:
        axis, button = (Axis, _BUTTONS) if self._has_float else (_NumberedAxis, _REMOTE_BUTTONS)
        names: dict[str, Any] = {"Axis": axis, "Button": _Buttons(button.split()), "Color": _Palette(), "Direction": Direction}
        names.update({"Port": self.Port, "Side": Side, "Stop": Stop})
        if self._has_display:
            names["Icon"] = Icon()
        return module("parameters", names)
