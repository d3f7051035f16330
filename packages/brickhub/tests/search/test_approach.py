"""Approach to a place at some distance: on a computer and on a hub."""

from __future__ import annotations

import math
from typing import Any

import pytest

from brickhub.search.approach import Approach


def test_the_speed_is_in_proportion_to_the_way_and_the_hub_computes_the_same() -> None:
    approach = Approach(400.0, 800.0, 6.0)
    numbers = (150.0, 2.0)
    wanted = {150.0: 0.0, 250.0: 0.5, 100.0: -0.25, 2000.0: 1.0, 0.0: -0.75}
    source = approach.hub_source().replace("import umath", "")
    on_hub: dict[str, Any] = {"umath": math}
    exec(source, on_hub)  # noqa: S102  our own program
    for distance_mm, action in wanted.items():
        assert approach.act([distance_mm], numbers) == [pytest.approx(action)]
        assert on_hub["act_by"]([distance_mm], numbers) == [pytest.approx(action)]
    assert [entry.unit for entry in approach.numbers] == ["mm", "1/s"]
