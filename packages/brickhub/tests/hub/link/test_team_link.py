"""Links that command several hubs before they read any."""

from __future__ import annotations

import itertools

import pytest
from described import SPINNING, TWO_WHEELER
from stand_in import StandInHub

from brickhub.errors import HubTimeoutError
from brickhub.hub.link.lockstep import HubLink


def test_commands_are_sent_before_answers_are_read() -> None:
    hubs = [StandInHub(), StandInHub()]
    links = [HubLink(hub, TWO_WHEELER, SPINNING) for hub in hubs]
    for link in links:
        link.open()
    for number, link in enumerate(links):
        link.send([30 + number, -20])
    readings = [link.receive() for link in links]
    assert [reading.values[0] for reading in readings] == [30, 31]
    for link in links:
        link.close()


@pytest.mark.parametrize("direction", ["up", "down"])
def test_lost_frame_is_sent_again_and_is_no_delay(direction: str) -> None:
    hub = StandInHub()
    chunks = 0

    def lose_some(data: bytes) -> bytes:
        nonlocal chunks
        chunks += 1
        return b"" if chunks % 4 == 0 else data

    with HubLink(hub, TWO_WHEELER, SPINNING, watchdog_s=0.6) as link:
        link.send([1, 1])
        link.receive()
        watchdog_s = link.statistics.watchdog_s
        setattr(hub, direction, lose_some)
        sent = [[1 + number % 30, -1 - number % 30] for number in range(120)]
        readings = []
        for values in sent:
            link.send(values)
            readings.append(link.receive())
        setattr(hub, direction, lambda data: data)
        assert link.statistics.resends >= 20
        assert link.statistics.watchdog_s == watchdog_s, (
            "waiting for a lost frame is no delay of the link"
        )
        for index in (0, 1):
            turned_deg = itertools.accumulate(values[index] for values in sent)
            assert [reading.values[index] for reading in readings] == [
                (1 + angle_deg) % 360 for angle_deg in turned_deg
            ]


def test_silent_hub_raises() -> None:
    hub = StandInHub()
    link = HubLink(hub, TWO_WHEELER, SPINNING, timeout_s=0.4)
    link.open()
    hub.up = lambda data: b""
    link.send([1, 1])
    with pytest.raises(HubTimeoutError, match="did not answer"):
        link.receive()
    link.close()
