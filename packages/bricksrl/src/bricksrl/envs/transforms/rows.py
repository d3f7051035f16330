"""Rows of TorchRL's transforms that keep the meaning of numbers: how each passes them on.

Behind any other transform the numbers that it writes are new: nothing is known of them but their
place. What a transform writes it says itself, in ``out_keys``. TorchRL's own is believed; another
one that overrides how a step is transformed without naming a key may have written everything.
"""

from __future__ import annotations

import math
from collections.abc import Callable
from dataclasses import replace
from math import inf
from typing import Any

import numpy as np
from numpy.typing import NDArray
from torch import Tensor
from torchrl.envs import (
    CatFrames,
    CatTensors,
    DoubleToFloat,
    DTypeCastTransform,
    FlattenObservation,
    ObservationNorm,
    RenameTransform,
    SqueezeTransform,
    Transform,
    UnsqueezeTransform,
    VecNorm,
)
from torchrl.envs.transforms import VecNormV2

from brickhub.entry import Entry
from bricksrl.envs.specs import Number

Array = NDArray[np.object_]
"""Of the shape of a vector's spec: a `Number` in each place, or ``None`` where a transform made a
new one."""
Numbers = dict[Any, Array]
"""Of each vector, by key."""

RUNNING = (VecNorm, VecNormV2)
"""Transforms by running statistics, which can be undone (``denorm``) and frozen."""


def numbers_behind(
    transform: Transform,
    before: Numbers,
    *,
    keeps_units: bool = False,
) -> Numbers:
    """The numbers behind a transform, from those before it. ``keeps_units``: whether `KeepUnits`
    follows running statistics."""
    # Statistics mean what the transform after them makes of them, so they are no plain row.
    if isinstance(transform, RUNNING):
        return _normalised_by_running(transform, before, keeps_units=keeps_units)
    row = _ROWS.get(type(transform))
    if row is not None:
        return row(transform, before)
    written = set(transform.out_keys or ())
    if not written and not _is_believed(transform) and _overrides_steps(transform):
        return {}
    return {key: numbers for key, numbers in before.items() if key not in written}


def has_unit(entry: Entry) -> bool:
    """Whether an entry means something in its own units: an angle, a goal, or what has a range."""
    is_angle_or_goal = entry.wraps or entry.name.endswith(("_goal", "_angle"))
    return is_angle_or_goal or entry.high - entry.low < inf


def _is_believed(transform: Transform) -> bool:
    kind = type(transform)
    house = kind.__module__.partition(".")[0]
    # A function of a user's becomes a transform of a private class of TorchRL's.
    is_private = kind.__name__.startswith("_")
    return house in ("torchrl", "bricksrl") and not is_private


def _overrides_steps(transform: Transform) -> bool:
    """Whether it does more to a step than the base class does, which writes ``out_keys`` alone."""
    kind = type(transform)
    return any(
        getattr(kind, name) is not getattr(Transform, name) for name in ("_call", "_step", "_reset")
    )


def _written(
    before: Numbers,
    out_key: Any,
    numbers: Array | None,
) -> Numbers:
    """The numbers, with one vector written: anew where nothing is known of it."""
    others = {key: kept for key, kept in before.items() if key != out_key}
    return others if numbers is None else {**others, out_key: numbers}


def _each(
    transform: Transform,
    before: Numbers,
    change: Callable[[Any, Array], Array | None],
) -> Numbers:
    """Each vector that a transform reads, changed, as the one that it writes."""
    after = before
    for in_key, out_key in zip(transform.in_keys or (), transform.out_keys or (), strict=True):
        known = before.get(in_key)
        after = _written(after, out_key, None if known is None else change(in_key, known))
    return after


def _same(transform: Transform, before: Numbers) -> Numbers:
    # Rounding to whole numbers or half precision changes a value, not what it means.
    return _each(transform, before, lambda _key, numbers: numbers)


def _renamed(transform: RenameTransform, before: Numbers) -> Numbers:
    after = _each(transform, before, lambda _key, numbers: numbers)
    if transform.create_copy:
        return after
    return {key: numbers for key, numbers in after.items() if key not in transform.in_keys}


def _unsqueezed(transform: UnsqueezeTransform, before: Numbers) -> Numbers:
    def change(_key: Any, numbers: Array) -> Array | None:
        # A dimension counted from the front counts the batch too; nobody needs that of a vector.
        return np.expand_dims(numbers, transform.dim) if transform.dim < 0 else None

    return _each(transform, before, change)


def _squeezed(transform: SqueezeTransform, before: Numbers) -> Numbers:
    def change(_key: Any, numbers: Array) -> Array | None:
        dim = transform.dim
        if dim >= 0 or -dim > numbers.ndim:
            return None
        # TorchRL leaves a dimension that is longer than 1 as it is.
        return np.squeeze(numbers, dim) if numbers.shape[dim] == 1 else numbers

    return _each(transform, before, change)


def _flattened(transform: FlattenObservation, before: Numbers) -> Numbers:
    def change(_key: Any, numbers: Array) -> Array | None:
        first = transform.first_dim
        last = transform.last_dim
        if not -numbers.ndim <= first <= last < 0:
            return None
        outer = numbers.shape[: numbers.ndim + first]
        inner = numbers.shape[numbers.ndim + last + 1 :]
        return numbers.reshape(*outer, -1, *inner)

    return _each(transform, before, change)


def _stacked(transform: CatFrames, before: Numbers) -> Numbers:
    def change(_key: Any, numbers: Array) -> Array | None:
        if -transform.dim > numbers.ndim:
            return None
        # The oldest frame comes first.
        frames = [_earlier(numbers, steps) for steps in reversed(range(transform.N))]
        return np.concatenate(frames, transform.dim)

    return _each(transform, before, change)


def _joined(transform: CatTensors, before: Numbers) -> Numbers:
    out_key = transform.out_keys[0]
    if transform.dim >= 0:  # counted from the front, it counts the batch too
        return _written(before, out_key, None)
    specs = transform.parent.full_observation_spec_unbatched
    parts = [
        # Of new numbers only the shape is known, which the environment before it has.
        before.get(key, np.full(tuple(specs[key].shape), None, dtype=object))
        for key in transform.in_keys
    ]
    return _written(before, out_key, np.concatenate(parts, transform.dim))


def _normalised(transform: ObservationNorm, before: Numbers) -> Numbers:
    def change(_key: Any, numbers: Array) -> Array | None:
        if transform.standard_normal:
            return _standardised(numbers, transform.loc, transform.scale)
        factors = _one_copy(transform.scale, numbers)
        summands = _one_copy(transform.loc, numbers)
        if factors is None or summands is None:
            return None
        return _scaled(numbers, factors, summands)

    return _each(transform, before, change)


def _normalised_by_running(
    transform: VecNorm | VecNormV2,
    before: Numbers,
    *,
    keeps_units: bool,
) -> Numbers:
    def change(key: Any, numbers: Array) -> Array | None:
        if keeps_units:
            return _with_units(numbers)
        if not transform.frozen:
            return None  # what it means changes while an agent learns
        return _standardised(numbers, transform.loc.get(key), transform.scale.get(key))

    return _each(transform, before, change)


def _with_units(numbers: Array) -> Array:
    """Numbers with a unit; those without one are new."""
    kept = numbers.copy()
    for place, number in np.ndenumerate(numbers):
        if number is not None and not has_unit(number.entry):
            kept[place] = None
    return kept


def _earlier(numbers: Array, steps: int) -> Array:
    """The same numbers of an observation some steps before."""
    shifted = numbers.copy()
    for place, number in np.ndenumerate(numbers):
        if number is not None:
            shifted[place] = replace(number, frame=number.frame + steps)
    return shifted


def _standardised(
    numbers: Array,
    mean: Tensor,
    deviation: Tensor,
) -> Array | None:
    """``(number - mean) / deviation``."""
    means = _one_copy(mean, numbers)
    deviations = _one_copy(deviation, numbers)
    if means is None or deviations is None or bool((deviations == 0.0).any()):
        return None
    return _scaled(numbers, 1.0 / deviations, -means / deviations)


def _scaled(
    numbers: Array,
    factors: NDArray[Any],
    summands: NDArray[Any],
) -> Array:
    """``factor * number + summand`` of each; all of one shape."""
    scaled = numbers.copy()
    for place, number in np.ndenumerate(numbers):
        if number is not None:
            factor = float(factors[place])
            scale = factor * number.scale
            offset = factor * number.offset + float(summands[place])
            scaled[place] = replace(number, scale=scale, offset=offset)
    return scaled


def _one_copy(value: Tensor, numbers: Array) -> NDArray[Any] | None:
    """Statistics in the shape of the numbers, of the first of copies that have their own; ``None``
    where they have another shape."""
    # In double precision, as factors of several transforms are multiplied.
    given = value.detach().cpu().double().numpy()
    while given.ndim > numbers.ndim:
        given = given[0]
    try:
        return np.broadcast_to(given, numbers.shape)
    except ValueError:
        return None


_ROWS: dict[type[Transform], Callable[[Any, Numbers], Numbers]] = {
    RenameTransform: _renamed,
    DTypeCastTransform: _same,
    DoubleToFloat: _same,
    UnsqueezeTransform: _unsqueezed,
    SqueezeTransform: _squeezed,
    FlattenObservation: _flattened,
    CatFrames: _stacked,
    CatTensors: _joined,
    ObservationNorm: _normalised,
}
"""Of TorchRL's transforms; a subclass of one may do anything else, so the class itself counts.
Those of rewards, steps, actions and ends, such as ``RewardScaling``, ``StepCounter`` and a frame
skip, need none: they write no vector."""


def as_arrays(vectors: dict[Any, tuple[Entry, ...]], specs: dict[Any, Any]) -> Numbers:
    """The numbers of the environment itself: each is its entry."""
    numbers: Numbers = {}
    for key, entries in vectors.items():
        array = np.empty(len(entries), dtype=object)
        array[:] = [Number(entry) for entry in entries]
        numbers[key] = array.reshape(tuple(specs[key].shape))
    return numbers


def as_list(
    numbers: Array | None,
    shape: tuple[int, ...],
    key: str,
) -> list[Number]:
    """The numbers of a vector in their order; new entries where nothing is known of them."""
    known: list[Number | None] = [None] * math.prod(shape)
    if numbers is not None and numbers.shape == shape:
        known = numbers.ravel().tolist()
    return [
        Number(Entry(f"{key}_{place}")) if number is None else number
        for place, number in enumerate(known)
    ]
