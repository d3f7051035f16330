"""BricksRL: reinforcement learning on LEGO robots that run Pybricks.

The public names load what they need when they are first used, so that ``import bricksrl`` and ``bricksrl --help`` take no time.
Whoever imports Gymnasium too, before or after, finds our environments there as ``bricksrl/<id>``;
``gymnasium.make("bricksrl:bricksrl/<id>")`` imports this package by itself.
"""

from __future__ import annotations

import importlib
import importlib.util
import sys
from importlib.abc import MetaPathFinder
from typing import TYPE_CHECKING, Any

if TYPE_CHECKING:
    from collections.abc import Sequence
    from importlib.machinery import ModuleSpec
    from types import ModuleType

    from bricksrl import robots as robots
    from bricksrl.envs import list_envs as list_envs
    from bricksrl.envs import make as make
    from bricksrl.envs import register as register
    from bricksrl.evaluation import evaluate as evaluate
    from bricksrl.training import TrainConfig as TrainConfig
    from bricksrl.training import train as train

__version__ = "0.1.0"
__all__ = ["TrainConfig", "__version__", "evaluate", "list_envs", "make", "register", "robots", "train"]

_HOME = {
    "TrainConfig": "bricksrl.training",
    "evaluate": "bricksrl.evaluation",
    "list_envs": "bricksrl.envs",
    "make": "bricksrl.envs",
    "register": "bricksrl.envs",
    "train": "bricksrl.training",
}
_PACKAGES = ("agents", "envs", "evaluation", "robots", "training")


def __getattr__(name: str) -> Any:
    if name in _HOME:
        return getattr(importlib.import_module(_HOME[name]), name)
    if name in _PACKAGES:
        return importlib.import_module(f"bricksrl.{name}")
    raise AttributeError(f"module 'bricksrl' has no attribute '{name}'")


class _OfferToGymnasium(MetaPathFinder):
    """Loads our environments, which registers them, right after Gymnasium; so that nobody else pays for importing it."""

    def find_spec(self, name: str, path: Sequence[str] | None, target: ModuleType | None = None) -> ModuleSpec | None:
        if name != "gymnasium":
            return None
        sys.meta_path.remove(self)
        spec = importlib.util.find_spec(name)
        if spec is not None and spec.loader is not None:
            execute = spec.loader.exec_module

            def execute_and_offer(module: ModuleType) -> None:
                execute(module)
                importlib.import_module("bricksrl.envs")

            spec.loader.exec_module = execute_and_offer  # type: ignore[method-assign]
        return spec


if "gymnasium" in sys.modules:
    importlib.import_module("bricksrl.envs")
else:
    sys.meta_path.insert(0, _OfferToGymnasium())
