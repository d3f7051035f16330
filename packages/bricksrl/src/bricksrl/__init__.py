"""BricksRL: reinforcement learning on LEGO robots that run Pybricks.

The public names load what they need when they are first used, so that ``import bricksrl`` and
``bricksrl --help`` take no time. If Gymnasium is imported too, before or after, the environments
are registered there as ``bricksrl/<id>``; ``gymnasium.make("bricksrl:bricksrl/<id>")`` imports this
package by itself.
"""

from __future__ import annotations

import os
import sys

TYPE_CHECKING = False  # importing it from typing takes longer than all the rest here
if TYPE_CHECKING:
    from collections.abc import Sequence
    from importlib.machinery import ModuleSpec
    from types import ModuleType
    from typing import Any

    from bricksrl import robots as robots
    from bricksrl.envs import list_envs as list_envs
    from bricksrl.envs import make as make
    from bricksrl.envs import register as register
    from bricksrl.envs.arenas import make_arena as make_arena
    from bricksrl.evaluation import evaluate as evaluate
    from bricksrl.policies import load_policy as load_policy
    from bricksrl.training import TrainConfig as TrainConfig
    from bricksrl.training import train as train

__version__ = "0.1.0"
__all__ = [
    "TrainConfig",
    "__version__",
    "evaluate",
    "list_envs",
    "load_policy",
    "make",
    "make_arena",
    "register",
    "robots",
    "train",
]

_MODULES = {
    "TrainConfig": "bricksrl.training",
    "evaluate": "bricksrl.evaluation",
    "list_envs": "bricksrl.envs",
    "load_policy": "bricksrl.policies",
    "make": "bricksrl.envs",
    "make_arena": "bricksrl.envs.arenas",
    "register": "bricksrl.envs",
    "train": "bricksrl.training",
}
_PACKAGES = ("agents", "envs", "evaluation", "policies", "robots", "training")


def __getattr__(name: str) -> Any:
    import importlib

    if name in _MODULES:
        return getattr(importlib.import_module(_MODULES[name]), name)
    if name in _PACKAGES:
        return importlib.import_module(f"bricksrl.{name}")
    raise AttributeError(f"module 'bricksrl' has no attribute '{name}'")


class _GymnasiumHook:
    """Import hook that registers the environments right after an import of Gymnasium, which is not
    imported otherwise."""

    def find_spec(
        self,
        name: str,
        path: Sequence[str] | None,
        target: ModuleType | None = None,
    ) -> ModuleSpec | None:
        if name != "gymnasium":
            return None
        from importlib import util

        sys.meta_path.remove(self)  # so that only the other finders search
        try:
            spec = util.find_spec(name)
        finally:
            sys.meta_path.insert(0, self)
        # a mere test whether Gymnasium is installed does not load it
        if spec is not None and spec.loader is not None:
            execute = spec.loader.exec_module

            def execute_and_register(module: ModuleType) -> None:
                import importlib

                execute(module)
                sys.meta_path.remove(self)
                importlib.import_module("bricksrl.envs.registry").register_with_gymnasium()

            spec.loader.exec_module = execute_and_register  # type: ignore[method-assign]
        return spec


class _GraphicsHook:
    """Import hook that tries MuJoCo before TorchRL imports it: a graphics library that does not
    work costs pictures only."""

    def find_spec(
        self,
        name: str,
        path: Sequence[str] | None,
        target: ModuleType | None = None,
    ) -> None:
        if name == "torchrl":
            from bricktwin.twin.make_body import check_mujoco

            sys.meta_path.remove(self)
            check_mujoco()


if os.environ.get("MUJOCO_GL", "disable") != "disable" and "torchrl" not in sys.modules:
    sys.meta_path.insert(0, _GraphicsHook())
if "gymnasium" in sys.modules:
    import importlib

    importlib.import_module("bricksrl.envs.registry").register_with_gymnasium()
else:
    sys.meta_path.insert(0, _GymnasiumHook())
