"""Transforms between an environment and its agent: what they do to each number, what they hide,
what they keep."""

from bricksrl.envs.transforms.chain import base_of, transforms_of
from bricksrl.envs.transforms.effect import (
    changes_nothing,
    keeps_actions,
    keeps_vectors,
    runs_on,
    steps_of,
)
from bricksrl.envs.transforms.frame_skip import FrameSkip
from bricksrl.envs.transforms.keep_units import KeepUnits
from bricksrl.envs.transforms.layout import layout_of, numbers_of
from bricksrl.envs.transforms.own_steps import Tap, own_frames, own_state
from bricksrl.envs.transforms.playback import Playback, over, still
from bricksrl.envs.transforms.prepare import prepare, transformed, with_unit_actions
from bricksrl.envs.transforms.recorded import through
from bricksrl.envs.transforms.state import load_transform_state, transform_state, unaffected

__all__ = [
    "FrameSkip",
    "KeepUnits",
    "Playback",
    "Tap",
    "base_of",
    "changes_nothing",
    "keeps_actions",
    "keeps_vectors",
    "layout_of",
    "load_transform_state",
    "numbers_of",
    "over",
    "own_frames",
    "own_state",
    "prepare",
    "runs_on",
    "steps_of",
    "still",
    "through",
    "transform_state",
    "transformed",
    "transforms_of",
    "unaffected",
    "with_unit_actions",
]
