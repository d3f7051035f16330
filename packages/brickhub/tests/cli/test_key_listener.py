"""Single key presses."""

from __future__ import annotations

import threading
import time
from collections.abc import Callable

import pytest
from prompt_toolkit.input import create_pipe_input

from brickhub.cli.key_listener import keys_heard

pytestmark = pytest.mark.realtime

BOUND_S = 5.0


def eventually(is_so: Callable[[], object], bound_s: float = BOUND_S) -> None:
    start_s = time.monotonic()
    while not is_so():
        assert time.monotonic() - start_s < bound_s
        time.sleep(0.005)


def test_keys_have_names() -> None:
    pressed: list[str] = []
    with create_pipe_input() as source, keys_heard(pressed.append, source):
        source.send_text("p q")
        eventually(lambda: len(pressed) == 3)
        source.send_text("\x1b")
        eventually(lambda: len(pressed) == 4)
        source.send_text("\x1b[A")
        eventually(lambda: len(pressed) == 5)
    assert pressed == ["p", " ", "q", "escape", "up"]
    assert not [thread for thread in threading.enumerate() if thread.name == "bricksrl-keys"]


def test_ctrl_c_is_unchanged() -> None:
    with create_pipe_input() as source, keys_heard(lambda key: None, source):
        source.send_text("\x03")
        with pytest.raises(KeyboardInterrupt):
            eventually(lambda: False)
