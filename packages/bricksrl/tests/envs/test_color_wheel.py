"""The color sensor robot of docs/virtual_hub.md as an environment."""

from __future__ import annotations

import re
import sys
from pathlib import Path

import pytest
import torch

import bricksrl
from bricksrl.envs import get_task

DOCUMENT = Path(__file__).parents[4] / "docs" / "virtual_hub.md"


@pytest.fixture
def wheel(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> str:
    block = next(
        text
        for text in re.findall(
            r"```python\n(.*?)```", DOCUMENT.read_text(encoding="utf-8"), re.DOTALL
        )
        if "FIND_BLUE" in text
    )
    (tmp_path / "color_wheel.py").write_text(block)
    monkeypatch.setattr(sys, "dont_write_bytecode", True)
    yield f"{tmp_path / 'color_wheel.py'}:FIND_BLUE"
    sys.modules.pop("color_wheel", None)


def test_observed_color_is_under_sensor(wheel: str) -> None:
    env = bricksrl.make(wheel, seed=0)
    step = env.reset()
    hues = []
    for _ in range(3):
        step = env.step(step.set("action", torch.tensor([1.0])))["next"]
        hues.append(step["observation"][0].item())
        assert step["observation"][1:].tolist() == pytest.approx([80.0, 60.0], abs=1), (
            "as the firmware computes it, in whole numbers"
        )
        assert step["reward"].item() == pytest.approx(1 - abs(hues[-1] - 240) / 240)
    env.close()
    assert hues == pytest.approx([90, 180, 270], abs=5), "a turn of the disc shows another color"


def test_hue_wraps(wheel: str) -> None:
    entries = get_task(wheel).entries
    assert [(entry.name, entry.wraps) for entry in entries] == [
        ("light_hue", True),
        ("light_saturation", False),
        ("light_value", False),
    ]
