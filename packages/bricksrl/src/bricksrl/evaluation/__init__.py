"""Evaluation of trained agents. Importing this loads no torch."""

from __future__ import annotations

from bricksrl.evaluation.evaluator import EvaluationResult, evaluate
from bricksrl.evaluation.statistics import Interval

__all__ = ["EvaluationResult", "Interval", "evaluate"]
