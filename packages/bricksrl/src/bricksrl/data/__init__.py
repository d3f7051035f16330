"""Datasets of robot episodes: recording, reading, checking, sharing. Importing this loads neither
torch nor Arrow."""

from __future__ import annotations

from typing import TYPE_CHECKING, Any

from bricksrl.data.schema import Description, describe

if TYPE_CHECKING:
    from bricksrl.data.dataset import About as About
    from bricksrl.data.reader import Episodes as Episodes
    from bricksrl.data.reader import load as load
    from bricksrl.data.recorder import Recorder as Recorder
    from bricksrl.data.steps import Step as Step

__all__ = ["About", "Description", "Episodes", "Recorder", "Step", "describe", "load"]

_MODULES = {
    "About": "dataset",
    "Episodes": "reader",
    "Recorder": "recorder",
    "Step": "steps",
    "load": "reader",
}


def __getattr__(name: str) -> Any:
    if name not in _MODULES:
        raise AttributeError(f"module 'bricksrl.data' has no attribute '{name}'")
    import importlib

    return getattr(importlib.import_module(f"bricksrl.data.{_MODULES[name]}"), name)
