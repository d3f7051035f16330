"""The report of a run."""

from __future__ import annotations

import pytest

from bricksrl.evaluation.report import labelled


@pytest.mark.parametrize(
    ("name", "value", "shown"),
    [
        ("forward_speed_m_s", 0.0524649, ("forward speed", "0.05246 m/s")),
        ("forward_m", 1.416, ("forward", "1.416 m")),
        ("turned_deg", -38.1, ("turned", "-38.1 deg")),
        ("mean_yaw_rate_deg_s", 170.0, ("mean yaw rate", "170 deg/s")),
        ("straightness", 0.8, ("straightness", "0.8")),
    ],
)
def test_metrics_are_shown_with_their_units(name: str, value: float, shown: tuple[str, str]) -> None:
    assert labelled(name, value) == shown
