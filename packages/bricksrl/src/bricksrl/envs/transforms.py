"""Transforms between an environment and its agent: what they do to each number, what they hide,
what they keep.

Which number of an observation is which entry of the environment is followed from transform to
transform (`transform_rows`). One step is played through copies of them before an agent is built, so
that a transform which fails is refused by name, and not in the middle of a run.
"""

import copy
from collections.abc import Callable, Iterator, Sequence
from contextlib import contextmanager
from itertools import pairwise
from typing import Any

import torch
from tensordict import TensorDict, TensorDictBase
from torch import Tensor
from torch.nn.parameter import Parameter, UninitializedBuffer, is_lazy
from torchrl import set_auto_unwrap_transformed_env
from torchrl.envs import (
    ActionScaling,
    CatFrames,
    Compose,
    EnvBase,
    FrameSkipTransform,
    Transform,
    TransformedEnv,
    VecNorm,
)
from torchrl.envs.transforms import VecNormV2

from brickhub.entry import Entry
from brickhub.user_files import calling, load_object
from bricksrl.envs.env_interface import interface_of
from bricksrl.envs.options import EnvOptions
from bricksrl.envs.specs import (
    SPECS,
    ImageShape,
    Number,
    ObservationLayout,
    SpecsEnv,
    given_specs,
    observed_specs,
    spec_entries,
    specs_of,
    transform_failure,
)
from bricksrl.envs.transform_rows import (
    RUNNING,
    as_arrays,
    as_list,
    has_unit,
    numbers_behind,
)
from bricksrl.errors import DataError, DescriptionError

_TOLERANCE = 1e-4
"""Largest difference of two actions, in -1..1, that are the same but for single precision."""
_MOST_REPEATS = 24
"""Longest repetition of an action that may outlast the end of a recorded episode."""


def base_of(env: EnvBase) -> EnvBase:
    """The environment under all transforms."""
    while isinstance(env, TransformedEnv):
        env = env.base_env
    return env


def transforms_of(env: EnvBase) -> list[Transform]:
    """The transforms of an environment, innermost first."""
    chain: list[Transform] = []
    while isinstance(env, TransformedEnv):
        chain = [*_chain(env), *chain]
        env = env.base_env
    return chain


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


class Tap(Transform):  # type: ignore[misc]
    """Innermost transform, which changes nothing: it notes what the environment itself observes and
    pays in each of its steps."""

    def __init__(self) -> None:
        super().__init__()
        self.noted: dict[str, Any] = {"frames": []}  # shared with TorchRL's copies of a chain

    def _inv_call(self, tensordict: TensorDictBase) -> TensorDictBase:
        self.noted["action"] = tensordict.get("action", None)
        return tensordict

    def _reset(
        self,
        _tensordict: TensorDictBase,
        tensordict_reset: TensorDictBase,
    ) -> TensorDictBase:
        self.noted |= {"frames": [], "state": tensordict_reset.clone()}
        return tensordict_reset

    def _step(
        self,
        _tensordict: TensorDictBase,
        next_tensordict: TensorDictBase,
    ) -> TensorDictBase:
        if next_tensordict.batch_dims:  # copies are judged by their task's kinematics
            return next_tensordict
        before = self.noted["state"]
        # A clone: transforms after this one write into the tensordict.
        after = next_tensordict.clone()
        ends = ("done", "terminated", "truncated")
        state = before.exclude("reward", *ends).set("action", self.noted["action"])
        self.noted["frames"].append(state.set("next", after))
        self.noted["state"] = after
        return next_tensordict


def own_state(env: EnvBase, state: TensorDictBase) -> TensorDictBase:
    """The environment's own observation behind a state of its transforms."""
    tap = _tap_of(env)
    return state if tap is None else tap.noted["state"]


def own_frames(env: EnvBase, frame: TensorDictBase) -> list[TensorDictBase]:
    """The environment's own steps behind the last step of its transforms: with its observations,
    actions and rewards."""
    tap = _tap_of(env)
    if tap is None:
        return [frame]
    frames = tap.noted["frames"]
    tap.noted["frames"] = []
    if "intervention" in frame:  # which is written behind the transforms
        for own_frame in frames:
            own_frame["intervention"] = frame["intervention"]
    return list(frames)


def _tap_of(env: EnvBase) -> Tap | None:
    """The tap of an environment that has been prepared, which is the innermost transform."""
    chain = transforms_of(env)
    return chain[0] if chain and isinstance(chain[0], Tap) else None


class FrameSkip(FrameSkipTransform):  # type: ignore[misc]
    """TorchRL's frame skip, which repeats an action, that stops where the episode ends: of copies,
    each at its own end. Each of the steps follows from the one before, also for what transforms
    before it count."""

    def _step(
        self,
        tensordict: TensorDictBase,
        next_tensordict: TensorDictBase,
    ) -> TensorDictBase:
        # The environment before this transform, of which TorchRL makes a view.
        parent = self.parent
        state = tensordict
        outcome = next_tensordict
        reward = outcome["reward"]
        for _ in range(self.frame_skip - 1):
            done = outcome["done"]
            if bool(done.all()):
                break
            state = parent.step_mdp(state.clone(False).set("next", outcome))
            goes_on = ~done.squeeze(-1)
            if state.batch_dims:
                # robots in processes: those that have ended wait
                state["_step"] = goes_on
            after = parent._step(state)
            reward = reward + after["reward"].masked_fill(done, 0.0)
            # A copy that has ended keeps the outcome of its last step.
            outcome = after.where(goes_on, outcome) if state.batch_dims else after
        return outcome.set("reward", reward)


class KeepUnits(Transform):  # type: ignore[misc]
    """After running statistics: entries with a range, angles and goals in their units again, as the
    statistics change and what was remembered would not mean the same any more. The rest stays
    normalised."""

    def __init__(self, statistics: VecNorm | VecNormV2) -> None:
        super().__init__()
        before = statistics.parent
        specs = observed_specs(before)
        numbers = numbers_of(before)
        self.kept: dict[tuple[Any, Any], Tensor] = {}
        """Which numbers keep their units, by the keys of a vector before and behind."""
        for key, out in zip(statistics.in_keys, statistics.out_keys, strict=True):
            if key in numbers:  # and not a reward or an image
                kept = torch.tensor([has_unit(number.entry) for number in numbers[key]])
                self.kept[key, out] = kept.view(specs[key].shape)

    def _call(self, next_tensordict: TensorDictBase) -> TensorDictBase:
        chain = _chain(self.container)
        statistics = copy.copy(chain[chain.index(self) - 1])  # in a copy of the chain its own
        statistics.in_keys = [key for key, _ in self.kept]
        statistics.out_keys = [out for _, out in self.kept]
        before = statistics.denorm(next_tensordict)
        for (key, out), kept in self.kept.items():
            if out in next_tensordict:
                value = next_tensordict[out]
                next_tensordict[out] = torch.where(kept.to(value.device), before[key], value)
        return next_tensordict

    def _reset(
        self,
        _tensordict: TensorDictBase,
        tensordict_reset: TensorDictBase,
    ) -> TensorDictBase:
        return self._call(tensordict_reset)


def prepare(env: EnvBase) -> None:
    """Prepare the transforms of an environment for an agent: its own steps are noted, running
    statistics keep units. To do it again changes nothing."""
    while isinstance(env, TransformedEnv):
        inner = env.base_env
        chain = _chain(env)
        pairs = list(enumerate(pairwise([*chain, None])))
        # From the last one on, so that the places of those before stay.
        for place, (transform, after) in reversed(pairs):
            runs = isinstance(transform, RUNNING) and not transform.frozen
            if runs and not isinstance(after, KeepUnits):
                _insert(env, place + 1, KeepUnits(transform))
        is_innermost = not isinstance(inner, TransformedEnv)
        has_tap = bool(chain) and isinstance(chain[0], Tap)
        if is_innermost and not inner.batch_size and not has_tap:
            _insert(env, 0, Tap())
        env = inner


def with_unit_actions(env: EnvBase) -> EnvBase:
    """An environment whose actions are in -1..1, by TorchRL's ``ActionScaling`` where they have
    another range. Raises DescriptionError for actions that no agent gives, and without a reward."""
    action = specs_of(env, "action").get("action", None)
    reward = specs_of(env, "reward").get("reward", None)
    if action is None or reward is None:
        raise DescriptionError(
            "the environment has no 'action' or no 'reward'; let its transforms keep these names"
        )
    if len(action.shape) != 1 or action.dtype != torch.float32:
        kind = f"{type(action).__name__} {list(action.shape)}, {action.dtype}"
        raise DescriptionError(
            f"an agent gives no such action ({kind}); let it take float32 [n] with a range"
        )
    space = action.space
    is_unit = (space.low == -1.0).all() and (space.high == 1.0).all()
    if bool(is_unit):
        return env
    if isinstance(env, TransformedEnv):
        return env.append_transform(ActionScaling())
    return TransformedEnv(env, ActionScaling())


def _chain(env: TransformedEnv) -> list[Transform]:
    """The transforms of the outermost level."""
    return list(env.transform.transforms) if isinstance(env.transform, Compose) else [env.transform]


def _insert(
    env: TransformedEnv,
    place: int,
    transform: Transform,
) -> None:
    """TorchRL's insertion, which copies a transform that is alone, so that its owner's is none of
    the environment any more."""
    if not isinstance(env.transform, Compose):
        alone = env.transform
        alone.reset_parent()
        env.transform = Compose(alone)
    env.insert_transform(place, transform)


class Playback(SpecsEnv):
    """Plays outcomes of an environment: the first one at the reset, the next ones at each step.
    ``outcome``: the n-th."""

    def __init__(
        self,
        env: EnvBase,
        outcome: Callable[[int], TensorDictBase],
        batch: Sequence[int] = (),
    ) -> None:
        specs = {}
        for name in SPECS:
            spec = getattr(env, name)
            specs[name] = spec.expand(*batch, *spec.shape).clone()
        task = interface_of(env).task
        super().__init__(specs, task, batch=(*batch, *env.batch_size))
        self.outcome = outcome
        self.played = [outcome(0)]
        self.acted: list[Tensor] = []

    def _reset(
        self,
        _tensordict: Any = None,
        **_: Any,
    ) -> Any:
        return self.played[0].exclude("reward").clone()

    def _step(self, tensordict: TensorDictBase) -> TensorDictBase:
        self.acted.append(tensordict["action"])
        self.played.append(self.outcome(len(self.played)))
        return self.played[-1].clone()


def over(env: EnvBase, base: EnvBase) -> EnvBase:
    """A base, such as a playback, behind copies of an environment's transforms, in their state."""
    chain = transforms_of(env)
    # What `deepcopy` finds in its memo it does not copy: so they are copied without the
    # environment.
    memo = dict[int, Any]()
    level = env
    while isinstance(level, TransformedEnv):
        memo[id(level)] = None
        if isinstance(level.transform, Compose):
            memo[id(level.transform)] = None
        level.transform.empty_cache()
        level = level.base_env
    for transform in chain:
        for buffer in transform.buffers():
            # A buffer without a shape cannot be copied. The stub of its class is wrong.
            if is_lazy(buffer):
                empty: Any = UninitializedBuffer
                memo[id(buffer)] = empty(False, buffer.device, buffer.dtype)
    copied = copy.deepcopy(chain, memo)
    for transform in copied:
        transform.reset_parent()
    return TransformedEnv(base, Compose(*copied)) if copied else base


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


def keeps_vectors(env: EnvBase) -> bool:
    """Whether an agent observes the vectors of the environment as they are, and nothing made of
    them, and its actions are the environment's."""
    base = base_of(env)
    if base is env:
        return True
    own = layout_of(base)
    seen = layout_of(env)
    # Names and units first, then keys: a renamed vector means the same, and is read elsewhere.
    has_same_numbers = numbers_of(env) == numbers_of(base)
    has_same_shapes = seen.vectors == own.vectors and seen.keys == own.keys
    return has_same_numbers and has_same_shapes and keeps_actions(env)


def keeps_actions(env: EnvBase) -> bool:
    """Whether an agent's actions are the environment's."""
    return base_of(env) is env or one_step(env)[2]


def changes_nothing(env: EnvBase) -> bool:
    """Whether an agent gets observations and rewards as the environment gives them, which gets its
    actions."""
    if base_of(env) is env or not keeps_vectors(env):
        return base_of(env) is env
    paid, steps, _ = one_step(env)
    return steps == 1 and bool((paid == 1.0).all())


def one_step(env: EnvBase) -> tuple[Tensor, int, bool]:
    """What a step behind the transforms pays where each of the environment's own pays 1, the number
    of these, and whether their action is the agent's."""
    base = base_of(env)

    def paying_one(_: int) -> TensorDictBase:
        return still(base).set("reward", torch.ones_like(base.reward_spec.zero()))

    playback = Playback(base, paying_one)
    view = over(env, playback)
    start = view.reset().update(view.full_action_spec.zero())
    # No two numbers are equal, so that an exchange shows.
    size = start["action"].shape[-1]
    start["action"] += torch.linspace(
        -0.9,
        0.7,
        size,
        device=start["action"].device,
    )
    paid: Tensor = view.step(start.clone())["next", "reward"]
    acted = playback.acted[0]
    action = start["action"]
    is_same = acted.shape == action.shape and torch.allclose(acted, action, atol=_TOLERANCE)
    return paid, len(playback.played) - 1, is_same


def steps_of(env: EnvBase) -> int:
    """Steps of the environment itself in one behind its transforms."""
    return 1 if base_of(env) is env else one_step(env)[1]


def runs_on(env: EnvBase) -> bool:
    """Whether what transforms keep depends on the episodes before, such as running statistics."""
    base = base_of(env)
    view = over(env, Playback(base, lambda _: still(base)))
    kept = list[dict[str, Any]]()
    with torch.random.fork_rng(devices=[]), torch.no_grad():
        for _ in range(2):
            torch.manual_seed(0)
            state = view.reset()
            kept.append(transform_state(view))
            view.step(view.rand_action(state))
    return not _equal(*kept)


def _equal(one: Any, other: Any) -> bool:
    if isinstance(one, dict | TensorDictBase):
        if one.keys() != other.keys():
            return False
        return all(_equal(one[key], other[key]) for key in one)
    if isinstance(one, Tensor):
        return torch.equal(one, other)
    return bool(one == other)


def still(env: EnvBase) -> TensorDictBase:
    """An outcome of nothing: zeros, which end nothing."""
    outcome: TensorDictBase = env.full_observation_spec.zero().update(env.full_done_spec.zero())
    return outcome.set("reward", env.reward_spec.zero())


def _vectors(specs: dict[Any, Any]) -> dict[Any, tuple[Entry, ...]]:
    vectors = {}
    for key, spec in specs.items():
        if len(spec.shape) < 3:  # the others are images
            vectors[key] = spec_entries(spec, key)
    return vectors


def through(env: EnvBase, frames: TensorDictBase) -> TensorDictBase:
    """What an environment's transforms make of its own frames ``[time]`` of whole episodes, which
    end with "done"; the statistics that they gather they keep. Raises DataError if the actions are
    not those that would pass the transforms."""
    if base_of(env) is env:
        return frames
    base = base_of(env)
    if base.batch_size:  # copies: the frames are of one
        specs = {name: getattr(base, f"{name}_unbatched").clone() for name in SPECS}
        base = SpecsEnv(specs, interface_of(base).task)
    given = frames.select(
        *base.full_observation_spec.keys(),
        "action",
        "next",
        strict=False,
    )
    playback = Playback(base, lambda _: still(base))
    view = over(env, playback)
    none = _passed(view, torch.zeros_like(given["action"][0]))
    full = _passed(view, torch.ones_like(given["action"][0]))
    made = []
    start = 0
    ends = frames["next", "done"].view(-1).nonzero().flatten() + 1
    for end in ends.tolist():
        episode = given[start:end]
        first = episode[0].exclude("action", "next").update(base.full_done_spec.zero())
        outcomes = [still(base).update(first)]
        outcomes += [still(base).update(row["next"]) for row in episode]
        # a repeated action may outlast its episode
        repeated = outcomes[-1:] * _MOST_REPEATS
        playback.outcome = [*outcomes, *repeated].__getitem__
        playback.played = outcomes[:1]
        state = view.reset()
        # One step behind the transforms may be several of the episode's.
        while len(playback.played) <= len(episode):
            place = len(playback.played) - 1
            # The agent's action that becomes the recorded one: transforms scale actions.
            action = (episode[place]["action"] - none) / (full - none)
            out = view.step(state.set("action", action))
            taken = episode[place : len(playback.played) - 1]["action"]
            passed = torch.stack(playback.acted)[: len(taken)]
            if not torch.allclose(passed, taken, atol=_TOLERANCE):
                raise DataError(
                    "the data has other actions than these transforms would give; record with "
                    "them, or omit them"
                )
            made.append(out)
            state = view.step_mdp(out)
            playback.acted.clear()
        start = end
    load_transform_state(env, transform_state(view))
    return torch.stack(made)


def _passed(view: EnvBase, action: Tensor) -> Tensor:
    """What transforms make of an action on its way to the environment."""
    passed: Tensor = view.transform.inv(TensorDict(action=action))["action"]
    return passed


def transform_state(env: EnvBase) -> dict[str, Any]:
    """What transforms keep from episode to episode, such as statistics, as plain tensors; networks
    do not change."""
    kept: dict[str, Any] = {}
    for place, transform in enumerate(transforms_of(env)):
        for name, value in transform.state_dict(keep_vars=True).items():
            if not (isinstance(value, Parameter) or is_lazy(value)):
                kept[f"{place}.{name}"] = copy.deepcopy(value)
    # Empty groups, of statistics that nothing was measured for yet, are left out.
    return {name: value for name, value in kept.items() if isinstance(value, Tensor) or value}


def load_transform_state(
    env: EnvBase,
    state: dict[str, Any],
    *,
    frozen: bool = False,
) -> None:
    """Inverse of `transform_state`; ``frozen``: statistics do not run on."""
    env.__dict__.pop("_known", None)
    for place, transform in enumerate(transforms_of(env)):
        present = transform.state_dict(keep_vars=True)
        part = {}
        for full_name, value in state.items():
            number, _, name = full_name.partition(".")
            if number == str(place) and not is_lazy(present.get(name)):
                part[name] = value
        # A copy: a transform goes on counting in the tensors that it loads.
        transform.load_state_dict(copy.deepcopy(part), strict=False)
        if frozen and isinstance(transform, RUNNING):
            transform.freeze()


@contextmanager
def unaffected(env: EnvBase) -> Iterator[None]:
    """Nothing that transforms keep, nor torch's generator, is changed by what happens inside."""
    generator = torch.get_rng_state()
    state = transform_state(env)
    try:
        yield
    finally:
        torch.set_rng_state(generator)
        load_transform_state(env, state)


@set_auto_unwrap_transformed_env(False)  # type: ignore[untyped-decorator]
def transformed(env: EnvBase, options: EnvOptions) -> EnvBase:
    """An environment with the transforms of its options, prepared for an agent. Raises
    DescriptionError if a user's transform is none, or raises."""
    if options.transform is not None:
        with torch.random.fork_rng(devices=[]):
            # what it draws, such as a frozen network, is the same wherever it is made
            torch.manual_seed(0)
            found = load_object(options.transform, "transform")
            with calling(options.transform, "cannot be applied"):
                if isinstance(found, type) and issubclass(found, Transform):
                    found = found()
                is_transform = isinstance(found, Transform)
                env = TransformedEnv(env, found) if is_transform else found(env)
        if not isinstance(env, EnvBase):
            raise DescriptionError(
                f"{options.transform} gives a {type(env).__name__}; let it return a TransformedEnv"
            )
    if options.frame_skip > 1:
        env = TransformedEnv(env, FrameSkip(options.frame_skip))
    if options.frame_stack > 1:
        env = TransformedEnv(env, Compose(*_stacking(env, options.frame_stack)))
    env = with_unit_actions(env)
    prepare(env)
    return env


def _stacking(env: EnvBase, count: int) -> list[Transform]:
    """Stacks of vectors and images along their numbers or channels."""
    specs = observed_specs(env)
    stacks = []
    for dim in (-1, -3):
        keys = [key for key, spec in specs.items() if _stack_dim(key, spec) == dim]
        if keys:
            stacks.append(CatFrames(count, dim, in_keys=keys))
    return stacks


def _stack_dim(key: str, spec: Any) -> int:
    is_image = len(spec.shape) == 3
    if is_image and not ImageShape.of(key, spec).is_channels_last:
        return -3
    return -1
