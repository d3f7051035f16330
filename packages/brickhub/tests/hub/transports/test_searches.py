"""How often a hub that is not there is searched for."""

from __future__ import annotations

import asyncio
from typing import TYPE_CHECKING

import pytest

from brickhub import errors
from brickhub.hub.transports.pybricks_hub import ProfileTransport

if TYPE_CHECKING:
    from brickhub.hub.transports.connection import HubConnection


class Absent(ProfileTransport):
    """A hub that is not found six times, and then belongs to somebody else."""

    searches = 0

    async def _find(self, timeout_s: float) -> object:
        raise NotImplementedError

    async def _connect(self, timeout_s: float) -> HubConnection:
        self.searches += 1
        if self.searches > 6:
            raise errors.HubTakenError("another program has it")
        raise errors.HubNotFoundError("no hub is there")


def test_pauses_between_searches_double_up_to_two_seconds(monkeypatch: pytest.MonkeyPatch) -> None:
    pauses_s: list[float] = []

    async def sleep(seconds: float) -> None:
        pauses_s.append(seconds)

    monkeypatch.setattr("brickhub.hub.transports.pybricks_hub.asyncio.sleep", sleep)
    with pytest.raises(errors.HubTakenError):
        asyncio.run(Absent(timeout_s=1000.0)._connected())
    assert pauses_s == [0.25, 0.5, 1.0, 2.0, 2.0, 2.0]


def test_no_search_begins_after_the_time_limit() -> None:
    absent = Absent(timeout_s=0.1)
    with pytest.raises(errors.HubNotFoundError):
        asyncio.run(absent._connected())
    assert absent.searches == 1
