"""Survey and calibration of robots with bodies."""

from __future__ import annotations

import pytest
from on_a_body import ArmContract, check_survey

from brickhub.virtual.body import Body
from bricktwin import robots
from bricktwin.robots import ROBO_ARM
from bricktwin.twin.make_body import make_body


class TestArmOfATwin(ArmContract):
    """An arm with gears, gravity and end stops."""

    def arm(self) -> Body:
        return make_body(ROBO_ARM)


@pytest.mark.parametrize(
    "name", [name for name in robots.ROBOTS if robots.get(name).hub.model.runs_programs]
)
def test_survey_finds_devices_without_motion(name: str) -> None:
    check_survey(make_body(robots.get(name)))
