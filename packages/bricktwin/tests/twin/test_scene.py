from __future__ import annotations

import math
from typing import Any

import pytest

from brickhub.errors import TwinError
from bricktwin.twin.objects import Ball
from bricktwin.twin.scene import OPEN_FLOOR, Scene


def test_the_default_is_an_open_floor() -> None:
    assert Scene() == OPEN_FLOOR
    assert OPEN_FLOOR.wall_distance_mm is None


@pytest.mark.parametrize(
    "arguments",
    [
        {"wall_distance_mm": (300.0, 200.0)},
        {"wall_distance_mm": (0.0, 200.0)},
        {"wall_distance_mm": (200.0, math.inf)},
        {"heading_deg": (5.0, -5.0)},
        {"heading_deg": (math.nan, 0.0)},
        {"heading_deg": (-181.0, 0.0)},
        {"wall_distance_mm": (200.0, 300.0), "heading_deg": (0.0, 90.0)},
        {"wall_distance_mm": 400.0},
        {"start_mm": (0.0, 100.0)},
    ],
)
def test_invalid_start_raises(arguments: dict[str, Any]) -> None:
    with pytest.raises(TwinError, match="scene: "):
        Scene(**arguments)


def test_reading_that_is_no_function_is_named() -> None:
    with pytest.raises(
        TwinError, match=r"the reading of 'light' is 50.0; give a function: lambda angles: 50.0"
    ):
        Scene(readings={"light": 50.0})  # type: ignore[dict-item]


@pytest.mark.parametrize(
    ("values", "says"),
    [
        ({"mass_g": 0.0}, "a ball of 0.0 g; give a positive mass"),
        ({"mass_g": -1.0}, "a ball of -1.0 g; give a positive mass"),
        ({"mass_g": math.inf}, "a ball of inf g; give a positive mass"),
        ({"spread_mm": (-1.0, 0.0)}, "give 0 or more"),
        ({"diameter_mm": 0.0}, "a ball"),
        ({"color": "mauve"}, "mauve"),
    ],
)
def test_ball(values: dict[str, Any], says: str) -> None:
    assert Ball((100.0, 0.0)).mass_g == 60.0
    assert Ball((100.0, 0.0), mass_g=0.5, spread_mm=(5.0, 0.0)).diameter_mm == 74.0
    with pytest.raises(TwinError, match=says):
        Ball((100.0, 0.0), **values)
