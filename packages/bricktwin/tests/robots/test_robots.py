"""Robots by name."""

from __future__ import annotations

import re

import pytest

from brickhub.errors import UnknownNameError
from bricktwin import robots
from bricktwin.robots import ROBOTS


def test_robots_are_found_by_name() -> None:
    assert all(robots.get(name) is robot and robot.name == name for name, robot in ROBOTS.items())
    with pytest.raises(UnknownNameError, match=re.escape(", ".join(sorted(ROBOTS)))):
        robots.get("r2d2")
