from __future__ import annotations

import subprocess
import sys
from dataclasses import replace

import pytest

from bricksrl.agents import PRESETS, SACSettings, make_agent, preset
from bricksrl.agents.layout import ObservationLayout
from bricksrl.errors import DescriptionError, UnknownNameError

LAYOUT = ObservationLayout((0.0, 0.0), (360.0, 2000.0), (True, False))


def test_paper_preset_is_the_papers() -> None:
    paper = preset("paper")
    assert (paper.learning_rate, paper.batch_size, paper.gamma, paper.tau) == (3e-4, 256, 0.99, 0.005)
    assert (paper.hidden, paper.prefill_episodes, paper.initial_alpha, paper.updates_per_step) == ((256, 256), 10, 1.0, 1)
    assert paper.angles == "raw"
    assert not paper.layer_norm


def test_unknown_names_say_what_there_is() -> None:
    with pytest.raises(UnknownNameError, match=r"no preset 'papr'; choose one of .*paper"):
        preset("papr")
    with pytest.raises(UnknownNameError, match="no agent 'ppo'; choose one of sac, random"):
        make_agent("ppo", LAYOUT, 1)


@pytest.mark.parametrize("name", sorted(PRESETS))
def test_every_preset_makes_an_agent(name: str) -> None:
    assert make_agent("sac", LAYOUT, 2, preset(name)).prefill_episodes == preset(name).prefill_episodes


@pytest.mark.parametrize(
    "change",
    [
        {"learning_rate": 0.0},
        {"batch_size": 0},
        {"gamma": 1.1},
        {"tau": 0.0},
        {"tau": 2.0},
        {"dropout": -0.1},
        {"hidden": ()},
        {"hidden": (8, 0)},
        {"prefill_episodes": -1},
        {"updates_per_step": 0},
        {"angles": "degrees"},
        {"replay_size": 0},
        {"initial_alpha": 0.0},
        {"min_scale": 0.0},
    ],
)
def test_impossible_settings_are_refused(change: dict[str, object]) -> None:
    with pytest.raises(DescriptionError, match=next(iter(change))):
        replace(SACSettings(), **change)  # type: ignore[arg-type]


def test_presets_and_config_load_no_torch() -> None:
    code = (
        "import sys, bricksrl.agents, bricksrl.training, bricksrl.evaluation\n"
        "sys.exit(any(name in sys.modules for name in ('torch', 'matplotlib', 'mujoco')))"
    )
    subprocess.run([sys.executable, "-c", code], check=True, timeout=60)
