"""Commands that move a body: what its sensors say of it."""

from __future__ import annotations

import pytest
from on_a_body import DriveContract

from brickhub.virtual.body import Body
from brickhub.virtual.virtual_transport import VirtualHub
from bricktwin.robots import TWO_WHEELER
from bricktwin.twin.make_body import make_body


class TestDriveOfATwin(DriveContract):
    """A 2Wheeler on the floor, whose gyroscope agrees with its motors."""

    def body(self) -> Body:
        return make_body(TWO_WHEELER)

    def check_drive(self, seen: list[list[float]], hub: VirtualHub) -> None:
        assert seen[6][4] == pytest.approx(seen[6][3], abs=8)
        assert hub.body.pose().heading_deg == pytest.approx(seen[6][4], abs=5)

    def check_turn(self, seen: list[list[float]]) -> None:
        assert [row[4] for row in seen[1:]] == pytest.approx([90, 45], abs=8)
