from __future__ import annotations

import subprocess
import sys
from dataclasses import replace

import pytest

from bricksrl.agents import (
    AGENTS,
    PRESETS,
    BCSettings,
    CQLSettings,
    CrossQSettings,
    IQLSettings,
    SACSettings,
    TD3BCSettings,
    TD3Settings,
    make_agent,
    preset,
)
from bricksrl.agents.layout import ObservationLayout
from bricksrl.agents.presets import OFFLINE_UPDATES
from bricksrl.errors import DescriptionError, UnknownNameError

LAYOUT = ObservationLayout((0.0, 0.0), (360.0, 2000.0), (True, False))


def test_paper_preset_is_the_papers() -> None:
    paper = preset("paper")
    assert isinstance(paper, SACSettings)
    assert (paper.learning_rate, paper.batch_size, paper.gamma, paper.tau) == (3e-4, 256, 0.99, 0.005)
    assert (paper.hidden, paper.prefill_episodes, paper.initial_alpha, paper.updates_per_step) == ((256, 256), 10, 1.0, 1)
    assert paper.angles == "raw"
    assert not paper.layer_norm
    assert (paper.hindsight, paper.new_goals, paper.goals) == (0.0, 0.0, "plain")


def test_papers_td3_and_droq_are_its_authors() -> None:
    td3, droq = preset("paper", "td3"), preset("paper", "droq")
    assert isinstance(td3, TD3Settings)
    assert (td3.actor_delay, td3.exploration_noise, td3.target_noise, td3.target_noise_limit) == (2, 0.1, 0.2, 0.5)
    assert (td3.learning_rate, td3.prefill_episodes, td3.layer_norm, td3.updates_per_step) == (3e-4, 10, False, 1)
    assert isinstance(droq, SACSettings)
    assert (droq.updates_per_step, droq.actor_delay, droq.dropout, droq.layer_norm) == (20, 20, 0.01, True)
    assert (droq.critics, droq.target_critics, droq.actor_value) == (2, 2, "mean")
    assert (droq.hidden, droq.learning_rate, droq.batch_size) == ((256, 256), 3e-4, 256)


def test_papers_offline_agents_are_the_papers() -> None:
    bc, iql, cql = (preset("paper", name) for name in ("bc", "iql", "cql"))
    for settings in (bc, iql, cql, preset("paper", "td3bc")):
        assert (settings.hidden, settings.learning_rate, settings.batch_size) == ((256, 256), 3e-4, 256)
        assert (settings.angles, settings.goals) == ("raw", "plain")
    assert isinstance(bc, BCSettings)
    assert (bc.layer_norm, bc.dropout) == (True, 0.01)
    assert isinstance(iql, IQLSettings)
    assert (iql.temperature, iql.expectile, iql.gamma, iql.tau, iql.layer_norm) == (1.0, 0.5, 0.99, 0.005, False)
    assert isinstance(cql, CQLSettings)
    assert (cql.min_q_weight, cql.sampled_actions, cql.lagrange_threshold) == (1.0, 10, 5.0)
    assert (cql.imitation_updates, cql.gamma, cql.tau, cql.layer_norm) == (1000, 0.99, 0.005, False)
    assert OFFLINE_UPDATES["RoboArm-v0"] == {"expert": 5000, "random": 10_000}
    assert OFFLINE_UPDATES["RunAway-v0"] == {"expert": 2000, "random": 2000}


@pytest.mark.parametrize("name", sorted(PRESETS))
def test_redq_has_ten_critics_of_which_two_make_the_target(name: str) -> None:
    redq = preset(name, "redq")
    assert isinstance(redq, SACSettings)
    assert (redq.critics, redq.target_critics, redq.actor_value) == (10, 2, "mean")
    assert not redq.layer_norm
    assert redq.dropout == 0.0
    assert redq.updates_per_step == redq.actor_delay


def test_unknown_names_say_what_there_is() -> None:
    with pytest.raises(UnknownNameError, match=r"no preset 'papr'; choose one of .*paper"):
        preset("papr")
    for wrong in (lambda: make_agent("ppo", LAYOUT, 1), lambda: preset("paper", "ppo")):
        with pytest.raises(UnknownNameError, match="no agent 'ppo'; choose one of sac, td3, .*, cql, td3bc, random"):
            wrong()


@pytest.mark.parametrize("name", sorted(PRESETS))
@pytest.mark.parametrize("agent", AGENTS)
def test_every_preset_makes_every_agent(name: str, agent: str) -> None:
    settings = preset(name, agent)
    made = make_agent(agent, LAYOUT, 2, settings)
    assert made.prefill_episodes == (0 if agent == "random" else settings.prefill_episodes)


OF_ALL = [
    {"learning_rate": 0.0},
    {"learning_rate": float("inf")},
    {"gamma": float("nan")},
    {"batch_size": 0},
    {"gamma": 1.1},
    {"adam_beta": 1.0},
    {"hidden": ()},
    {"hidden": (8, 0)},
    {"prefill_episodes": -1},
    {"updates_per_step": 0},
    {"actor_delay": 0},
    {"angles": "degrees"},
    {"goals": "none"},
    {"hindsight": -0.1},
    {"hindsight": 0.6, "new_goals": 0.6},
    {"replay_size": 0},
]
OF_ONE = [
    (SACSettings(), {"tau": 0.0}),
    (SACSettings(), {"tau": 2.0}),
    (SACSettings(), {"dropout": -0.1}),
    (SACSettings(), {"dropout": 1.0}),
    (SACSettings(), {"initial_alpha": 0.0}),
    (SACSettings(), {"min_scale": 0.0}),
    (SACSettings(), {"critics": 0}),
    (SACSettings(), {"target_critics": 3}),
    (SACSettings(), {"actor_value": "max"}),
    (SACSettings(), {"precision": "float16"}),
    (TD3Settings(), {"tau": 0.0}),
    (TD3Settings(), {"exploration_noise": -0.1}),
    (TD3Settings(), {"target_noise": -0.1}),
    (TD3Settings(), {"target_noise_limit": 0.0}),
    (CrossQSettings(), {"momentum": 0.0}),
    (CrossQSettings(), {"initial_alpha": 0.0}),
    (BCSettings(), {"dropout": 1.0}),
    (IQLSettings(), {"tau": 0.0}),
    (IQLSettings(), {"expectile": 1.0}),
    (IQLSettings(), {"temperature": -1.0}),
    (CQLSettings(), {"min_q_weight": -1.0}),
    (CQLSettings(), {"sampled_actions": 0}),
    (CQLSettings(), {"drawn_actions": -1}),
    (CQLSettings(), {"imitation_updates": -1}),
    (CQLSettings(), {"initial_alpha": 0.0}),
    (TD3BCSettings(), {"value_weight": 0.0}),
]


@pytest.mark.parametrize(
    ("settings", "change"),
    [(settings, change) for settings in (SACSettings(), TD3Settings(), CrossQSettings()) for change in OF_ALL] + OF_ONE,
)
def test_impossible_settings_are_refused(settings: SACSettings, change: dict[str, object]) -> None:
    with pytest.raises(DescriptionError, match=next(iter(change))):
        replace(settings, **change)  # type: ignore[arg-type]


def test_presets_and_config_load_nothing_heavy() -> None:
    code = (
        "import sys, bricksrl.agents, bricksrl.training, bricksrl.evaluation\n"
        "sys.exit(any(name in sys.modules for name in ('torch', 'matplotlib', 'mujoco', 'pyarrow')))"
    )
    subprocess.run([sys.executable, "-c", code], check=True, timeout=60)
