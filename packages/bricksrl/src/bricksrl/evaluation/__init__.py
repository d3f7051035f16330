"""Evaluation of trained agents."""

from bricksrl.evaluation.evaluator import EvaluationResult, evaluate
from bricksrl.evaluation.statistics import Interval

__all__ = ["EvaluationResult", "Interval", "evaluate"]
