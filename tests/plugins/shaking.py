"""Shaken starts: each body starts 1e-9 off, and each network's first weights are 1e-7 off, by a
seed.

The last digit differs between processors, and chaos makes it the first. What holds on one processor
by luck does not hold under a shake. Modules are changed as they are imported, and the library knows
nothing about it. Processes that tests start are shaken too, as they inherit the environment:
``child/sitecustomize.py`` is the first thing that they run.

What is drawn depends on the seed and the size alone, so that what is equal in a program stays
equal, bit for bit.
"""

from __future__ import annotations

import functools
import os
import sys
from collections.abc import Callable
from importlib.abc import Loader
from importlib.machinery import ModuleSpec, PathFinder
from pathlib import Path
from types import ModuleType
from typing import Any

SEED = "BRICKS_TESTS_SHAKE"
"""Environment variable with the seed."""
MET = "BRICKS_TESTS_SHAKE_MET"
"""Environment variable with a file that gets a byte with each thing that is shaken."""
BODY_OFF = 1e-9
"""Of each coordinate of a body at the start: metres, radians, and parts of a quaternion."""
WEIGHT_OFF = 1e-7
"""Of each first weight: a few units in the last place of a float32 between 0.1 and 1."""
CHILD = Path(__file__).parent / "child"


def shake_everything() -> None:
    """Change the modules below, or do so when they are imported, here and in processes that are
    started from here. A process that was begun shaken is not shaken once more."""
    if any(isinstance(finder, _Finder) for finder in sys.meta_path):
        return
    for name, change in CHANGED.items():
        if name in sys.modules:
            change(sys.modules[name])
    sys.meta_path.insert(0, _Finder())
    paths = os.environ.get("PYTHONPATH", "").split(os.pathsep)
    if str(CHILD) not in paths:
        os.environ["PYTHONPATH"] = os.pathsep.join([str(CHILD), *filter(None, paths)])


def _shake_bodies(module: ModuleType) -> None:
    settle = module.settle

    @functools.wraps(settle)
    def shaken(engine: Any, robots: Any) -> None:
        import numpy as np

        settle(engine, robots)
        count = len(engine.qpos)
        off = np.random.default_rng([_seed(), count]).uniform(-1.0, 1.0, count)
        for address, share in enumerate(off.tolist()):
            engine.qpos[address] += BODY_OFF * share
        engine.forward()
        _say_met()

    module.settle = shaken  # type: ignore[attr-defined]


def _shake_weights(module: ModuleType) -> None:
    for name in dir(module):
        if name.endswith("_") and not name.startswith("_"):
            setattr(module, name, _shaken_weights(getattr(module, name)))


def _shaken_weights(fill: Callable[..., Any]) -> Callable[..., Any]:
    @functools.wraps(fill)
    def shaken(tensor: Any, *args: Any, **kwargs: Any) -> Any:
        import torch

        filled = fill(tensor, *args, **kwargs)
        if (
            isinstance(tensor, torch.nn.Parameter)
            and tensor.is_floating_point()
            and not tensor.is_meta
        ):
            generator = torch.Generator().manual_seed(1000 * _seed() + tensor.numel() % 1000)
            off = 2.0 * torch.rand(tensor.shape, generator=generator) - 1.0
            with torch.no_grad():
                tensor += WEIGHT_OFF * off.to(tensor)
            _say_met()
        return filled

    return shaken


def _shake_starts(module: ModuleType) -> None:
    module.settle = sys.modules["bricktwin.twin.settling"].settle  # type: ignore[attr-defined]


CHANGED = {
    "bricktwin.twin.settling": _shake_bodies,
    "bricktwin.twin.standing": _shake_starts,
    "bricktwin.twin.arena": _shake_starts,
    "torch.nn.init": _shake_weights,
}


class _Finder(PathFinder):
    """Finder that changes modules after they are executed."""

    def find_spec(self, name: str, path: Any = None, target: Any = None) -> ModuleSpec | None:  # type: ignore[override]
        if name not in CHANGED:
            return None
        spec = PathFinder.find_spec(name, path, target)
        if spec is not None and spec.loader is not None:
            spec.loader = _Loader(spec.loader, CHANGED[name])
        return spec


class _Loader(Loader):
    def __init__(self, loader: Loader, change: Callable[[ModuleType], None]) -> None:
        self._loader, self._change = loader, change

    def __getattr__(self, name: str) -> Any:
        return getattr(self._loader, name)

    def create_module(self, spec: ModuleSpec) -> ModuleType | None:
        return self._loader.create_module(spec)

    def exec_module(self, module: ModuleType) -> None:
        self._loader.exec_module(module)
        self._change(module)


def _seed() -> int:
    return _SEED


def _say_met() -> None:
    if _MET:
        # a method of Path opens it no faster, and tests replace those
        with open(_MET, "ab") as file:  # noqa: PTH123
            file.write(b".")


# Tests change the environment of the processes that they fork.
_SEED = int(os.environ.get(SEED, "0"))
_MET = os.environ.get(MET, "")
