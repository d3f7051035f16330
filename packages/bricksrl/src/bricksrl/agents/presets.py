"""Presets: named values of settings; other settings keep their defaults.

``default`` is tuned for few robot steps. ``paper`` has the values of the BricksRL paper, and those of an algorithm's authors
(with the paper's networks) for what the paper does not state.
"""

from __future__ import annotations

from dataclasses import fields
from typing import Any

_DROQ: dict[str, Any] = {"dropout": 0.01, "updates_per_step": 20.0, "actor_delay": 20, "actor_q": "mean"}
_REDQ: dict[str, Any] = {**_DROQ, "critic_layer_norm": False, "dropout": 0.0, "num_qs": 10}
_DEFAULT_BY_AGENT: dict[str, dict[str, Any]] = {"droq": {**_DROQ, "alpha_init": 0.2}, "redq": {**_REDQ, "alpha_init": 0.2}}

_IMAGES: dict[str, Any] = {
    "hidden": (128, 128),
    "batch_size": 64,
    "gamma": 0.9,
    "updates_per_step": 1.0,
    "prefill_episodes": 5,
    "angles": "sincos",
    "goals": "plain",
    "buffer_size": 15_000,
    "tau": 0.01,
    "learning_rate": 1e-3,
    "alpha_init": 0.1,
}
"""Tuned for few robot steps from images, on one processor core."""

_PAPER: dict[str, Any] = {
    "hidden": (256, 256),
    "learning_rate": 3e-4,
    "batch_size": 256,
    "gamma": 0.99,
    "updates_per_step": 1.0,
    "prefill_episodes": 10,
    "alpha_init": 1.0,
    "tau": 0.005,
    "critic_layer_norm": False,
    "start_value": False,
    "exploration_noise": 0.1,
    "target_noise": 0.2,
    "angles": "raw",
    "goals": "plain",
    "hindsight": 0.0,
    "new_goals": 0.0,
    "encoder": "convolutions",
}
_PAPER_BY_AGENT: dict[str, dict[str, Any]] = {
    "droq": {**_DROQ, "critic_layer_norm": True},
    "redq": _REDQ,
    "crossq": {"learning_rate": 1e-3, "momentum": 0.01},
    "iql": {"expectile": 0.5, "temperature": 1.0},
    "cql": {"lagrange_threshold": 5.0, "imitation_updates": 1000},
    # Zhao et al. 2023, appendix; ensemble, latent size and weight decay from their released code
    "act": {
        "learning_rate": 1e-5,
        "batch_size": 8,
        "chunk": 100,
        "executed": 1,
        "ensemble": 0.01,
        "width": 512,
        "feedforward": 3200,
        "heads": 8,
        "encoder_layers": 4,
        "decoder_layers": 7,
        "dropout": 0.1,
        "latent": 32,
        "kl_weight": 10.0,
        "weight_decay": 1e-4,
    },
    # Schulman et al. 2017, table of the continuous control tasks
    "ppo": {"hidden": (64, 64), "steps": 2048, "batch_size": 64, "passes": 10, "gae_lambda": 0.95, "entropy_coeff": 0.0},
}


def values(name: str, agent: str, settings: type[Any], *, images: bool) -> dict[str, Any]:
    """Values of a preset for an algorithm with this class of settings."""
    if name == "paper":
        preset = {**_PAPER, **_PAPER_BY_AGENT.get(agent, {})}
    else:
        preset = {**(_IMAGES if images else {}), **_DEFAULT_BY_AGENT.get(agent, {})}
    known = {field.name for field in fields(settings)}
    return {key: value for key, value in preset.items() if key in known}
