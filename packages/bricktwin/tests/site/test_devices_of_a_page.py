"""Real devices of LEGO's kits behind a page, whose part is played."""

from __future__ import annotations

import asyncio
import json
from typing import Any

import pytest

from brickhub.kits.kit_protocol import Product
from bricktwin.site.tab.real_kit import _Browser, _Device

NUMBER = 7


class PlayedPage:
    """A page that notes what it is asked, and answers at once."""

    def __init__(self) -> None:
        self.asked: list[tuple[str, int, str, str]] = []
        self.browser: _Browser | None = None

    def ask_kit(
        self, number: int, operation: str, device: int, characteristic: str, data: str
    ) -> None:
        self.asked.append((operation, device, characteristic, data))
        answer = {"kind": "answer", "number": number, "device": NUMBER, "name": "M", "id": "m"}
        assert self.browser is not None
        loop = asyncio.get_running_loop()
        loop.call_soon(self.browser.take, answer)

    @property
    def operations(self) -> list[str]:
        return [operation for operation, *_ in self.asked]


def tell(*_: Any, **__: Any) -> None:
    """Nobody listens."""


async def connected(page: PlayedPage) -> _Device:
    """A double motor that the page has chosen and connected."""
    page.browser = _Browser(page, tell)  # type: ignore[arg-type]
    prefix = Product.DOUBLE_MOTOR.to_bytes(2, "big")
    wanted = {"manufacturerData": [{"mask": b"\xff\xff", "dataPrefix": prefix}]}
    device = await page.browser.requestDevice({"filters": [wanted]})
    return await device.connect()


def test_a_device_is_chosen_by_its_title_and_connected() -> None:
    page = PlayedPage()
    device = asyncio.run(connected(page))
    assert device.connected
    assert (device.name, device.id) == ("M", "m")
    operation, _, _, data = page.asked[0]
    assert operation == "choose"
    assert json.loads(data)["title"] == Product.DOUBLE_MOTOR.title
    assert page.operations == ["choose", "connect"]


@pytest.mark.parametrize(("is_lost", "closed"), [(False, ["close"]), (True, [])])
def test_a_device_that_is_lost_is_not_left_again(is_lost: bool, closed: list[str]) -> None:
    page = PlayedPage()

    async def lose_and_stop() -> _Device:
        device = await connected(page)
        assert page.browser is not None
        if is_lost:
            page.browser.take({"kind": "lost", "device": NUMBER})
        page.asked.clear()
        await page.browser.stop_motors()
        return device

    device = asyncio.run(lose_and_stop())
    assert page.operations == closed
    assert not device.connected
