"""Layout of what an agent observes: which number is which entry of the environment.

It is followed from transform to transform (`rows`). One step is played through copies of
them before an agent is built, so that a transform which fails is refused by name, and not in the
middle of a run.
"""

from itertools import pairwise
from typing import Any

import torch
from torchrl.envs import EnvBase, Transform, TransformedEnv

from brickhub.entry import Entry
from bricksrl.envs.specs import (
    ImageShape,
    Number,
    ObservationLayout,
    SpecsEnv,
    given_specs,
    observed_specs,
    spec_entries,
    transform_failure,
)
from bricksrl.envs.transforms.chain import base_of, transforms_of
from bricksrl.envs.transforms.keep_units import KeepUnits
from bricksrl.envs.transforms.playback import Playback, over, still
from bricksrl.envs.transforms.rows import as_arrays, as_list, numbers_behind
from bricksrl.errors import DescriptionError


def layout_of(env: EnvBase) -> ObservationLayout:
    """The layout of an environment's observation, from its specs and through its transforms. Raises
    DescriptionError for an entry that no agent can read."""
    if isinstance(env, SpecsEnv) and env.layout is not None:
        return env.layout
    specs = observed_specs(env)
    vectors = numbers_of(env)
    if not specs:
        raise DescriptionError(
            "there is nothing that an agent observes; leave a vector or an image"
        )
    images = [ImageShape.of(key, spec) for key, spec in specs.items() if key not in vectors]
    shapes = [tuple(specs[key].shape) for key in vectors]
    return ObservationLayout.of_numbers(vectors, shapes, tuple(images))


def numbers_of(env: EnvBase) -> dict[str, list[Number]]:
    """The numbers of each vector of an environment, through its transforms. Raises DescriptionError
    for an observation that no agent reads."""
    vectors = _vectors(observed_specs(env))
    if not isinstance(env, TransformedEnv) or not vectors:
        return {key: [Number(entry) for entry in entries] for key, entries in vectors.items()}
    chain = transforms_of(env)
    known = env.__dict__.get("_known", ([None], {}))
    if known[0] != chain:  # to play a step takes time
        _check_step(env, list(vectors))
        known = env.__dict__["_known"] = (chain, _followed(env, chain))
    numbers: dict[str, list[Number]] = known[1]
    return numbers


def _followed(env: EnvBase, chain: list[Transform]) -> dict[str, list[Number]]:
    """The numbers of each vector that is observed, followed through the transforms."""
    given = given_specs(base_of(env))
    numbers = as_arrays(_vectors(given), given)
    for transform, after in pairwise([*chain, None]):
        numbers = numbers_behind(transform, numbers, keeps_units=isinstance(after, KeepUnits))
    specs = observed_specs(env)
    return {
        key: as_list(numbers.get(key), tuple(spec.shape), key)
        for key, spec in specs.items()
        if len(spec.shape) < 3
    }


def _check_step(env: EnvBase, wanted: list[str]) -> None:
    """Raise DescriptionError if a transform fails in a step, or makes a vector of another shape
    than its spec says."""
    base = base_of(env)
    playback = Playback(base, lambda _: still(base))
    with torch.random.fork_rng(devices=[]), torch.no_grad():
        try:
            view = over(env, playback)
            state = view.step(view.rand_action(view.reset()))["next"]
        except Exception as error:
            raise transform_failure(error) from error
    for key in wanted:
        shape = state[key].shape
        if shape != env.full_observation_spec[key].shape:
            raise DescriptionError(
                f"the transforms make a '{key}' {list(shape)}; correct transform_observation_spec"
            )


def _vectors(specs: dict[Any, Any]) -> dict[Any, tuple[Entry, ...]]:
    vectors = {}
    for key, spec in specs.items():
        if len(spec.shape) < 3:  # the others are images
            vectors[key] = spec_entries(spec, key)
    return vectors
