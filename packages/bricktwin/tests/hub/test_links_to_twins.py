"""Generated programs of all robot tasks with link, hub, firmware and physics: what a body
changes."""

from __future__ import annotations

import math
import random
from collections.abc import Mapping
from typing import ClassVar

import pytest
from described import TASKS
from on_a_body import LinkContract

from brickhub.virtual.body import Body
from bricktwin import robots
from bricktwin.twin.make_body import make_body
from bricktwin.twin.scene import Scene

SCENES = {"RunAway-v0": Scene(wall_distance_mm=(200.0, 300.0), heading_deg=(-5.0, 5.0))}


class TestLinkToATwin(LinkContract):
    """Robots on the floor."""

    # The firmware with its own model of a motor takes 805 ms for 100 mm; LEGO's is stronger.
    settle_s: ClassVar[Mapping[str, float]] = {**LinkContract.settle_s, "RunAway-v0": 0.785}
    # Nothing but the play of an arm that sags into its gears.
    play_mdeg = 2000
    # On the ground.
    later_step_deg = (92, 8)
    # The arm is heavy.
    ends_deg = ((-math.inf, 70 + 8), (-math.inf, 10 + 8), (-math.inf, -45 + 8))

    def body_of(self, env_id: str) -> Body:
        described, _ = TASKS[env_id]
        return make_body(robots.get(described.name), scene=SCENES.get(env_id))

    def test_reset_during_a_program_puts_the_robot_into_its_scene(self) -> None:
        link, hub = self.connected("RunAway-v0")
        hub.reset(random.Random(0))
        assert 190 < hub.body.distance_mm("C") < 320
        assert link.read().values[-1] == pytest.approx(hub.body.distance_mm("C"), abs=20)
