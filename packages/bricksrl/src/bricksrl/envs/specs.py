"""Specs: entries with nominal bounds, the layout of all that is observed, and an environment that
consists of its specs only."""

import traceback
from collections import defaultdict
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, replace
from math import copysign, inf, isnan
from typing import Any

import torch
from torch import Tensor
from torchrl.data.tensor_specs import Binary, Bounded, BoundedContinuous, Composite, Unbounded
from torchrl.envs import Compose, EnvBase, Transform

from brickhub.entry import Entry
from brickhub.user_lines import line_of_user
from bricksrl.envs.env_interface import BricksEnv
from bricksrl.envs.task import Task
from bricksrl.errors import BricksError, DescriptionError, message_of


def clamped(
    action: Tensor,
    shape: Sequence[int],
    env_id: str,
) -> Tensor:
    """A batch of actions, clamped to -1..1. Raises BricksError for another shape than ``shape``,
    and for an action that is not a number; a GPU is not waited for to look."""
    if action.shape != tuple(shape):
        raise BricksError(
            f"{env_id} got an action of shape {list(action.shape)}; give {list(shape)}"
        )
    action = action.detach().clamp(-1.0, 1.0)
    # One sum is enough, because it is NaN if any number is.
    if action.device.type == "cpu" and isnan(action.sum()):
        raise BricksError(
            f"{env_id} got an action that is not a number (NaN); look for what computed it"
        )
    return action


class _KeepClass(type(Bounded)):  # type: ignore[misc]
    """Metaclass that undoes ``Bounded``'s: that one changes the class of each instance to one of
    its own two."""

    def __call__(
        cls,
        *args: Any,
        **kwargs: Any,
    ) -> Any:
        spec = super().__call__(*args, **kwargs)
        spec.__class__ = cls
        return spec


def _keeping(name: str) -> Callable[..., Any]:
    """An operation of ``Bounded`` whose result has the same entries."""

    def operation(
        spec: "NominalBounded",
        *args: Any,
        **kwargs: Any,
    ) -> "NominalBounded":
        return spec.of_same(getattr(BoundedContinuous, name)(spec, *args, **kwargs))

    return operation


class NominalBounded(BoundedContinuous, metaclass=_KeepClass):  # type: ignore[misc]
    """``Bounded`` spec of entries, some of which may lie outside of the box: their bounds are
    nominal.

    These have ``low`` and ``high`` and are sampled between them, but any finite number is in the
    spec and none is projected. All operations on specs preserve this.

    Attributes:
        entries: what the numbers of its last dimension are; empty if that is not known.
    """

    entries: tuple[Entry, ...] = ()

    @classmethod
    def of(
        cls,
        entries: Sequence[Entry],
        batch: Sequence[int] = (),
        device: torch.device | None = None,
    ) -> "NominalBounded":
        """Spec of a vector of ``entries``, with leading dimensions ``batch``."""
        low = torch.tensor([entry.low for entry in entries], device=device)
        high = torch.tensor([entry.high for entry in entries], device=device)
        shape = (*batch, len(entries))
        spec: NominalBounded = cls(low.expand(shape), high.expand(shape))
        spec.entries = tuple(entries)
        return spec

    @property
    def nominal(self) -> Tensor:
        """Bool of the spec's shape; ``True`` where the bounds are nominal: all where no entries are
        known. A transform such as ``CatFrames`` repeats the entries, one such as
        ``UnsqueezeTransform`` adds dimensions of one entry."""
        marks = [entry.bounds != (entry.low, entry.high) for entry in self.entries]
        sizes = [size for size in self.shape if size != 1] or [1]
        count = sizes[-1]
        if not marks or count % len(marks):
            return torch.ones(self.shape, dtype=torch.bool)
        repeated = torch.tensor(marks * (count // len(marks)))
        return repeated.expand(sizes).reshape(self.shape)

    def is_in(self, val: Tensor) -> bool:
        # Batch dimensions may come before those of the spec.
        inner_shape = val.shape[-self.ndim :]
        is_alike = val.dtype == self.dtype and inner_shape == self.shape
        if not is_alike or not bool(val.isfinite().all()):
            return False
        return bool((self._project(val) == val).all())

    def _project(self, val: Tensor) -> Tensor:
        return torch.where(self.nominal.to(val.device), val, super()._project(val))

    def of_same(self, spec: Any) -> "NominalBounded":
        """Another spec, with the entries of this one."""
        # `Bounded.to` returns a plain `Bounded`, so the entries are put back.
        if not isinstance(spec, NominalBounded):
            spec = NominalBounded(
                spec.low,
                spec.high,
                spec.shape,
                spec.device,
                spec.dtype,
            )
        same: NominalBounded = spec
        same.entries = self.entries
        return same

    operations = (
        "clone",
        "to",
        "expand",
        "squeeze",
        "unsqueeze",
        "_reshape",
        "_unflatten",
        "__getitem__",
    )
    clone, to, expand, squeeze, unsqueeze, _reshape, _unflatten, __getitem__ = map(
        _keeping,
        operations,
    )

    def unbind(self, dim: int = 0) -> "tuple[NominalBounded, ...]":
        return tuple(map(self.of_same, super().unbind(dim)))

    def __eq__(self, other: object) -> bool:
        if not isinstance(other, NominalBounded) or not super().__eq__(other):
            return False
        return self.entries == other.entries

    def __hash__(self) -> int:
        return hash((self.shape, self.dtype))


def end_specs(batch: Sequence[int] = (), device: torch.device | None = None) -> Composite:
    """Specs of the ends of an episode: ``done``, ``terminated`` and ``truncated``, ``[*batch,
    1]``."""
    names = ("done", "terminated", "truncated")
    return Composite(
        {name: Binary(1, (*batch, 1), device, torch.bool) for name in names},
        shape=batch,
        device=device,
    )


def set_vector_specs(env: EnvBase, task: Task) -> None:
    """Set the specs of an environment of one robot, or of copies of it, without an image."""
    batch = env.batch_size
    device = env.device
    env.observation_spec = Composite(
        observation=NominalBounded.of(task.entries, batch, device),
        shape=batch,
        device=device,
    )
    env.action_spec = Bounded(
        -1.0,
        1.0,
        (*batch, len(task.interface.commands)),
        device=device,
    )
    env.reward_spec = Unbounded((*batch, 1), device=device)
    env.done_spec = end_specs(batch, device)


_LARGEST = torch.finfo(torch.float32).max


def _end(value: float) -> float:
    """An end of a spec; TorchRL's unbounded ones end at the largest float."""
    return copysign(inf, value) if abs(value) >= _LARGEST else float(value)


def spec_entries(spec: Any, prefix: str | tuple[str, ...]) -> tuple[Entry, ...]:
    """Entries of a spec; where it has none, numbered ones with its bounds, infinite where it has
    none. ``prefix``: its key."""
    entries: tuple[Entry, ...] = getattr(spec, "entries", ())
    count = spec.shape.numel()
    if len(entries) == count:
        return entries
    space = getattr(spec, "space", None)
    low = getattr(space, "low", None)
    high = getattr(space, "high", None)
    lows = [-inf] * count if low is None else list(map(_end, low.flatten().tolist()))
    highs = [inf] * count if high is None else list(map(_end, high.flatten().tolist()))
    name = prefix if isinstance(prefix, str) else ".".join(prefix)
    bounds = zip(lows, highs, strict=True)
    return tuple(Entry(f"{name}_{index}", *ends) for index, ends in enumerate(bounds))


@dataclass(frozen=True)
class Number:
    """A number of an observation: ``scale * entry + offset``. ``frame``: which of several
    observations it is of."""

    entry: Entry
    scale: float = 1.0
    offset: float = 0.0
    frame: int = 0


@dataclass(frozen=True)
class ImageShape:
    """An image: its size, whether the channels are its last dimension, and the values of black and
    white."""

    key: str
    side_px: int
    channels: int
    is_channels_last: bool
    low: float = 0.0
    high: float = 1.0

    @classmethod
    def of(
        cls,
        key: str,
        spec: Any,
    ) -> "ImageShape":
        """The image of a spec ``[side, side, channels]`` or ``[channels, side, side]``. Raises
        DescriptionError for another."""
        shape = tuple(spec.shape)
        first = shape[0]
        last = shape[-1]
        # There are fewer channels than pixels, and libraries differ in which end they stand at.
        is_last = last < first
        channels = last if is_last else first
        side = first if is_last else last
        if sorted(shape) != sorted((channels, side, side)):
            raise DescriptionError(
                f"an agent reads no '{key}' of shape {list(shape)}; crop it to a square, or "
                "leave it out"
            )
        image = cls(key, side, channels, is_last)
        low = getattr(spec.space, "low", None)
        high = getattr(spec.space, "high", None)
        black = image.low if low is None else _end(float(low.max()))
        white = image.high if high is None else _end(float(high.max()))
        if inf > white > black > -inf:
            return replace(image, low=black, high=white)
        # An unbounded spec does not say what white is.
        return image


EPISODE_KEYS = (
    "link_lost",
    "episode_reward",
    "step_count",
    "is_init",
    "traj_count",
    "time_step",
    "time_policy",
    "time_reset",
)
"""Keys about the course of an episode, from us and from TorchRL's transforms. No agent reads them,
nor any that begins with "_"."""


def transform_failure(error: Exception) -> DescriptionError:
    """The error of a transform that raised, by the name of its class."""
    name = "the transform"
    # The innermost call counts, because those around it only called it.
    for frame, _ in traceback.walk_tb(error.__traceback__):
        caller = frame.f_locals.get("self")
        if isinstance(caller, Transform) and not isinstance(caller, Compose):
            name = type(caller).__name__
    what = f"{message_of(error, typed=True)}{line_of_user(error)}"
    return DescriptionError(f"{name} fails ({what}); correct it, or omit it")


def specs_of(env: EnvBase, kind: str) -> Composite:
    """Specs, without batch, of a kind: observation, action, reward. Raises DescriptionError if a
    transform fails on them."""
    try:
        return getattr(env, f"full_{kind}_spec_unbatched")
    except Exception as error:
        raise transform_failure(error) from error


def given_specs(env: EnvBase) -> dict[Any, Any]:
    """Specs, without batch, of all numbers that an environment gives to its transforms, whether an
    agent can read them or not."""
    given = {}
    for key, spec in specs_of(env, "observation").items(True, True):
        is_text = spec.dtype is None
        if not is_text and key not in EPISODE_KEYS:
            given[key] = spec
    return given


def observed_specs(env: EnvBase) -> dict[str, Any]:
    """Specs, without batch, of all that an agent observes. Raises DescriptionError for one that no
    agent can read."""
    specs = {}
    for key, spec in specs_of(env, "observation").items():
        # A transform that renames all parts of a group leaves it empty, and then nothing of it is
        # read.
        is_group = isinstance(spec, Composite)
        is_empty = is_group and not list(spec.keys(True, True))
        if key in EPISODE_KEYS or key.startswith("_") or is_empty:
            continue
        is_numbers = not is_group and spec.dtype is not None
        if not is_numbers or not 0 < len(spec.shape) <= 3:
            kind = f"shape {list(spec.shape)}" if is_numbers else type(spec).__name__
            raise DescriptionError(
                f"an agent reads no '{key}' ({kind}); rename its parts, or leave it out "
                "(ExcludeTransform)"
            )
        specs[str(key)] = spec
    return specs


@dataclass(frozen=True)
class ObservationLayout:
    """The meaning of all that is observed, number by number, as features and hindsight need it, and
    the images.

    Attributes:
        low, high: bounds of the entries; infinite where there are none.
        wraps: angles in degrees that run around from 360 to 0.
        goals: pairs of indices: of a goal, and of the entry that is to reach it.
        images: the images.
        vectors: key and shape of each vector; their numbers follow one another.
        scale, offset: a number is ``scale * entry + offset``; empty where all are the entries
            themselves.
        names: of the entries.
        frames: of several observations the one that each number is of, 0 for the newest; empty if
            there is one.
    """

    low: tuple[float, ...]
    high: tuple[float, ...]
    wraps: tuple[bool, ...]
    goals: tuple[tuple[int, int], ...] = ()
    images: tuple[ImageShape, ...] = ()
    vectors: tuple[tuple[str, tuple[int, ...]], ...] = ()
    scale: tuple[float, ...] = ()
    offset: tuple[float, ...] = ()
    names: tuple[str, ...] = ()
    frames: tuple[int, ...] = ()

    @property
    def keys(self) -> list[str]:
        """Keys of vectors and images."""
        return [key for key, _ in self.vectors] + [image.key for image in self.images]

    @property
    def places(self) -> dict[str, int]:
        """Index of each entry in the newest observation that stands there in its own units."""
        places = {}
        for index, name in enumerate(self.names):
            factors = (self.scale[index], self.offset[index]) if self.scale else (1.0, 0.0)
            if self.frames[index] == 0 and factors == (1.0, 0.0):
                places[name] = index
        return places

    @property
    def past(self) -> dict[int, int]:
        """Numbers of older frames, each with that of its entry in the newest frame that has it."""
        numbers = list(zip(self.frames, self.names, strict=False))
        newest = dict[str, int]()
        by_age = sorted((frame, name, index) for index, (frame, name) in enumerate(numbers))
        for _, name, index in by_age:
            newest.setdefault(name, index)
        past = {}
        for index, (frame, name) in enumerate(numbers):
            if frame > self.frames[newest[name]]:
                past[index] = newest[name]
        return past

    @classmethod
    def of_numbers(
        cls,
        vectors: Mapping[str, Sequence[Number]],
        shapes: Sequence[tuple[int, ...]],
        images: tuple[ImageShape, ...],
    ) -> "ObservationLayout":
        """The layout of vectors with known numbers, and of images."""
        numbers = [number for numbers in vectors.values() for number in numbers]
        goals = _goal_pairs(numbers)
        paired = {index for pair in goals for index in pair}
        maps = []
        for index, number in enumerate(numbers):
            entry = number.entry
            has_range = inf > entry.high - entry.low
            # A number without range, angle or goal is left for a transform to scale.
            has_unit = index in paired or entry.wraps or has_range
            maps.append((number.scale, number.offset) if has_unit else (1.0, 0.0))
        is_scaled = any(pair != (1.0, 0.0) for pair in maps)
        entries = [number.entry for number in numbers]
        return cls(
            low=tuple(entry.low for entry in entries),
            high=tuple(entry.high for entry in entries),
            wraps=tuple(entry.wraps for entry in entries),
            goals=goals,
            images=images,
            vectors=tuple(zip(vectors, shapes, strict=True)),
            scale=tuple(scale for scale, _ in maps) if is_scaled else (),
            offset=tuple(offset for _, offset in maps) if is_scaled else (),
            names=tuple(entry.name for entry in entries),
            frames=tuple(number.frame for number in numbers),
        )


def _goal_pairs(numbers: Sequence[Number]) -> tuple[tuple[int, int], ...]:
    """Each entry ``X_goal`` with the entry ``X_angle`` of the same kind and frame, where there is
    one."""
    places = defaultdict[tuple[str, int], list[int]](list)
    for index, number in enumerate(numbers):
        places[number.entry.name, number.frame].append(index)
    pairs: list[tuple[int, int]] = []
    for (name, frame), goals in places.items():
        if not name.endswith("_goal"):
            continue
        joint = name.removesuffix("_goal")
        angles = places.get((f"{joint}_angle", frame), ())
        # Where a transform copies both, the first of each belong together, then the second, and so
        # on.
        pairs += zip(goals, angles, strict=False)
    # A difference only means something where both wrap around, or neither does.
    alike = [
        (goal, angle)
        for goal, angle in pairs
        if numbers[goal].entry.wraps == numbers[angle].entry.wraps
    ]
    return tuple(sorted(alike))


SPECS = ("observation_spec", "action_spec", "reward_spec", "done_spec")
"""Specs of an environment."""


class SpecsEnv(BricksEnv, EnvBase):  # type: ignore[misc]
    """Specs, task and layout of a remote environment: enough to build an agent for it; it cannot be
    reset or stepped."""

    def __init__(
        self,
        specs: Mapping[str, Any],
        task: Task | None,
        layout: ObservationLayout | None = None,
        batch: Sequence[int] = (),
    ) -> None:
        super().__init__(batch_size=torch.Size(batch))
        for name, spec in specs.items():
            setattr(self, name, spec)
        self.task = task
        self.layout = layout

    def _reset(
        self,
        _tensordict: Any = None,
        **_: Any,
    ) -> Any:
        raise BricksError("this environment is elsewhere; act in the one that it stands for")

    def _step(self, tensordict: Any) -> Any:
        return self._reset(tensordict)

    def _set_seed(self, _seed: int | None) -> None:
        """Do nothing, because nothing is random."""
