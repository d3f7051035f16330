"""Agents: algorithms by name or from a user's file, settings, presets. Importing this loads no
torch."""

from __future__ import annotations

import importlib
import inspect
from dataclasses import MISSING, dataclass, fields, is_dataclass
from typing import TYPE_CHECKING, Any

from brickhub.user_files import calling, is_reference, load_object
from bricksrl.errors import DescriptionError, UnknownNameError, hint

if TYPE_CHECKING:
    from collections.abc import Callable

    from torchrl.envs import EnvBase

    from bricksrl.agents.learner import Learner
    from bricksrl.agents.settings import Presets

AGENTS = (
    "sac",
    "droq",
    "redq",
    "td3",
    "crossq",
    "tqc",
    "ppo",
    "bc",
    "act",
    "diffusion",
    "iql",
    "cql",
    "td3bc",
    "gait",
    "random",
)
"""Algorithms by name; DroQ and REDQ are settings of SAC."""
_MODULES = {
    "droq": "sac",
    "redq": "sac",
    "gait": "search.gait",
    **{name: f"offline.{name}" for name in ("bc", "act", "diffusion", "iql", "cql", "td3bc")},
}
"""Modules of algorithms, where they have other names or a room of their own."""
PRESETS = ("default", "paper")
"""Presets by name: "default" is tuned for few robot steps; "paper" has the values of the BricksRL
paper, and those of an algorithm's authors (with the paper's networks) for what the paper does not
state. Other settings keep their defaults."""


@dataclass(frozen=True)
class Algorithm:
    """An algorithm: its settings, a frozen dataclass, the function that builds its `Learner`, and
    its presets; a user's has none."""

    name: str
    settings: type[Any]
    build: Callable[..., Learner]
    presets: Presets | None = None


def check_agent(agent: str) -> None:
    """Raise UnknownNameError if there is no algorithm of that name; a user's file is looked at when
    it is loaded."""
    if not is_reference(agent) and agent not in AGENTS:
        remedy = (
            f"{hint(agent, AGENTS)}; choose one of {', '.join(AGENTS)}, or give a file: my_agent.py"
        )
        raise UnknownNameError(f"there is no agent '{agent}'{remedy}")


def algorithm(agent: str) -> Algorithm:
    """The algorithm with a name, or in a user's file: a function ``build(env, settings: Settings,
    device)``. Raises UnknownNameError if there is none, DescriptionError if the user's code cannot
    be loaded or ``settings`` has no type."""
    from bricktwin.twin.make_body import check_mujoco

    check_mujoco()  # TorchRL imports it, whatever the agent
    check_agent(agent)
    if is_reference(agent):
        build = load_object(agent, "build")
        module = inspect.getmodule(build)
        presets = None
    else:
        module = importlib.import_module(f"bricksrl.agents.{_MODULES.get(agent, agent)}")
        build = module.build
        presets = module.PRESETS[agent]
    remedy = "write build(env, settings: Settings, device) with a frozen dataclass Settings"
    try:
        settings = inspect.signature(build).parameters["settings"].annotation
    except (KeyError, TypeError, ValueError):
        raise DescriptionError(f"{agent} takes no settings; {remedy}") from None
    # with `from __future__ import annotations` an annotation is its text
    if isinstance(settings, str):
        settings = getattr(module, settings, None)
    if not (isinstance(settings, type) and is_dataclass(settings)):
        raise DescriptionError(f"{agent} has no type for its settings; {remedy}")
    _check_whole(agent, settings)
    return Algorithm(agent, settings, build, presets)


def _check_whole(agent: str, settings: type[Any]) -> None:
    """Raise DescriptionError if settings are only a part of those of an algorithm: networks and
    replay buffer would ask them for what they do not have."""
    from bricksrl.agents.settings import PARTS, OffPolicySettings

    if issubclass(settings, PARTS) and not issubclass(settings, OffPolicySettings):
        part = next(part.__name__ for part in PARTS if issubclass(settings, part))
        raise DescriptionError(
            f"the settings of {agent} are {part} alone, which are a part; write class "
            f"Settings({part}, OffPolicySettings)"
        )


def preset(
    name: str = "default",
    agent: str = "sac",
    *,
    images: bool = False,
) -> Any:
    """Settings of a preset for an algorithm; ``images``: for a camera. Raises UnknownNameError if
    there is no such name."""
    if name not in PRESETS:
        raise UnknownNameError(f"there is no preset '{name}'; choose one of {', '.join(PRESETS)}")
    chosen = algorithm(agent)
    if chosen.presets is None:
        if name != "default":
            raise UnknownNameError(f"{agent} has no preset '{name}'; it has its own defaults")
        missing = [
            field.name
            for field in fields(chosen.settings)
            if field.init and field.default is field.default_factory is MISSING
        ]
        if missing:
            raise DescriptionError(
                f"the settings of {agent} have no default for {', '.join(missing)}; give it one"
            )
        return chosen.settings()
    if name == "paper":
        return chosen.presets.paper
    return chosen.presets.images if images else chosen.presets.default


def make_learner(
    agent: str,
    env: EnvBase,
    settings: Any = None,
    device: str = "cpu",
) -> Learner:
    """A new learner for an environment, on a device, with the ``settings`` or those of the preset
    "default". Initialized from torch's global generator. From here on running statistics among the
    transforms of ``env`` leave angles, goals and entries with a range in their units, see
    `bricksrl.envs.transforms.KeepUnits`. Raises UnknownNameError if there is no such algorithm,
    DescriptionError if the settings are of another algorithm or do not suit the environment, or a
    user's code raised."""
    from bricksrl.agents.learner import Learner
    from bricksrl.agents.replay.augmentation import augmentations
    from bricksrl.agents.replay.replay_learner import ReplayLearner
    from bricksrl.agents.settings import OffPolicySettings
    from bricksrl.envs.transforms import layout_of, prepare, with_unit_actions

    chosen = algorithm(agent)
    if with_unit_actions(env) is not env:
        raise DescriptionError(
            "the actions have another range than -1..1; give TransformedEnv(env, ActionScaling())"
        )
    prepare(env)
    images = bool(layout_of(env).images)
    if settings is None:
        settings = preset("default", agent, images=images)
    if is_reference(agent) and type(settings).__name__ == chosen.settings.__name__:
        # the user's file was reloaded, and its class with it
        settings = chosen.settings(**vars(settings))
    if not isinstance(settings, chosen.settings):
        actual = type(settings).__name__
        raise DescriptionError(
            f"{agent} has {chosen.settings.__name__}, not {actual}; see preset('default', "
            f"'{agent}')"
        )
    # also of ours that has a network of the user's, which is made in there
    is_of_user = is_reference(agent) or bool(vars(settings).get("network"))
    with calling(agent, "cannot be built", is_of_user=is_of_user):
        learner = chosen.build(env, settings, device)
    if not isinstance(learner, Learner):
        raise DescriptionError(
            f"{agent} builds a {type(learner).__name__}; let it return a "
            "bricksrl.agents.learner.Learner"
        )
    if isinstance(settings, OffPolicySettings) and isinstance(learner, ReplayLearner):
        for transform in augmentations(env, settings):
            learner.memory.append_transform(transform)
    return learner


__all__ = ["AGENTS", "PRESETS", "Algorithm", "algorithm", "is_reference", "make_learner", "preset"]
