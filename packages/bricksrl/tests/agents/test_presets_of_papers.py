"""Presets "paper": what the papers of the algorithms and of BricksRL state."""

from __future__ import annotations

from typing import Any

import pytest

from bricksrl.agents import preset

NETWORKS = {
    "hidden": (256, 256),
    "learning_rate": 3e-4,
    "batch_size": 256,
    "encoder": "convolutions",
    "angles": "raw",
    "goals": "plain",
    "adam_beta": 0.9,
}
"""Of the BricksRL paper: two layers of 256 units, Adam at 3e-4, batches of 256; raw numbers."""
REPLAY = {
    "gamma": 0.99,
    "prefill_episodes": 10,
    "updates_per_step": 1.0,
    "n_step": 1,
    "buffer_size": 1_000_000,
    "hindsight": 0.0,
    "new_goals": 0.0,
    "mirror": False,
    "scale_rewards": False,
}
"""Nothing is relabelled, mirrored or scaled."""
TARGETS = {"tau": 0.005, "critic_norm": "none"}
SAC = {**NETWORKS, **REPLAY, **TARGETS, "alpha_init": 1.0, "target_entropy": -1.0, "num_qs": 2}
TD3 = {**NETWORKS, **REPLAY, **TARGETS, "exploration_noise": 0.1, "target_noise": 0.2}
"""Fujimoto et al., 2018: noise of 0.1 and 0.2, clipped at 0.5, the actor every second update."""


@pytest.mark.parametrize(
    ("agent", "stated"),
    [
        ("sac", {**SAC, "actor_delay": 1, "dropout": 0.0, "actor_q": "min", "num_min_qs": 2}),
        # Hiraoka et al., 2022: dropout of 0.01, layer norm, 20 updates a step; as released, its
        # actor too.
        (
            "droq",
            {
                **SAC,
                "critic_norm": "layer",
                "actor_norm": "layer",
                "dropout": 0.01,
                "actor_dropout": 0.01,
                "updates_per_step": 20.0,
                "actor_delay": 1,
                "actor_q": "mean",
            },
        ),
        # Chen et al., 2021: ten critics, targets of two of them, 20 updates a step.
        (
            "redq",
            {
                **SAC,
                "num_qs": 10,
                "num_min_qs": 2,
                "dropout": 0.0,
                "updates_per_step": 20.0,
                "actor_delay": 20,
                "actor_q": "mean",
            },
        ),
        ("td3", {**TD3, "target_noise_clip": 0.5, "actor_delay": 2, "start_value": False}),
        # Fujimoto and Gu, 2021: the value has a weight of 2.5.
        ("td3bc", {**TD3, "target_noise_clip": 0.5, "actor_delay": 2, "value_weight": 2.5}),
        # Bhatt et al., 2024: a rate of 1e-3, a momentum of 0.01, Adam's beta 0.5, a delay of 3.
        (
            "crossq",
            {
                **NETWORKS,
                **REPLAY,
                "learning_rate": 1e-3,
                "adam_beta": 0.5,
                "momentum": 0.01,
                "actor_delay": 3,
                "alpha_init": 1.0,
            },
        ),
        # Kuznetsov et al., 2020: 25 quantiles a critic, of which two are left out.
        (
            "tqc",
            {**NETWORKS, **REPLAY, **TARGETS, "quantiles": 25, "dropped": 2, "alpha_init": 1.0},
        ),
        # Kumar et al., 2020: ten sampled actions of each kind, a threshold of 5.
        ("cql", {**SAC, "sampled_actions": 10, "lagrange_threshold": 5.0, "min_q_weight": 1.0}),
        ("iql", {**NETWORKS, **REPLAY, **TARGETS, "actor_delay": 1}),
        # Schulman et al., 2017, table 3.
        (
            "ppo",
            {
                "hidden": (64, 64),
                "learning_rate": 3e-4,
                "steps": 2048,
                "passes": 10,
                "batch_size": 64,
                "gamma": 0.99,
                "gae_lambda": 0.95,
                "clip_epsilon": 0.2,
                "entropy_coeff": 0.0,
            },
        ),
        # Zhao et al., 2023, table 3 of the appendix; the weight of the ensemble from their code.
        (
            "act",
            {
                "learning_rate": 1e-5,
                "batch_size": 8,
                "encoder_layers": 4,
                "decoder_layers": 7,
                "feedforward": 3200,
                "width": 512,
                "heads": 8,
                "chunk": 100,
                "kl_weight": 10.0,
                "dropout": 0.1,
                "ensemble": 0.01,
                "executed": 1,
                "latent": 32,
                "weight_decay": 1e-4,
                "updates_per_step": 1.0,
            },
        ),
        ("diffusion", {**NETWORKS, "updates_per_step": 1.0}),
        ("bc", {**NETWORKS, "updates_per_step": 1.0}),
    ],
)
def test_preset_has_what_the_paper_states(agent: str, stated: dict[str, Any]) -> None:
    settings = preset("paper", agent)
    assert {name: getattr(settings, name) for name in stated} == stated


@pytest.mark.parametrize("agent", ["sac", "droq", "redq", "td3", "td3bc", "crossq", "tqc", "cql"])
def test_images_are_learned_with_small_networks_and_memories(agent: str) -> None:
    settings = preset("default", agent, images=True)
    assert settings.hidden == (128, 128) and settings.batch_size == 64
    assert settings.buffer_size == 15_000, "so many images fit into memory"
    assert settings.gamma < preset("default", agent).gamma, "few steps are looked ahead"
    assert settings.prefill_episodes > preset("default", agent).prefill_episodes
