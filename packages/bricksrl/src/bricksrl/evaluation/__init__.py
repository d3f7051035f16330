"""Evaluation of trained agents. Importing this loads no torch."""

import importlib
from typing import TYPE_CHECKING, Any

from bricksrl.evaluation.statistics import Interval

if TYPE_CHECKING:
    from bricksrl.evaluation.evaluator import EvaluationResult as EvaluationResult
    from bricksrl.evaluation.evaluator import evaluate as evaluate

__all__ = ["EvaluationResult", "Interval", "evaluate"]


def __getattr__(name: str) -> Any:
    if name not in __all__:
        raise AttributeError(f"module 'bricksrl.evaluation' has no attribute '{name}'")
    return getattr(importlib.import_module("bricksrl.evaluation.evaluator"), name)
