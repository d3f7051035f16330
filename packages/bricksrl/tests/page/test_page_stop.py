"""The page's stop button over Bluetooth."""

from __future__ import annotations

import time

import pytest
from ble_world import BOUND_S, World
from browser import chromium, tab
from radio import ATT_WRITE_REQUEST
from stopping import SLOW_STEP, Act, eventually, held, patient_link

from brickhub.hub.link.lockstep import HubLink
from brickhub.hub.program import generate
from brickhub.hub.transports.profile import PybricksCommand
from bricksrl.envs.env_interface import BricksEnv
from bricksrl.errors import StoppedError
from bricksrl.page.live import LivePage

pytestmark = pytest.mark.realtime


class Robot(BricksEnv):
    """A minimal environment for the page."""

    batch_size = ()

    def __init__(self, link: HubLink) -> None:
        self.stop = link.emergency_stop


def test_page_stop_acts_at_next_connection_event(
    world: World, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(generate, "END_MS", 60_000)  # a browser on a loaded machine takes its time
    with chromium() as browser, LivePage("a robot") as live, tab(browser, live.url) as page:
        red = page.get_by_role("button", name="EMERGENCY STOP")
        red.wait_for()
        link = patient_link(world, SLOW_STEP)
        live.attach(Robot(link))
        step = Act(link)
        world.hub.wait_until("is_driven", True)
        time.sleep(0.1)  # its write has been acknowledged: the step waits for the answer
        with held(world) as connection_event:
            red.click()
            eventually(world, ATT_WRITE_REQUEST, PybricksCommand.STOP_USER_PROGRAM)
            assert world.hub.is_running
            connection_event()
            world.hub.wait_until("is_driven", False)
        page.locator("#state:text-is('STOPPED')").wait_for()
        step.join(BOUND_S)
        assert isinstance(step.error, StoppedError) and not world.hub.is_running
        assert world.hub.commands.count(PybricksCommand.STOP_USER_PROGRAM) == 1
