"""``pybricks.parameters``."""

from __future__ import annotations

from collections.abc import Iterator
from types import ModuleType
from typing import Any

from bricksrl.robots import HubModel
from bricksrl.twin.micropython.numbers import module
from bricksrl.twin.micropython.text import representation
from bricksrl.twin.pybricks.context import expect_type, get_int
from bricksrl.twin.pybricks.icons import icons
from bricksrl.twin.pybricks.matrix import Matrix, vector


class _Member:
    """A constant that prints as ``Class.NAME``."""

    __slots__ = ("_name",)

    def __init__(self, name: str) -> None:
        self._name = name

    def __repr__(self) -> str:
        return f"{type(self).__name__}.{self._name}"

    def __new__(cls, *args: Any) -> _Member:
        if "_sealed" in cls.__dict__:
            raise TypeError(f"cannot create '{cls.__name__}' instances")
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
Button = _enumeration(
    "Button",
    "LEFT_DOWN DOWN RIGHT_DOWN LEFT CENTER RIGHT LEFT_UP UP RIGHT_UP A B X Y LB RB LJ RJ P1 P2 P3 P4 GUIDE MENU UPLOAD VIEW",
)
for _alias, _name in (
    ("LEFT_MINUS", "LEFT_DOWN"),
    ("RIGHT_MINUS", "RIGHT_DOWN"),
    ("LEFT_PLUS", "LEFT_UP"),
    ("BEACON", "UP"),
    ("RIGHT_PLUS", "RIGHT_UP"),
    ("BLUETOOTH", "RIGHT_UP"),
):
    setattr(Button, _alias, getattr(Button, _name))


class Color:
    """Hue 0..359, saturation and brightness 0..100."""

    __slots__ = ("h", "s", "v")
    h: int
    s: int
    v: int

    def __init__(self, h: Any, s: Any = 100, v: Any = 100) -> None:
        object.__setattr__(self, "h", get_int(h) % 360)
        object.__setattr__(self, "s", max(0, min(100, get_int(s))))
        object.__setattr__(self, "v", max(-100, min(100, get_int(v))))

    def __setattr__(self, name: str, value: Any) -> None:
        raise AttributeError(f"'Color' object has no attribute '{name}'")

    def __repr__(self) -> str:
        for name, known in _COLORS.items():
            if tuple(self) == known:
                return f"Color.{name}"
        return f"Color(h={self.h}, s={self.s}, v={self.v})"

    def __iter__(self) -> Iterator[int]:
        return iter((self.h, self.s, self.v))

    def __getitem__(self, index: int) -> int:
        return (self.h, self.s, self.v)[index]

    def __eq__(self, other: object) -> bool:
        return isinstance(other, Color) and tuple(self) == tuple(other)

    def __hash__(self) -> int:
        return self.h + self.s + self.v

    def __mul__(self, scale: float) -> Color:
        return Color(self.h, self.s, max(0, self.v * scale))

    __rmul__ = __mul__

    def __truediv__(self, scale: float) -> Color:
        return Color(self.h, self.s, max(0, self.v / scale))

    __floordiv__ = __truediv__

    def __rshift__(self, shift: int) -> Color:
        return Color(self.h + shift, self.s, self.v)

    def __lshift__(self, shift: int) -> Color:
        return Color(self.h - shift, self.s, self.v)


_COLORS = {
    "NONE": (0, 0, 0), "BLACK": (0, 0, 10), "GRAY": (0, 0, 50), "WHITE": (0, 0, 100), "RED": (0, 100, 100),
    "ORANGE": (30, 100, 100), "BROWN": (30, 100, 50), "YELLOW": (60, 100, 100), "GREEN": (120, 100, 100),
    "CYAN": (180, 100, 100), "BLUE": (240, 100, 100), "VIOLET": (270, 100, 100), "MAGENTA": (300, 100, 100),
}  # fmt: skip
for _name, _hsv in _COLORS.items():
    setattr(Color, _name, Color(*_hsv))


class _Palette(type):
    """``Color`` as a program has it: also a dictionary of the named colors, which the program may change for itself."""

    def __getitem__(cls, name: str) -> Any:
        if name not in cls._names:
            raise KeyError(name)
        return getattr(cls, name)

    def __setitem__(cls, name: str, color: Any) -> None:
        setattr(cls, name, color)

    def __setattr__(cls, name: str, color: Any) -> None:
        expect_type(color, Color)
        if name not in cls._names:
            cls._names.append(name)
        super().__setattr__(name, color)

    def __iter__(cls) -> Iterator[str]:
        return iter(list(cls._names))

    def __instancecheck__(cls, value: object) -> bool:
        return isinstance(value, Color)

    def __repr__(cls) -> str:
        return representation({name: cls[name] for name in cls})

    _names: list[str]


def palette() -> type[Any]:
    """A class ``Color`` for one program."""
    return _Palette("Color", (Color,), {"__slots__": (), "_names": list(_COLORS)})


class Axis:
    """Unit vectors of the robot's frame."""

    X = vector(1, 0, 0)
    Y = vector(0, 1, 0)
    Z = vector(0, 0, 1)


class Parameters:
    """The enumerations of one kind of hub: it has no other ports than these."""

    def __init__(self, hub: HubModel, has_display: bool) -> None:
        self.Port = _enumeration("Port", " ".join(hub.ports))
        self._has_display = has_display

    def port_letter(self, port: Any) -> str:
        """The letter of a ``Port``. Raises TypeError for anything else."""
        expect_type(port, self.Port)
        return str(port._name)

    def module(self) -> ModuleType:
        names: dict[str, Any] = {"Button": Button, "Color": palette(), "Direction": Direction, "Port": self.Port, "Side": Side}
        names.update({"Stop": Stop, "Axis": Axis})
        if self._has_display:
            names["Icon"] = type("Icon", (), {name: Matrix(rows) for name, rows in icons().items()})
        return module("pybricks.parameters", names)
