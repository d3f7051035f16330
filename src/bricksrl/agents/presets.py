"""Settings of the agents, and the tuned ones by name. Plain data: importing this loads no torch."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, fields, replace
from typing import Literal, TypeAlias

from bricksrl.agents.image_presets import IMAGE_PRESETS, ImageSACSettings, ImageTD3Settings
from bricksrl.agents.settings import (
    ActorSettings,
    EntropySettings,
    LayerSettings,
    LearnerSettings,
    NoiseSettings,
    ReplaySettings,
    TargetSettings,
)
from bricksrl.errors import DescriptionError, UnknownNameError


@dataclass(frozen=True)
class OffPolicySettings(ReplaySettings, LayerSettings, LearnerSettings):
    """What all agents have in common that learn values from a replay buffer, without images."""

    hindsight: float = 0.3
    """In a task with goals: share of each batch that pretends to have aimed at what was reached a few steps later."""
    new_goals: float = 0.3
    """In a task with goals: share of each batch that gets goals drawn anew from their range."""

    def __post_init__(self) -> None:
        super().__post_init__()
        self._share("hindsight", "new_goals")
        if self.hindsight + self.new_goals > 1:
            raise DescriptionError(f"hindsight and new_goals add up to {self.hindsight + self.new_goals}; give shares of up to 1")


@dataclass(frozen=True)
class LeanSettings(OffPolicySettings):
    """What the agents have in common whose gradients are written by hand."""

    precision: Literal["float32", "bfloat16"] = "float32"
    """What the networks compute in while they learn: bfloat16 is coarser, and quicker on a processor that has it."""

    def __post_init__(self) -> None:
        super().__post_init__()
        self._one_of("precision", "float32", "bfloat16")


@dataclass(frozen=True)
class SACSettings(ActorSettings, EntropySettings, TargetSettings, LeanSettings):
    """Soft actor-critic, and with other numbers DroQ and REDQ."""

    dropout: float = 0.0
    """Dropout rate in the critics."""
    critics: int = 2
    """Critics that learn side by side."""
    target_critics: int = 2
    """Critics, drawn anew for each update, whose least value is the target."""
    actor_value: Literal["min", "mean"] = "min"
    """What the actor climbs: the least or the mean value of the critics."""

    def __post_init__(self) -> None:
        super().__post_init__()
        self._above_zero("critics", "target_critics")
        self._share("dropout")
        if self.dropout == 1:
            raise DescriptionError("dropout is 1, which leaves nothing; give a number below 1")
        if self.target_critics > self.critics:
            raise DescriptionError(f"target_critics is {self.target_critics}; there are only {self.critics} critics")
        self._one_of("actor_value", "min", "mean")


@dataclass(frozen=True)
class TD3Settings(ActorSettings, NoiseSettings, TargetSettings, LeanSettings):
    """Twin delayed deep deterministic policy gradient; the targets learn when the actor does."""

    learning_rate: float = 5e-4
    updates_per_step: int = 4
    actor_delay: int = 2


@dataclass(frozen=True)
class CrossQSettings(EntropySettings, LeanSettings):
    """CrossQ: batch normalisation in place of target networks."""

    adam_beta: float = 0.5
    actor_delay: int = 3
    initial_alpha: float = 0.1
    momentum: float = 0.01
    """Share of a batch in the running statistics that normalise when the agent acts."""

    def __post_init__(self) -> None:
        super().__post_init__()
        self._above_zero("momentum")
        self._share("momentum")


@dataclass(frozen=True)
class BCSettings(LayerSettings, LearnerSettings):
    """Behaviour cloning: do as the dataset does. It learns from nothing else."""

    layer_norm: bool = True
    """Layer normalisation in the actor."""
    dropout: float = 0.01
    """Dropout rate in the actor while it learns."""

    def __post_init__(self) -> None:
        super().__post_init__()
        if not 0 <= self.dropout < 1:
            raise DescriptionError(f"dropout is {self.dropout}; give a number from 0 to below 1")


@dataclass(frozen=True)
class ACTSettings(LearnerSettings):
    """Action chunking with transformers: do as the dataset does over several steps. It learns from nothing else."""

    learning_rate: float = 5e-4
    batch_size: int = 32
    chunk: int = 8
    """Actions that are predicted at once, one a step."""
    executed: int = 1
    """Steps after which the next chunk is predicted."""
    ensemble: float | None = 0.01
    """Chunks that overlap are averaged, the older ones with the more weight the larger this is; ``None`` takes the newest."""
    width: int = 64
    """Numbers in a token of the transformers."""
    feedforward: int = 128
    """Units between two tokens in each layer."""
    heads: int = 4
    """Heads of attention; the width is shared among them."""
    encoder_layers: int = 1
    """Layers that look at the observation, and as many that read what was done."""
    decoder_layers: int = 1
    """Layers that make the chunk."""
    dropout: float = 0.1
    """Dropout rate in the transformers while they learn."""
    latent: int = 8
    """Numbers that tell apart what was meant where the same was seen; 0 learns without them."""
    kl_weight: float = 10.0
    """Weight of what these numbers tell."""
    weight_decay: float = 1e-4
    """Share of the weights, times the step size, that each step takes off them."""

    def __post_init__(self) -> None:
        super().__post_init__()
        self._above_zero("chunk", "executed", "width", "feedforward", "heads", "encoder_layers", "decoder_layers")
        self._zero_or_more("latent", "kl_weight", "weight_decay", *(() if self.ensemble is None else ("ensemble",)))
        if not 0 <= self.dropout < 1:
            raise DescriptionError(f"dropout is {self.dropout}; give a number from 0 to below 1")
        if self.executed > self.chunk:
            raise DescriptionError(f"executed is {self.executed}; a chunk has only {self.chunk} actions")
        if self.width % self.heads:
            raise DescriptionError(f"heads is {self.heads}, which does not divide the width {self.width}; choose another")


@dataclass(frozen=True)
class IQLSettings(TargetSettings, OffPolicySettings):
    """Implicit Q-learning: values of actions that the data has, and the better of them imitated."""

    expectile: float = 0.8
    """Where between the worst (0) and the best (1) action of the data the value of a state lies; 0.5 is the mean."""
    temperature: float = 3.0
    """How much an action's advantage counts when it is imitated; 0 imitates all alike."""
    new_goals: float = 0.0
    """As for other agents; none, because what was done for one goal is no example for another one that is drawn at random."""

    def __post_init__(self) -> None:
        super().__post_init__()
        if not 0 < self.expectile < 1:
            raise DescriptionError(f"expectile is {self.expectile}; give a number between 0 and 1")
        self._zero_or_more("temperature")


@dataclass(frozen=True)
class CQLSettings(SACSettings):
    """Conservative Q-learning: soft actor-critic whose critics are pressed down where the data has no actions."""

    min_q_weight: float = 1.0
    """Weight of the pressure; with a threshold what it is multiplied with is learned too."""
    lagrange_threshold: float | None = None
    """Gap between the values of actions and those of the data that the pressure is learned for; ``None`` for a fixed pressure."""
    sampled_actions: int = 10
    """Actions that are compared with the data's: so many uniform ones, of the policy here, and of the policy a step later."""
    drawn_actions: int = 1
    """Of these, those that an update presses down, drawn as the full gradient weighs them; 0 for the full gradient."""
    imitation_updates: int = 0
    """Updates at the start in which the actor imitates the data."""

    def __post_init__(self) -> None:
        super().__post_init__()
        self._above_zero("sampled_actions")
        self._zero_or_more("min_q_weight", "drawn_actions", "imitation_updates")


@dataclass(frozen=True)
class TD3BCSettings(TD3Settings):
    """TD3 whose actor also imitates the data."""

    value_weight: float = 2.5
    """Weight of the value, scaled to a mean size of 1, against the squared distance from the data's action."""

    def __post_init__(self) -> None:
        super().__post_init__()
        self._above_zero("value_weight")


VectorSettings: TypeAlias = SACSettings | TD3Settings | CrossQSettings | BCSettings | ACTSettings | IQLSettings | CQLSettings
Settings: TypeAlias = VectorSettings | ImageSACSettings | ImageTD3Settings

_PAPER = SACSettings(
    hidden=(256, 256),
    learning_rate=3e-4,
    batch_size=256,
    gamma=0.99,
    updates_per_step=1,
    prefill_episodes=10,
    initial_alpha=1.0,
    layer_norm=False,
    angles="raw",
    goals="plain",
    hindsight=0.0,
    new_goals=0.0,
)
_DROQ = SACSettings(layer_norm=True, dropout=0.01, updates_per_step=20, actor_delay=20, actor_value="mean")
_REDQ = replace(_DROQ, layer_norm=False, dropout=0.0, critics=10)

# Zhao et al. 2023, appendix; the ensemble's number, the latent's size and the weight decay are those of the code they released
_ACT = ACTSettings(
    learning_rate=1e-5,
    batch_size=8,
    updates_per_step=1,
    angles="raw",
    goals="plain",
    chunk=100,
    executed=1,
    ensemble=0.01,
    width=512,
    feedforward=3200,
    heads=8,
    encoder_layers=4,
    decoder_layers=7,
    dropout=0.1,
    latent=32,
    kl_weight=10.0,
    weight_decay=1e-4,
)


def _as_in_the_paper(settings: VectorSettings) -> VectorSettings:
    """The settings with what the paper says about every agent."""
    common = (
        *("hidden", "learning_rate", "batch_size", "gamma", "prefill_episodes"),
        *("angles", "goals", "hindsight", "new_goals", "initial_alpha"),
    )
    names = {field.name for field in fields(settings)}.intersection(common)
    return replace(settings, **{name: getattr(_PAPER, name) for name in names})


_DEFAULT: dict[str, VectorSettings] = {
    "sac": SACSettings(),
    "td3": TD3Settings(),
    "droq": _DROQ,
    "redq": _REDQ,
    "crossq": CrossQSettings(),
    "bc": BCSettings(),
    "act": ACTSettings(),
    "iql": IQLSettings(),
    "cql": CQLSettings(),
    "td3bc": TD3BCSettings(),
}
_AS_PUBLISHED: dict[str, VectorSettings] = {
    "sac": _PAPER,
    "td3": _as_in_the_paper(TD3Settings(updates_per_step=1, layer_norm=False, exploration_noise=0.1, target_noise=0.2)),
    "droq": _as_in_the_paper(_DROQ),
    "redq": _as_in_the_paper(_REDQ),
    "crossq": replace(_as_in_the_paper(CrossQSettings(updates_per_step=1)), learning_rate=1e-3),
    "bc": _as_in_the_paper(BCSettings(updates_per_step=1)),
    "act": _ACT,
    "iql": _as_in_the_paper(IQLSettings(updates_per_step=1, expectile=0.5, temperature=1.0, layer_norm=False)),
    "cql": _as_in_the_paper(
        CQLSettings(updates_per_step=1, layer_norm=False, lagrange_threshold=5.0, imitation_updates=1000),
    ),
    "td3bc": _as_in_the_paper(TD3BCSettings(updates_per_step=1, layer_norm=False, exploration_noise=0.1, target_noise=0.2)),
}
OFFLINE_UPDATES = {
    "RunAway-v0": {"expert": 2000, "random": 2000},
    "Spinning-v0": {"expert": 5000, "random": 5000},
    "Walker-v0": {"expert": 10_000, "random": 10_000},
    "RoboArm-v0": {"expert": 5000, "random": 10_000},
}
"""Updates that the paper made from each of its datasets, by task and kind of dataset."""
PRESETS: dict[str, dict[str, VectorSettings]] = {"default": _DEFAULT, "paper": _AS_PUBLISHED}
"""Settings by name of the preset and of the agent.

``default`` is tuned for few robot steps. ``paper`` has what the BricksRL paper trained with; for REDQ, CrossQ and TD3+BC, which
it does not have, that of their authors (with the paper's networks) where the paper says nothing about every agent; for ACT all
that its authors had.
"""

IMITATORS = ("bc", "act")
"""Agents that learn from a dataset and from nothing else."""
AGENTS = (*_DEFAULT, "random")
"""Agents by name; ``random`` has nothing to set."""


def preset(name: str, agent: str = "sac", *, images: bool = False) -> Settings:
    """The settings of that name for that agent; for "random" those of "sac", of which it uses none.

    Args:
        images: for a task with a camera.

    Raises:
        UnknownNameError: there are none.
    """
    if agent not in AGENTS:
        raise UnknownNameError(f"there is no agent '{agent}'; choose one of {', '.join(AGENTS)}")
    try:
        of_agents: Mapping[str, Settings] = IMAGE_PRESETS[name] if images else PRESETS[name]
    except KeyError:
        raise UnknownNameError(f"there is no preset '{name}'; choose one of {', '.join(sorted(PRESETS))}") from None
    if images and agent not in (*of_agents, "random"):
        raise UnknownNameError(f"{agent} cannot learn from images; choose one of {', '.join(of_agents)}, or random")
    return of_agents.get(agent, of_agents["sac"])
