"""Stop, which ends any program in a moment where nothing else takes the processor."""

from __future__ import annotations

from typing import TYPE_CHECKING

import pytest
from in_page import ENDLESS, stopped_after_s

if TYPE_CHECKING:
    from playwright.sync_api import Page

STOP_S = 0.2


@pytest.mark.slow
@pytest.mark.realtime
@pytest.mark.parametrize("source", ENDLESS)
def test_stop_takes_a_moment(page: Page, source: str) -> None:
    assert stopped_after_s(page, source) < STOP_S
