"""Specs: nominal bounds, the layout of an observation, and an environment that consists of its specs only."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from math import inf, isnan
from typing import Any

import torch
from torch import Tensor
from torchrl.data.tensor_specs import Binary, Bounded, BoundedContinuous, Composite, Unbounded
from torchrl.envs import EnvBase

from brickhub.entry import Entry
from bricksrl.envs.env_interface import BricksEnv, interface_of
from bricksrl.envs.task import Task
from bricksrl.errors import BricksError


def clamped(action: Tensor, shape: Sequence[int], env_id: str) -> Tensor:
    """A batch of actions, clamped to -1..1. Raises BricksError for another shape than ``shape``, and for an action that is not a
    number; a GPU is not waited for to look."""
    if action.shape != tuple(shape):
        raise BricksError(f"{env_id} got an action of shape {list(action.shape)}; give {list(shape)}")
    action = action.detach().clamp(-1.0, 1.0)
    if action.device.type == "cpu" and isnan(action.sum()):
        raise BricksError(f"{env_id} got an action that is not a number (NaN); look for what computed it")
    return action


class _KeepClass(type(Bounded)):  # type: ignore[misc]
    """Metaclass that undoes ``Bounded``'s: that one changes the class of each instance to one of its own two."""

    def __call__(cls, *args: Any, **kwargs: Any) -> Any:
        spec = super().__call__(*args, **kwargs)
        spec.__class__ = cls
        return spec


class NominalBounded(BoundedContinuous, metaclass=_KeepClass):  # type: ignore[misc]
    """``Bounded`` spec where marked entries may lie outside of the box.

    Marked entries have ``low`` and ``high`` and are sampled between them, but any finite number is in the spec and none is
    projected. All operations on specs preserve this.

    Attributes:
        nominal: bool of the spec's shape; ``True`` where the bounds are nominal.
    """

    nominal: Tensor

    def __init__(self, *args: Any, nominal: Tensor | None = None, **kwargs: Any) -> None:
        super().__init__(*args, **kwargs)
        self.nominal = torch.zeros(self.shape, dtype=torch.bool) if nominal is None else nominal.expand(self.shape).clone()

    @classmethod
    def of(cls, entries: Sequence[Entry], batch: Sequence[int] = (), device: torch.device | None = None) -> NominalBounded:
        """Spec of a vector of ``entries``, with leading dimensions ``batch``."""
        low, high = (torch.tensor([getattr(e, end) for e in entries], device=device) for end in ("low", "high"))
        nominal = torch.tensor([e.bounds != (e.low, e.high) for e in entries], device=device)
        shape = (*batch, len(entries))
        return cls(low.expand(shape), high.expand(shape), nominal=nominal)

    def is_in(self, val: Tensor) -> bool:
        if val.dtype != self.dtype or val.shape[-self.ndim :] != self.shape or not bool(val.isfinite().all()):
            return False
        low, high = self._get_space_bounds(val.device)
        return bool((self._mask(val) | ((val >= low) & (val <= high))).all())

    def _project(self, val: Tensor) -> Tensor:
        return torch.where(self._mask(val), val, super()._project(val))

    def _mask(self, val: Tensor) -> Tensor:
        """``nominal`` for a value, also after a transform such as ``CatFrames`` repeated the entries of the spec, or one such as
        ``UnsqueezeTransform`` added or removed dimensions of one entry."""
        mask, sizes = self.nominal, list(zip(self.shape, self.nominal.shape, strict=False))
        if [size for size in mask.shape if size != 1] == [size for size in self.shape if size != 1]:
            mask = mask.reshape(self.shape)
        elif mask.ndim == self.ndim and all(size % before == 0 for size, before in sizes):
            mask = mask.repeat([size // before for size, before in sizes])
        else:
            mask = mask.new_ones(())
        return mask.to(val.device)

    def _with(self, spec: Any, nominal: Tensor) -> NominalBounded:
        if not isinstance(spec, NominalBounded):  # ``Bounded.to`` makes a plain ``Bounded``
            spec = NominalBounded(spec.low, spec.high, spec.shape, spec.device, spec.dtype)
        result: NominalBounded = spec
        result.nominal = nominal.clone()
        return result

    def clone(self) -> NominalBounded:
        return self._with(super().clone(), self.nominal)

    def to(self, dest: Any) -> NominalBounded:
        return self._with(super().to(dest), self.nominal)

    def expand(self, *shape: Any) -> NominalBounded:
        spec = super().expand(*shape)
        return self._with(spec, self.nominal.expand(spec.shape))

    def squeeze(self, dim: int | None = None) -> NominalBounded:
        return self._with(super().squeeze(dim), self.nominal.squeeze() if dim is None else self.nominal.squeeze(dim))

    def unsqueeze(self, dim: int) -> NominalBounded:
        return self._with(super().unsqueeze(dim), self.nominal.unsqueeze(dim))

    def unbind(self, dim: int = 0) -> tuple[NominalBounded, ...]:
        return tuple(self._with(spec, mask) for spec, mask in zip(super().unbind(dim), self.nominal.unbind(dim), strict=True))

    def _reshape(self, shape: Any) -> NominalBounded:
        return self._with(super()._reshape(shape), self.nominal.reshape(shape))

    def _unflatten(self, dim: int, sizes: Any) -> NominalBounded:
        return self._with(super()._unflatten(dim, sizes), torch.unflatten(self.nominal, dim, sizes))

    def __getitem__(self, idx: Any) -> NominalBounded:
        spec = super().__getitem__(idx)
        return self._with(spec, self.nominal[idx].expand(spec.shape))

    def __eq__(self, other: object) -> bool:
        return bool(super().__eq__(other)) and isinstance(other, NominalBounded) and torch.equal(self.nominal, other.nominal)

    def __hash__(self) -> int:
        return hash((self.shape, self.dtype))


def end_specs(batch: Sequence[int] = (), device: torch.device | None = None) -> Composite:
    """Specs of the ends of an episode: ``done``, ``terminated`` and ``truncated``, ``[*batch, 1]``."""
    names = ("done", "terminated", "truncated")
    return Composite({name: Binary(1, (*batch, 1), device, torch.bool) for name in names}, shape=batch, device=device)


def set_vector_specs(env: EnvBase, task: Task) -> None:
    """Set the specs of an environment of one robot, or of copies of it, without an image."""
    batch, device = env.batch_size, env.device
    env.observation_spec = Composite(observation=NominalBounded.of(task.entries, batch, device), shape=batch, device=device)
    env.action_spec = Bounded(-1.0, 1.0, (*batch, len(task.interface.commands)), device=device)
    env.reward_spec = Unbounded((*batch, 1), device=device)
    env.done_spec = end_specs(batch, device)


def entries_of(env: EnvBase) -> tuple[Entry, ...]:
    """Entries of any environment's observation: those of its task if it has one, else made from its spec's bounds."""
    task = interface_of(env).task
    return spec_entries(env.full_observation_spec_unbatched["observation"], "observation") if task is None else task.entries


def spec_entries(spec: Any, prefix: str) -> tuple[Entry, ...]:
    """Numbered entries with the bounds of a spec, infinite where it has none."""
    space, n = getattr(spec, "space", None), int(spec.shape[-1])
    ends = [getattr(space, end, None) for end in ("low", "high")]
    low, high = ([without] * n if end is None else end.flatten().tolist() for end, without in zip(ends, (-inf, inf), strict=True))
    return tuple(Entry(f"{prefix}_{i}", low[i], high[i]) for i in range(n))


@dataclass(frozen=True)
class ObservationLayout:
    """The meaning of an observation ``[n]``, entry by entry, as features and hindsight need it, and the size of its image.

    Attributes:
        low, high: bounds; infinite where there are none.
        wraps: angles in degrees that run around from 360 to 0.
        goals: pairs of indices: of a goal, and of the entry that is to reach it.
        image_px: side of the square image beside the observation; 0 for none.
    """

    low: tuple[float, ...]
    high: tuple[float, ...]
    wraps: tuple[bool, ...]
    goals: tuple[tuple[int, int], ...] = ()
    image_px: int = 0

    @classmethod
    def of(cls, env: EnvBase) -> ObservationLayout:
        """The layout of an environment's observation: from its task where it has one, else the bounds of its spec."""
        spec = env.full_observation_spec_unbatched
        image_px = int(spec["image"].shape[-2]) if "image" in spec.keys() else 0  # noqa: SIM118  a Composite
        entries = entries_of(env)
        bounds = tuple(e.low for e in entries), tuple(e.high for e in entries)
        return cls(*bounds, tuple(e.wraps for e in entries), _goal_pairs(entries), image_px)


def _goal_pairs(entries: Sequence[Entry]) -> tuple[tuple[int, int], ...]:
    """Each entry ``X_goal`` with the entry ``X_angle`` of the same kind; none where a goal lacks one."""
    index_of = {entry.name: index for index, entry in enumerate(entries)}
    goals = [index for name, index in index_of.items() if name.endswith("_goal")]
    pairs = [(goal, index_of.get(entries[goal].name.removesuffix("_goal") + "_angle")) for goal in goals]
    matched = tuple((goal, reached) for goal, reached in pairs if reached is not None)
    alike = all(entries[goal].wraps == entries[reached].wraps for goal, reached in matched)
    return matched if alike and len(matched) == len(goals) else ()


class SpecsEnv(BricksEnv, EnvBase):  # type: ignore[misc]
    """Specs and task of a remote environment: enough to build an agent for it; it cannot be reset or stepped."""

    def __init__(self, specs: dict[str, Any], task: Task | None) -> None:
        super().__init__(batch_size=())
        for name, spec in specs.items():
            setattr(self, name, spec)
        self.task = task

    def _reset(self, _tensordict: Any = None, **_: Any) -> Any:
        raise BricksError("this environment is elsewhere; act in the one that it stands for")

    _step = _reset

    def _set_seed(self, _seed: int | None) -> None:
        """Do nothing: there is nothing random."""
