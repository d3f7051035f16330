"""An environment over USB."""

from __future__ import annotations

import os
from pathlib import Path

import pytest
import torch
from described import TWO_WHEELER
from played_usb_hub import PlayedUsbHub
from tensordict import TensorDict

import bricksrl
from brickhub.hub.program.generate import generate
from bricksrl.envs import get_task


@pytest.mark.realtime
@pytest.mark.skipif(os.name != "posix", reason="pseudo terminals are a thing of POSIX")
@pytest.mark.parametrize("streaming", [False, True])
def test_address_to_moving_motors(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, streaming: bool
) -> None:
    monkeypatch.setenv("XDG_CACHE_HOME", str(tmp_path))
    monkeypatch.setattr("brickhub.hub.program.generate.END_MS", 500)
    hub = PlayedUsbHub(TWO_WHEELER)
    hub.library.append(generate(TWO_WHEELER, get_task("Spinning-v0").interface).source)
    env = bricksrl.make(
        "Spinning-v0", hub=f"usb:{hub.attach_terminal()}", streaming=streaming, place=lambda _: None
    )
    try:
        env.reset()
        for _ in range(3):
            state = env.step(TensorDict({"action": torch.ones(2)}))
        assert state["next", "observation"][0] > 5
        assert hub.is_running
    finally:
        env.close()
        hub.close()
    assert not hub.is_running
