"""Playing on the page."""

from __future__ import annotations

import threading
from contextlib import closing

import pytest

import bricksrl
from bricksrl.errors import StoppedError
from bricksrl.page.live import LivePage
from bricksrl.page.play import play_on_page
from bricksrl.policies.named import Player


def test_reset_pressed_before_a_stop_does_not_start_the_robot_again() -> None:
    with closing(bricksrl.make("RunAway-v0", seed=0)) as env:
        page, over = LivePage("RunAway-v0", task=env.task), threading.Event()

        def act(state):
            assert not page.is_stopped and not timers, "it moves again"
            page._press("reset", None)
            page.stop()
            timers.append(threading.Timer(1.5, over.set))
            timers[0].start()
            return state.set("action", env.action_spec.zero())

        timers: list[threading.Timer] = []
        with pytest.raises(StoppedError):
            play_on_page(env, page, {"": lambda: Player(act)}, stop=over)
        timers[0].join()
