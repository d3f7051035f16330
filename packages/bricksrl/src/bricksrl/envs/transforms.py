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
        own = env.transform
        chain = [*(own.transforms if isinstance(own, Compose) else [own]), *chain]
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
    images = tuple(ImageShape.of(key, spec) for key, spec in specs.items() if key not in vectors)
    return ObservationLayout.of_numbers(
        vectors,
        [tuple(specs[key].shape) for key in vectors],
        images,
    )


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

    def _step(self, _tensordict: TensorDictBase, next_tensordict: TensorDictBase) -> TensorDictBase:
        if not next_tensordict.batch_dims:  # copies are judged by their task's kinematics
            before = self.noted["state"]
            after = next_tensordict.clone()
            ends = ("done", "terminated", "truncated")
            state = before.exclude("reward", *ends).set("action", self.noted["action"])
            self.noted["frames"].append(state.set("next", after))
            self.noted["state"] = after
        return next_tensordict


def own_state(env: EnvBase, state: TensorDictBase) -> TensorDictBase:
    """The environment's own observation behind a state of its transforms."""
    first = next(iter(transforms_of(env)), None)
    own: TensorDictBase = first.noted["state"] if isinstance(first, Tap) else state
    return own


def own_frames(env: EnvBase, frame: TensorDictBase) -> list[TensorDictBase]:
    """The environment's own steps behind the last step of its transforms: with its observations,
    actions and rewards."""
    first = next(iter(transforms_of(env)), None)
    if not isinstance(first, Tap):
        return [frame]
    frames = first.noted["frames"]
    first.noted["frames"] = []
    if "intervention" in frame:
        for own in frames:
            own["intervention"] = frame["intervention"]
    return list(frames)


class FrameSkip(FrameSkipTransform):  # type: ignore[misc]
    """TorchRL's frame skip, which repeats an action, that stops where the episode ends: of copies,
    each at its own end. Each of the steps follows from the one before, also for what transforms
    before it count."""

    def _step(self, tensordict: TensorDictBase, next_tensordict: TensorDictBase) -> TensorDictBase:
        parent = self.parent
        state = tensordict
        outcome = next_tensordict
        reward = outcome["reward"]
        for _ in range(self.frame_skip - 1):
            done = outcome["done"]
            if bool(done.all()):
                break
            state = parent.step_mdp(state.clone(False).set("next", outcome))
            if state.batch_dims:
                # robots in processes: those that have ended wait
                state["_step"] = ~done.squeeze(-1)
            after = parent._step(state)
            reward = reward + after["reward"].masked_fill(done, 0.0)
            outcome = after if not state.batch_dims else after.where(~done.squeeze(-1), outcome)
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
        self.kept = {
            (key, out): torch.tensor([has_unit(number.entry) for number in numbers[key]]).view(
                specs[key].shape
            )
            for key, out in zip(statistics.in_keys, statistics.out_keys, strict=True)
            if key in numbers
        }

    def _call(self, next_tensordict: TensorDictBase) -> TensorDictBase:
        chain = _chain(self.container)
        statistics = copy.copy(chain[chain.index(self) - 1])  # in a copy of the chain its own
        # not of a reward
        statistics.in_keys, statistics.out_keys = (
            [pair[end] for pair in self.kept] for end in (0, 1)
        )
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
        for place, (transform, after) in reversed(
            list(enumerate(zip(chain, [*chain[1:], None], strict=True)))
        ):
            if (
                isinstance(transform, RUNNING)
                and not transform.frozen
                and not isinstance(after, KeepUnits)
            ):
                _insert(env, place + 1, KeepUnits(transform))
        if not (
            isinstance(inner, TransformedEnv)
            or inner.batch_size
            or isinstance(next(iter(chain), None), Tap)
        ):
            _insert(env, 0, Tap())
        env = inner


def with_unit_actions(env: EnvBase) -> EnvBase:
    """An environment whose actions are in -1..1, by TorchRL's ``ActionScaling`` where they have
    another range. Raises DescriptionError for actions that no agent gives, and without a reward."""
    action, reward = (specs_of(env, kind).get(kind, None) for kind in ("action", "reward"))
    if action is None or reward is None:
        raise DescriptionError(
            "the environment has no 'action' or no 'reward'; let its transforms keep these names"
        )
    if len(action.shape) != 1 or action.dtype != torch.float32:
        kind = f"{type(action).__name__} {list(action.shape)}, {action.dtype}"
        raise DescriptionError(
            f"an agent gives no such action ({kind}); let it take float32 [n] with a range"
        )
    if bool((action.space.low == -1.0).all() and (action.space.high == 1.0).all()):
        return env
    return (
        env.append_transform(ActionScaling())
        if isinstance(env, TransformedEnv)
        else TransformedEnv(env, ActionScaling())
    )


def _chain(env: TransformedEnv) -> list[Transform]:
    """The transforms of the outermost level."""
    return list(env.transform.transforms) if isinstance(env.transform, Compose) else [env.transform]


def _insert(env: TransformedEnv, place: int, transform: Transform) -> None:
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
        specs = {name: getattr(env, name) for name in SPECS}
        specs = {name: spec.expand(*batch, *spec.shape).clone() for name, spec in specs.items()}
        super().__init__(specs, interface_of(env).task, batch=(*batch, *env.batch_size))
        self.outcome = outcome
        self.played = [outcome(0)]
        self.acted: list[Tensor] = []

    def _reset(self, _tensordict: Any = None, **_: Any) -> Any:
        return self.played[0].exclude("reward").clone()

    def _step(self, tensordict: TensorDictBase) -> TensorDictBase:
        self.acted.append(tensordict["action"])
        self.played.append(self.outcome(len(self.played)))
        return self.played[-1].clone()


def over(env: EnvBase, base: EnvBase) -> EnvBase:
    """A base, such as a playback, behind copies of an environment's transforms, in their state."""
    chain = transforms_of(env)
    memo = dict[int, Any]()
    level = env
    while isinstance(level, TransformedEnv):  # they are copied without the environment
        memo[id(level)] = None
        if isinstance(level.transform, Compose):
            memo[id(level.transform)] = None
        level.transform.empty_cache()
        level = level.base_env
    for buffer in (
        buffer for transform in chain for buffer in transform.buffers() if is_lazy(buffer)
    ):
        # its stub is wrong
        empty = UninitializedBuffer(False, buffer.device, buffer.dtype)  # type: ignore[arg-type]
        memo[id(buffer)] = empty  # it cannot be copied
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
    is_same = numbers_of(env) == numbers_of(base) and (seen.vectors, seen.keys) == (
        own.vectors,
        own.keys,
    )
    return is_same and keeps_actions(env)


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
    playback = Playback(
        base,
        lambda _: still(base).set("reward", torch.ones_like(base.reward_spec.zero())),
    )
    view = over(env, playback)
    start = view.reset().update(view.full_action_spec.zero())
    # no two are equal
    start["action"] += torch.linspace(
        -0.9,
        0.7,
        start["action"].shape[-1],
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
        return one.keys() == other.keys() and all(_equal(one[key], other[key]) for key in one)
    return torch.equal(one, other) if isinstance(one, Tensor) else bool(one == other)


def still(env: EnvBase) -> TensorDictBase:
    """An outcome of nothing: zeros, which end nothing."""
    outcome: TensorDictBase = env.full_observation_spec.zero().update(env.full_done_spec.zero())
    return outcome.set("reward", env.reward_spec.zero())


def _vectors(specs: dict[Any, Any]) -> dict[Any, tuple[Entry, ...]]:
    return {key: spec_entries(spec, key) for key, spec in specs.items() if len(spec.shape) < 3}


def through(env: EnvBase, frames: TensorDictBase) -> TensorDictBase:
    """What an environment's transforms make of its own frames ``[time]`` of whole episodes, which
    end with "done"; the statistics that they gather they keep. Raises DataError if the actions are
    not those that would pass the transforms."""
    if base_of(env) is env:
        return frames
    base = base_of(env)
    start = 0
    if base.batch_size:  # copies: the frames are of one
        base = SpecsEnv(
            {name: getattr(base, f"{name}_unbatched").clone() for name in SPECS},
            interface_of(base).task,
        )
    given = frames.select(*base.full_observation_spec.keys(), "action", "next", strict=False)
    playback = Playback(base, lambda _: still(base))
    view = over(env, playback)
    none, full = (
        view.transform.inv(TensorDict(action=torch.full_like(given["action"][0], x)))["action"]
        for x in (0.0, 1.0)
    )
    made = []
    for end in (frames["next", "done"].view(-1).nonzero().flatten() + 1).tolist():
        episode = given[start:end]
        first = episode[0].exclude("action", "next").update(base.full_done_spec.zero())
        after = [still(base).update(first), *(still(base).update(row["next"]) for row in episode)]
        # a repeated action may outlast its episode
        playback.outcome = [*after, *after[-1:] * _MOST_REPEATS].__getitem__
        playback.played = after[:1]
        state = view.reset()
        while len(playback.played) <= len(episode):
            place = len(playback.played) - 1
            out = view.step(state.set("action", (episode[place]["action"] - none) / (full - none)))
            taken = episode[place : len(playback.played) - 1]["action"]
            if not torch.allclose(torch.stack(playback.acted)[: len(taken)], taken, atol=1e-4):
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


def transform_state(env: EnvBase) -> dict[str, Any]:
    """What transforms keep from episode to episode, such as statistics, as plain tensors; networks
    do not change."""
    kept: dict[str, Any] = {}
    for place, transform in enumerate(transforms_of(env)):
        for name, value in transform.state_dict(keep_vars=True).items():
            if not (isinstance(value, Parameter) or is_lazy(value)):
                kept[f"{place}.{name}"] = copy.deepcopy(value)
    return {name: value for name, value in kept.items() if isinstance(value, Tensor) or value}


def load_transform_state(env: EnvBase, state: dict[str, Any], *, frozen: bool = False) -> None:
    """Inverse of `transform_state`; ``frozen``: statistics do not run on."""
    env.__dict__.pop("_known", None)
    for place, transform in enumerate(transforms_of(env)):
        own = transform.state_dict(keep_vars=True)
        part = {
            name.partition(".")[2]: value
            for name, value in state.items()
            if name.startswith(f"{place}.")
        }
        part = {name: value for name, value in part.items() if not is_lazy(own.get(name))}
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
                found = (
                    found() if isinstance(found, type) and issubclass(found, Transform) else found
                )
                env = TransformedEnv(env, found) if isinstance(found, Transform) else found(env)
        if not isinstance(env, EnvBase):
            raise DescriptionError(
                f"{options.transform} gives a {type(env).__name__}; let it return a TransformedEnv"
            )
    if options.frame_skip > 1:
        env = TransformedEnv(env, FrameSkip(options.frame_skip))
    if options.frame_stack > 1:
        specs = observed_specs(env)
        stacks = {
            dim: [key for key, spec in specs.items() if _stack_dim(key, spec) == dim]
            for dim in (-1, -3)
        }
        stacked = [
            CatFrames(options.frame_stack, dim, in_keys=keys)
            for dim, keys in stacks.items()
            if keys
        ]
        env = TransformedEnv(env, Compose(*stacked))
    env = with_unit_actions(env)
    prepare(env)
    return env


def _stack_dim(key: str, spec: Any) -> int:
    return -3 if len(spec.shape) == 3 and not ImageShape.of(key, spec).is_channels_last else -1
