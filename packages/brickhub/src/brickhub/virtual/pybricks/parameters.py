"""``pybricks.parameters``: enumerations, icons of a 5x5 light matrix, colors.

The nearest detectable color is found in the firmware's integer arithmetic (``pbio/color``, v4).
"""

from collections.abc import Iterable, Iterator, Sequence
from math import trunc
from types import ModuleType
from typing import Any

from brickhub.robot import HubModel
from brickhub.virtual.micropython.containers import HubDict, HubSet
from brickhub.virtual.micropython.numbers import module
from brickhub.virtual.micropython.text import representation
from brickhub.virtual.pybricks.arguments import expect, expect_type, get_int, get_number
from brickhub.virtual.pybricks.context import Context
from brickhub.virtual.pybricks.matrix import Matrix, vector
from brickhub.virtual.stimuli import COLORS, Hsv

_ROWS = {
    "UP": (4, 14, 31, 14, 14),
    "DOWN": (14, 14, 31, 14, 4),
    "LEFT": (4, 15, 31, 15, 4),
    "RIGHT": (4, 30, 31, 30, 4),
    "ARROW_RIGHT_UP": (7, 3, 5, 8, 16),
    "ARROW_RIGHT_DOWN": (16, 8, 5, 3, 7),
    "ARROW_LEFT_UP": (28, 24, 20, 2, 1),
    "ARROW_LEFT_DOWN": (1, 2, 20, 24, 28),
    "ARROW_UP": (4, 14, 21, 4, 4),
    "ARROW_DOWN": (4, 4, 21, 14, 4),
    "ARROW_LEFT": (4, 8, 31, 8, 4),
    "ARROW_RIGHT": (4, 2, 31, 2, 4),
    "HAPPY": (27, 27, 0, 17, 14),
    "SAD": (27, 27, 0, 14, 17),
    "EYE_LEFT": (0, 0, 24, 24, 0),
    "EYE_RIGHT": (0, 0, 3, 3, 0),
    "EYE_LEFT_BLINK": (0, 0, 0, 24, 0),
    "EYE_RIGHT_BLINK": (0, 0, 0, 3, 0),
    "EYE_RIGHT_BROW": (0, 3, 0, 0, 0),
    "EYE_LEFT_BROW": (0, 24, 0, 0, 0),
    "EYE_LEFT_BROW_UP": (24, 0, 0, 0, 0),
    "EYE_RIGHT_BROW_UP": (3, 0, 0, 0, 0),
    "HEART": (10, 31, 31, 14, 4),
    "PAUSE": (0, 10, 10, 10, 0),
    "EMPTY": (0, 0, 0, 0, 0),
    "FULL": (31, 31, 31, 31, 31),
    "SQUARE": (0, 14, 14, 14, 0),
    "TRIANGLE_RIGHT": (8, 12, 14, 12, 8),
    "TRIANGLE_LEFT": (2, 6, 14, 6, 2),
    "TRIANGLE_UP": (0, 4, 14, 31, 0),
    "TRIANGLE_DOWN": (0, 31, 14, 4, 0),
    "CIRCLE": (14, 31, 31, 31, 14),
    "CLOCKWISE": (30, 18, 18, 23, 2),
    "COUNTERCLOCKWISE": (15, 9, 9, 29, 8),
    "TRUE": (1, 2, 20, 8, 0),
    "FALSE": (17, 10, 4, 10, 17),
}
"""Icons: for each row of pixels the number of which its lights are the bits."""
_GRAY = (0, 0)
"""Hue and saturation of a gray."""
_FULL = (100, 100)
"""Saturation and value of a full color."""
# A measured color counts as a gray up to this saturation, or up to this value.
_MAX_GRAY_SATURATION_PCT = 40
_MAX_GRAY_VALUE_PCT = 1
_OTHER_KIND_DISTANCE = 1000
"""Distance between colors of different kinds. It is above every distance between hues or values, so
that a color of the same kind comes first."""
_REMOTE_BUTTONS = "LEFT RIGHT CENTER LEFT_PLUS LEFT_MINUS RIGHT_PLUS RIGHT_MINUS"
_BUTTONS = (
    f"{_REMOTE_BUTTONS} UP DOWN LEFT_UP LEFT_DOWN RIGHT_UP RIGHT_DOWN BEACON "
    "BLUETOOTH A B X Y LB RB VIEW MENU GUIDE LJ RJ UPLOAD P1 P2 P3 P4"
)


class Icon:
    """Named icons, and pictures from the bits of numbers, 100 for set bits."""

    def __call__(self, *bits: Any) -> Any:
        expect(len(bits) == 1)
        # A number has 25 bits, five for each row. Those of the rows above are left in and ignored.
        number = get_int(bits[0])
        return _picture([number >> shift for shift in (20, 15, 10, 5, 0)])

    def __getattr__(self, name: str) -> Any:
        if name not in _ROWS:
            raise AttributeError(f"'Icon' object has no attribute '{name}'")
        return _picture(_ROWS[name])


def _picture(rows: Sequence[int]) -> Any:
    pixels = []
    for row in rows:
        # The highest bit is the leftmost light.
        lights = [row >> bit & 1 for bit in (4, 3, 2, 1, 0)]
        pixels.append([100 if is_lit else 0 for is_lit in lights])
    return Matrix(pixels)


def nearest(measured: Hsv, candidates: Sequence[Hsv]) -> int | None:
    """Index of the first nearest candidate, or ``None``.

    Grays are compared by value and full colors by hue, independent of the distance to the surface.
    If a candidate is neither, distances are in a double cone with black and white at the tips.
    """
    is_ideal = all(map(_is_ideal, candidates))
    distance = _ideal_distance if is_ideal else _cone_distance
    indices = range(len(candidates))
    return min(indices, key=lambda index: distance(measured, candidates[index]), default=None)


def _is_ideal(color: Hsv) -> bool:
    """Whether a color is a gray, or a full color."""
    return color[:2] == _GRAY or color[1:] == _FULL


def _ideal_distance(measured: Hsv, candidate: Hsv) -> int:
    """Degrees of hue or percent of value; larger if only one is a gray."""
    hue, saturation, value = measured
    looks_gray = saturation <= _MAX_GRAY_SATURATION_PCT or value <= _MAX_GRAY_VALUE_PCT
    if looks_gray and candidate[:2] == _GRAY:
        return abs(candidate[2] - value)
    if looks_gray:
        return _OTHER_KIND_DISTANCE + _hue_distance(candidate[0], hue)
    if candidate[1:] == _FULL:
        return _hue_distance(candidate[0], hue)
    return _OTHER_KIND_DISTANCE + abs(candidate[2] - value)


def _hue_distance(a: int, b: int) -> int:
    # The difference is taken the shorter way around the circle.
    difference = abs(a - b)
    return min(difference, 360 - difference)


def _cone_distance(a: Hsv, b: Hsv) -> int:
    """Squared distance in a double cone, 20 000 high and wide. Negative values are below black, far
    from all colors."""
    ax, ay, az = _in_cone(a)
    bx, by, bz = _in_cone(b)
    # The sine is 10 000 times too large. Dividing only here loses fewer digits.
    dx = trunc((bx - ax) / 10_000)
    dy = trunc((by - ay) / 10_000)
    dz = bz - az
    return dx * dx + dy * dy + dz**2


def _in_cone(color: Hsv) -> tuple[int, int, int]:
    """Two chroma coordinates, times 10 000, and lightness."""
    hue, saturation, value = color
    radius = max(value, 0) * saturation
    cosine = _sine(hue + 90)
    lightness = (200 - saturation) * value
    return radius * cosine, radius * _sine(hue), lightness


def _sine(angle_deg: int) -> int:
    """10 000 times the sine, by parabolas."""
    x = angle_deg % 360
    # The second half of a sine is the first one upside down, and each half is symmetric.
    sign = 1
    if x >= 180:
        x -= 180
        sign = -1
    if x >= 90:
        x = 180 - x
    return sign * (201 - x) * x


class _Member:
    """A constant that prints as ``Class.NAME``."""

    __slots__ = ("_name",)

    def __init__(self, name: str) -> None:
        self._name = name

    def __repr__(self) -> str:
        return f"{type(self).__name__}.{self._name}"

    def __new__(cls, *args: Any) -> "_Member":
        # Only enumeration() makes members, before it seals the class.
        if "_sealed" in cls.__dict__:
            raise TypeError(f"can't create '{cls.__name__}' instances")
        return super().__new__(cls)


def enumeration(name: str, names: str) -> type[Any]:
    kind: Any = type(name, (_Member,), {"__slots__": ()})
    for member in names.split():
        setattr(kind, member, kind(member))
    kind._sealed = True
    return kind  # type: ignore[no-any-return]


Direction = enumeration("Direction", "CLOCKWISE COUNTERCLOCKWISE")
Stop = enumeration("Stop", "COAST BRAKE HOLD NONE COAST_SMART BRAKE_SMART")
Side = enumeration("Side", "RIGHT FRONT TOP LEFT BACK BOTTOM")
Button = enumeration("Button", _BUTTONS)


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

    def __init__(
        self,
        h: Any,
        s: Any = 100,
        v: Any = 100,
        name: str | None = None,
    ) -> None:
        hue = get_int(h) % 360
        saturation = max(0, min(100, get_int(s)))
        value = max(-100, min(100, get_int(v)))
        # This goes past __setattr__, which refuses because a color cannot be changed.
        object.__setattr__(self, "h", hue)
        object.__setattr__(self, "s", saturation)
        object.__setattr__(self, "v", value)
        object.__setattr__(self, "_name", name)

    def __setattr__(
        self,
        name: str,
        value: Any,
    ) -> None:
        raise AttributeError(f"'Color' object has no attribute '{name}'")

    def __repr__(self) -> str:
        if self._name is None:
            return f"Color(h={self.h}, s={self.s}, v={self.v})"
        return f"Color.{self._name}"

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

    def __mul__(self, scale: Any) -> "Color":
        return Color(self.h, self.s, get_number(scale) * self.v)

    __rmul__ = __mul__

    def __truediv__(self, scale: Any) -> "Color":
        divisor = get_number(scale)
        # Divided by 0, the hub's infinity saturates at the largest value of the same sign.
        sign = (self.v > 0) - (self.v < 0)
        value = self.v / divisor if divisor else 100 * sign
        return Color(self.h, self.s, value)

    __floordiv__ = __truediv__

    def __rshift__(self, shift: Any) -> "Color":
        return Color(self.h + get_int(shift), self.s, self.v)

    def __lshift__(self, shift: Any) -> "Color":
        return Color(self.h - get_int(shift), self.s, self.v)


NAMED_COLORS = {name: Color(*hsv, name) for name, hsv in COLORS.items()}


class _Palette:
    """``Color``: not a class but a dict of named colors, which a program may change."""

    __slots__ = ("_colors",)
    _colors: HubDict

    def __init__(self) -> None:
        # The number of slots decides the order in which a program sees the colors.
        colors = HubDict.sized(len(NAMED_COLORS), NAMED_COLORS.items())
        object.__setattr__(self, "_colors", colors)

    def __call__(
        self,
        h: Any,
        s: Any = 100,
        v: Any = 100,
    ) -> Color:
        return Color(h, s, v)

    def __getitem__(self, name: Any) -> Any:
        return self._colors[name]

    def __setitem__(
        self,
        name: Any,
        color: Any,
    ) -> None:
        expect_type(color, Color)
        self._colors[name] = color
        if isinstance(name, str) and color._name is None:
            object.__setattr__(color, "_name", name)

    def __delitem__(self, name: Any) -> None:
        del self._colors[name]

    def __getattr__(self, name: str) -> Any:
        # Python itself asks for such names, for example whether this is a class.
        if name.startswith("__"):
            raise AttributeError(name)
        return self._colors[name]

    __setattr__ = __setitem__
    __delattr__ = __delitem__

    def __iter__(self) -> Iterator[Any]:
        return iter(self._colors)

    def __repr__(self) -> str:
        return representation(self._colors)


class Axis:
    """Unit vectors of the robot's frame."""

    X = vector(1, 0, 0)
    Y = vector(0, 1, 0)
    Z = vector(0, 0, 1)

    def __new__(cls, *args: Any) -> "Axis":
        raise TypeError("can't create 'Axis' instances")


_Palette.__name__ = _Palette.__qualname__ = "Color"
# A hub without floating-point numbers has no vectors either, so its axes are numbers.
_NumberedAxis = type("Axis", (), {"X": 1, "Y": 2, "Z": 3})


def parameters_module(context: Context) -> ModuleType:
    hub = context.machine.robot.hub.model
    button_names = _BUTTONS if hub.has_float else _REMOTE_BUTTONS
    members = {name: getattr(Button, name) for name in button_names.split()}
    # As in the firmware, Button is an object and not a class, and a program may hand it over.
    button = type("Button", (), {"__repr__": lambda self: "Button", **members})()
    names: dict[str, Any] = {
        "Axis": Axis if hub.has_float else _NumberedAxis,
        "Button": button,
        "Color": _Palette(),
        "Direction": Direction,
        "Port": context.ports,
        "Side": Side,
        "Stop": Stop,
    }
    if hub.has_display or hub.screen_pixels:
        names["Icon"] = Icon()
    return module("parameters", names)
