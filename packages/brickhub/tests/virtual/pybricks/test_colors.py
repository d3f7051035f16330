"""Nearest detectable color."""

from __future__ import annotations

import math

import pytest
from hub_programs import output
from hypothesis import given
from hypothesis import strategies as st

from brickhub.virtual.pybricks.parameters import nearest
from brickhub.virtual.pybricks.plug import _shifted_hue

RED, YELLOW, GREEN, BLUE, WHITE, NONE = (
    (0, 100, 100),
    (60, 100, 100),
    (120, 100, 100),
    (240, 100, 100),
    (0, 0, 100),
    (0, 0, 0),
)
DEFAULT = [RED, YELLOW, GREEN, BLUE, WHITE, NONE]
colors = st.tuples(st.integers(0, 359), st.integers(0, 100), st.integers(0, 100))


@pytest.mark.parametrize(
    ("hue", "shifted"),
    [(349, 349), (350, 350), (353, 356), (355, 0), (0, 10), (39, 49), (42, 51), (58, 59), (61, 61)],
)
def test_hues_near_red_are_shifted_towards_yellow(hue: int, shifted: int) -> None:
    assert _shifted_hue(hue) == shifted


@pytest.mark.parametrize(
    ("measured", "color"),
    [
        ((350, 90, 8), RED),  # dark, yet red
        ((45, 60, 60), YELLOW),
        ((170, 41, 2), GREEN),
        ((200, 100, 30), BLUE),
        ((200, 40, 60), WHITE),  # too pale for a hue
        ((200, 40, 49), NONE),
        ((120, 100, 1), NONE),
        ((30, 50, 50), RED),  # halfway: the first
    ],
)
def test_pure_colors_compare_hue_or_brightness(measured, color):
    assert DEFAULT[nearest(measured, DEFAULT)] == color


def test_custom_color_uses_cone_distance():
    brick = (350, 90, 40)
    assert nearest((350, 90, 8), DEFAULT) == 0
    assert nearest((350, 90, 8), [*DEFAULT, brick]) == 5, "so dark that black is nearer"
    assert nearest((345, 85, 45), [*DEFAULT, brick]) == 6


def test_negative_value_keeps_order():
    measured = (0, 0, 20)
    dark, gray = (0, 0, 0), (10, 0, 45)
    assert nearest(measured, [dark, gray]) == 0
    assert nearest(measured, [(0, 0, -30), gray]) == 1


def test_no_detectable_colors_gives_none():
    assert nearest((0, 0, 0), []) is None


def place(color):
    hue, saturation, value = color
    chroma = saturation * value
    return (
        chroma * math.cos(math.radians(hue)),
        chroma * math.sin(math.radians(hue)),
        (200 - saturation) * value,
    )


@given(colors, st.lists(colors, min_size=1, max_size=6).map(lambda found: [*found, (0, 50, 50)]))
def test_cone_of_lightness_and_chroma(measured, candidates):
    found = math.dist(place(measured), place(candidates[nearest(measured, candidates)]))
    best = min(math.dist(place(measured), place(candidate)) for candidate in candidates)
    assert found <= best + 700, "the firmware's sine is off by up to 1.7 % of the radius, twice"


def test_palette_takes_colors_alone() -> None:
    """A program gives it colors of its own, by name."""
    source = """
from pybricks.parameters import Color
Color["MINE"] = Color(30, 50, 60)
print(Color["MINE"])
try:
    Color["OTHER"] = 3
except TypeError as error:
    print(error)
del Color["MINE"]
for name in ("MINE", "OTHER"):
    try:
        Color[name]
    except KeyError:
        print("no", name)
"""
    assert output(source).splitlines() == [
        "Color.MINE",
        "can't convert int to Color",
        "no MINE",
        "no OTHER",
    ]
