"""Features: what observations in physical units, and rewards, become before networks learn from
them, ours or others.

An agent that acts holds what it observes within the range that it has learned on, so that an input
that never varied where it learned decides nothing where it acts."""

import itertools
import logging
import math
from collections.abc import Mapping, Sequence
from typing import Any

import torch
from torch import Tensor, nn
from torchrl.envs.utils import ExplorationType, exploration_type

from bricksrl.agents.features.formula import (
    FULL_TURN_DEG,
    scaled_entries,
    with_circles_and_goals,
)
from bricksrl.envs.specs import ObservationLayout

_log = logging.getLogger(__name__)
LARGEST = torch.finfo(torch.float32).max
PAST_SHARE = 0.3
"""Size of what older frames add: at 1 a stack of three learns the simulated Walker more slowly
(`python -m benchmarks transforms`)."""
ENOUGH = 20
"""Minimum number of transitions that tell how great rewards are."""


def reward_unit(rewards: Tensor) -> float:
    """The power of ten nearest to the root mean square of rewards ``[n]`` other than 0, at most 1;
    1 for fewer than `ENOUGH`."""
    # a reward that is paid seldom is as large as it is when it is paid
    paid = rewards[rewards != 0.0]
    size = 1.0
    if len(paid) and len(rewards) >= ENOUGH:
        size = float(paid.square().mean().sqrt())
    return min(1.0, 10.0 ** round(math.log10(size)))


class SeenInputs(nn.Module):
    """Least, greatest, mean and deviation of each input ``[n]`` that was learned on, in the
    module's state. Angles (``wraps``) are held only if they never varied, ``free`` inputs never."""

    least: Tensor
    greatest: Tensor
    moments: Tensor

    def __init__(
        self,
        names: Sequence[str],
        wraps: Sequence[bool],
        free: Sequence[int],
    ) -> None:
        super().__init__()
        n = len(wraps)
        self.names = names
        self.warned = set[str]()
        # off for observations that no robot has read, such as drawn ones
        self.says = True
        # the other way round, so that the first inputs replace both, and what was never seen shows
        self.register_buffer("least", torch.full((n,), LARGEST))
        self.register_buffer("greatest", torch.full((n,), -LARGEST))
        # count, mean, sum of squared deviations
        self.register_buffer("moments", torch.zeros(3, n, dtype=torch.float64))
        is_free = torch.zeros(n, dtype=torch.bool)
        is_free[list(free)] = True
        self.wraps = nn.Buffer(torch.tensor(wraps), persistent=False)
        self.free = nn.Buffer(is_free, persistent=False)

    @torch.no_grad()
    def see(self, inputs: Tensor) -> None:
        """Add inputs ``[*batch, n]`` that are learned on."""
        rows = inputs.reshape(-1, inputs.shape[-1])
        # in place: a copy of the policy shares these tensors
        torch.minimum(self.least, rows.amin(0), out=self.least)
        torch.maximum(self.greatest, rows.amax(0), out=self.greatest)
        # The parallel form of Welford's formulas (Chan et al., 1979), in double precision: the sums
        # go on for a whole run. The three are views: what is added to them is added to the buffer.
        count, mean, squares = self.moments
        added = len(rows)
        values = rows.double()
        added_mean = values.mean(0)
        difference = added_mean - mean
        total = count + added
        deviations = values - added_mean
        within = deviations.square().sum(0)
        between = difference.square() * count * added / total
        squares += within + between
        mean += difference * added / total
        count += added

    def forward(self, inputs: Tensor) -> Tensor:
        """Inputs ``[*batch, n]``, of an agent that acts at its best within what it has learned
        on."""
        if self.training or exploration_type() is not ExplorationType.DETERMINISTIC:
            return inputs
        least, greatest = self.bounds()
        # an export traces without numbers, so that there is nothing to say about them
        if self.says and not (torch.compiler.is_exporting() or inputs.is_meta):
            self._say(inputs, least, greatest)
        return inputs.clamp(least, greatest)

    def bounds(self) -> tuple[Tensor, Tensor]:
        """Least and greatest value ``[n]`` within which each input is held."""
        was_seen = self.least <= self.greatest
        never_varied = self.least == self.greatest
        # between 350 and 10 degrees lies 0, not 180: an angle's least and greatest bound nothing
        may_be_held = ~self.wraps | never_varied
        is_held = was_seen & ~self.free & may_be_held
        least = torch.where(is_held, self.least, -LARGEST)
        greatest = torch.where(is_held, self.greatest, LARGEST)
        return least, greatest

    def _say(
        self,
        inputs: Tensor,
        least: Tensor,
        greatest: Tensor,
    ) -> None:
        """Say once of each input that it is farther outside of what was seen than that is wide."""
        span = greatest - least
        rows = inputs.reshape(-1, len(least))
        is_far = (rows < least - span) | (rows > greatest + span)
        for row, index in is_far.nonzero().tolist():
            name = self.names[index] if self.names else f"input {index}"
            if name in self.warned:
                continue
            self.warned.add(name)
            low = float(least[index])
            high = float(greatest[index])
            value = float(rows[row, index])
            learned = f"{low:g}" if low == high else f"{low:g} to {high:g}"
            _log.warning(
                "%s reads %g, but the agent learned with %s: it acts as if it read that",
                name,
                value,
                learned,
            )

    def normalised(self, inputs: Tensor) -> Tensor:
        """Inputs less their mean, divided by their deviation; 0 where they never varied."""
        count, mean, squares = self.moments
        # before the first input is seen the count is 0
        variance = squares / count.clamp_min(1.0)
        deviation = variance.sqrt()
        varies = deviation > 1e-6
        scale = torch.where(varies, 1.0 / deviation.clamp_min(1e-6), 0.0)
        normalised: Tensor = (inputs - mean) * scale
        return normalised.to(inputs.dtype)


class TensorOperations:
    """`Operations` of torch."""

    sin = staticmethod(torch.sin)
    cos = staticmethod(torch.cos)

    @staticmethod
    def take(values: Tensor, indices: Tensor) -> Tensor:
        """The values at indices."""
        return values.index_select(-1, indices)

    @staticmethod
    def scaled(
        values: Tensor,
        scale: Tensor,
        offset: Tensor,
    ) -> Tensor:
        """Values times a factor, plus an offset."""
        # one pass over them in place of two
        return torch.addcmul(offset, values, scale)

    @staticmethod
    def joined(parts: Sequence[Tensor]) -> Tensor:
        """One part after the other."""
        return torch.cat(tuple(parts), -1)


class ObservationEncoder(nn.Module):
    """Observations ``[*batch, n]`` in physical units to features ``[*batch, size]`` of order one.

    Bounded entries are scaled to -1..1, unbounded ones unchanged. With ``angles="sincos"`` wrapping
    angles become sine and cosine; ``angles="phases"`` adds sine and cosine of the differences
    between angles, goals excluded (the phases of a gait). With ``goals="difference"`` each goal
    adds its difference to the current value, for wrapping angles the shorter way. What a transform
    has scaled comes back to its unit first. ``normalize``: linear entries by the mean and deviation
    of what was seen. Of stacked frames the newest is as if it were alone; older ones are
    differences to it, at `PAST_SHARE` of their size.
    """

    def __init__(
        self,
        layout: ObservationLayout,
        angles: str = "phases",
        goals: str = "difference",
        *,
        normalize: bool = False,
    ) -> None:
        super().__init__()
        self.normalize = normalize
        self.is_scaled = bool(layout.scale)
        self.unit_scale = _constant(layout.scale)
        self.unit_offset = _constant(layout.offset)
        # a goal may be anywhere in its range, whatever goals were learned on
        goal_index = [goal for goal, _ in layout.goals]
        self.seen = SeenInputs(layout.names, layout.wraps, goal_index)

        # each entry is either an angle, with sine and cosine, or scaled
        angle_index: list[int] = []
        linear_index: list[int] = []
        for index, wraps in enumerate(layout.wraps):
            if wraps and angles != "raw":
                angle_index.append(index)
            else:
                linear_index.append(index)

        # Differences to goals and between angles are of the newest frame alone.
        past = layout.past
        goal_pairs: list[tuple[int, int]] = []
        if goals == "difference":
            goal_pairs = [pair for pair in layout.goals if pair[0] not in past]
        phase_index: list[int] = []
        if angles == "phases":
            phase_index = [i for i in angle_index if i not in goal_index and i not in past]
        angle_pairs = list(itertools.combinations(phase_index, 2))

        less_newest = _less_newest(len(layout.wraps), past)
        scale, offset = _unit_scaling(layout)
        self.linear = _constant(linear_index, torch.int64)
        self.scale = _constant(scale[self.linear])
        self.offset = _constant(offset[self.linear])
        self.angle_matrix = _constant(_angle_matrix(less_newest, angle_index, angle_pairs))
        self._plan_goals(layout, goal_pairs, scale)
        self.has_past = bool(past)
        linear_less_newest = less_newest[linear_index][:, linear_index]
        self.past_matrix = _constant(linear_less_newest.T.contiguous())

        # Which features are of older frames, in the order of `forward`: a sine and a cosine of each
        # angle and of each difference between angles.
        circles_are_old = [i in past for i in angle_index] + [False] * len(angle_pairs)
        linear_is_old = [i in past for i in linear_index]
        goals_are_old = [False] * len(goal_pairs)
        is_old = [*linear_is_old, *circles_are_old, *circles_are_old, *goals_are_old]
        old = torch.tensor(is_old, dtype=torch.bool)
        self.share = _constant(torch.where(old, PAST_SHARE, 1.0))
        self.size = len(is_old)

    def _plan_goals(
        self,
        layout: ObservationLayout,
        pairs: Sequence[tuple[int, int]],
        scale: Tensor,
    ) -> None:
        """Constants of the differences to goals, from the indices of each goal and of what is to
        reach it, and the factor ``[n]`` of each entry."""
        periods_deg: list[float] = []
        goal_scale: list[float] = []
        for goal, _ in pairs:
            if layout.wraps[goal]:
                periods_deg.append(FULL_TURN_DEG)
                # half a turn is the largest difference
                goal_scale.append(1 / 180.0)
            else:
                # nothing is the other way round: one formula serves for all goals
                periods_deg.append(math.inf)
                goal_scale.append(float(scale[goal]))
        self.goal = _constant([goal for goal, _ in pairs], torch.int64)
        self.reached = _constant([reached for _, reached in pairs], torch.int64)
        self.period = _constant(periods_deg)
        self.goal_scale = _constant(goal_scale)

    def forward(self, observation: Tensor) -> Tensor:
        """Features: scaled entries, then all sines, all cosines, all goal differences."""
        observation = self.seen(self.in_units(observation))
        if self.normalize:
            linear = self.seen.normalised(observation).index_select(-1, self.linear)
        else:
            linear = scaled_entries(observation, self, TensorOperations)
        # after the scaling, which is the same in each frame: a difference needs no offset
        if self.has_past:
            linear = linear @ self.past_matrix
        features: Tensor = with_circles_and_goals(linear, observation, self, TensorOperations)
        if self.has_past:
            features = features * self.share
        return features

    def in_units(self, observation: Tensor) -> Tensor:
        """Observations ``[*batch, n]`` in physical units."""
        if not self.is_scaled:
            return observation
        return (observation - self.unit_offset) / self.unit_scale


def _less_newest(count: int, past: Mapping[int, int]) -> Tensor:
    """A row for each of ``count`` entries, of what it is made: itself, and in an older frame less
    the same entry of the newest one (``past``)."""
    rows = torch.eye(count)
    rows[list(past), list(past.values())] = -1.0
    return rows


def _angle_matrix(
    less_newest: Tensor,
    angle_index: Sequence[int],
    pairs: Sequence[tuple[int, int]],
) -> Tensor:
    """A column for each angle, and for each difference of a pair of angles: one product
    ``observation @ matrix`` gives all of them in radians."""
    one_rad = less_newest * (math.pi / 180.0)
    first = [i for i, _ in pairs]
    second = [i for _, i in pairs]
    differences = one_rad[first] - one_rad[second]
    rows = torch.cat((one_rad[list(angle_index)], differences))
    return rows.T.contiguous()


def _unit_scaling(layout: ObservationLayout) -> tuple[Tensor, Tensor]:
    """Factor and offset ``[n]`` of each entry, by which low..high becomes -1..1; an unbounded one
    stays as it is."""
    low = torch.tensor(layout.low)
    high = torch.tensor(layout.high)
    is_finite = torch.isfinite(low) & torch.isfinite(high)
    # an entry of one value has no range to divide by
    is_bounded = is_finite & (high > low)
    span = high - low
    scale = torch.where(is_bounded, 2.0 / span, 1.0)
    offset = torch.where(is_bounded, -(high + low) / span, 0.0)
    return scale, offset


def _constant(values: Any, dtype: torch.dtype | None = None) -> nn.Buffer:
    """A tensor that moves with its module and is not in its state."""
    return nn.Buffer(torch.as_tensor(values, dtype=dtype), persistent=False)
