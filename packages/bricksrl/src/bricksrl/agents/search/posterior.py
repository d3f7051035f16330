"""Posterior of a Gaussian process (Rasmussen and Williams, 2006): what the scores of some trials
say of all others."""

import math

import torch
from torch import Tensor

from brickhub.entry import Entry

REACH = 0.3
"""Lengths of what is peculiar to a later world, as a share of those that all worlds share."""
LEVEL = 0.5
"""Level of a later world, as a share of the amplitude."""


class Posterior:
    """A Gaussian process given scores ``[k]`` of points ``[k, p, 2]``, see `embedded`; its scales
    are the most probable ones.

    The kernel is the squared exponential of the distance, for angles the periodic kernel (MacKay,
    1998). All ``worlds`` ``[k]`` share the process of the first one, 0; a later one has a level and
    a process of its own on top, which varies faster. The present world is that of the last score.
    The scales are log-normal beforehand, for scores of variance 1.
    """

    MEDIAN = (1.7, 0.2, 1.0, 0.3)
    """Beforehand: length (of half a range, or in radians), what is peculiar to a world as a share
    of the amplitude, amplitude, and standard deviation of the noise."""
    SPREAD = 0.5
    """Standard deviation of their logarithms."""

    def __init__(
        self,
        points: Tensor,
        scores: Tensor,
        worlds: Tensor,
    ) -> None:
        # in double precision: points close together make a matrix that is nearly singular
        scores = scores.double()
        self.points = points
        self.worlds = worlds
        self.mean = scores.mean()
        # one score has no deviation, and equal ones have none
        if len(scores) > 1:
            self.unit = scores.std().clamp_min(1e-6)
        else:
            self.unit = torch.ones_like(self.mean)
        self._values = (scores - self.mean) / self.unit
        self._fit_scales()

    def _fit_scales(self) -> None:
        """Find the scales that are most probable given the scores."""
        length, *others = self.MEDIAN
        # one length for each number, then what all share: [p + 3]
        medians = torch.tensor([length] * self.points.shape[1] + others)
        # logarithms: the optimiser then needs no limits to keep the scales positive
        median = medians.double().log()
        self.scales = median.clone().requires_grad_()
        optimizer = torch.optim.LBFGS([self.scales], max_iter=30, line_search_fn="strong_wolfe")

        def loss() -> Tensor:
            optimizer.zero_grad()
            self._factorise()
            # The negative log of the marginal likelihood (Rasmussen and Williams, 2006, eq. 5.8)
            # without its constant, and that of the scales' own distribution: few trials alone would
            # let the likelihood explain them by noise or by the shortest lengths.
            fit = (self._values @ self._weights) / 2
            surprise = fit + self._root.diagonal().log().sum()
            deviations = (self.scales - median) / self.SPREAD
            total: Tensor = surprise + (deviations**2).sum() / 2
            total.backward()
            return total

        optimizer.step(loss)
        with torch.no_grad():
            self._factorise()

    def _kernel(
        self,
        a: Tensor,
        b: Tensor,
        a_world: Tensor,
        b_world: Tensor,
    ) -> Tensor:
        """Covariance of points in their worlds."""
        *_, peculiar, amplitude, _ = self.scales.exp()
        lengths = self.scales[:-3].exp()[:, None]
        a = (a / lengths).flatten(1)
        b = (b / lengths).flatten(1)
        # A product of matrices would be faster, but rounds distances of equal points away from 0.
        distance = torch.cdist(a, b, compute_mode="donot_use_mm_for_euclid_dist")
        near = (-distance.square() / 2).exp()
        in_same_later_world = (a_world[:, None] == b_world) & (b_world > 0)
        # a length that is REACH times as long is a power of the same exponential
        nearer = near ** (1.0 / REACH**2)
        peculiarities = in_same_later_world * (LEVEL**2 + peculiar**2 * nearer)
        covariance: Tensor = amplitude**2 * (near + peculiarities)
        return covariance

    def _factorise(self) -> None:
        # a trial that is repeated makes equal rows, which only some noise keeps apart
        noise = (2 * self.scales[-1]).exp() + 1e-8
        kernel = self._kernel(
            self.points,
            self.points,
            self.worlds,
            self.worlds,
        )
        noisy_kernel = kernel + noise * torch.eye(len(kernel))
        self._root = torch.linalg.cholesky(noisy_kernel)
        weights = torch.cholesky_solve(self._values[:, None], self._root)  # [k, 1]
        self._weights = weights[:, 0]

    @property
    def noise(self) -> Tensor:
        """Standard deviation of a trial's score."""
        deviation: Tensor = self.unit * self.scales[-1].detach().exp()
        return deviation

    @torch.no_grad()
    def at(self, points: Tensor) -> tuple[Tensor, Tensor]:
        """Mean and standard deviation ``[c]`` of the score in the present world at points ``[c, p,
        2]``, without noise."""
        here = self.worlds[-1:]
        kernel = self._kernel(
            points,
            self.points,
            here,
            self.worlds,
        )
        half = torch.linalg.solve_triangular(self._root, kernel.T, upper=False)
        known = half.square().sum(0)
        # all points have the same variance beforehand, so that the first stands for them
        beforehand = self._kernel(
            points[:1],
            points[:1],
            here,
            here,
        )  # [1, 1]
        # rounded, the difference may fall below 0 at a point that was tried
        variance = (beforehand - known).clamp_min(1e-12)
        deviation = variance.sqrt()[0]
        mean = kernel @ self._weights
        return self.mean + self.unit * mean, self.unit * deviation

    @torch.no_grad()
    def gain(
        self,
        point: Tensor,
        other: Tensor,
    ) -> tuple[float, float]:
        """Mean and standard deviation of the score of ``point`` ``[p, 2]`` less that of the
        ``other``."""
        both = torch.stack((point, other))
        here = self.worlds[-1:]
        kernel = self._kernel(
            both,
            self.points,
            here,
            self.worlds,
        )
        half = torch.linalg.solve_triangular(self._root, kernel.T, upper=False)
        # of both together: near each other they rise and fall as one, and the difference is known
        # better than either
        covariance = self._kernel(both, both, here, here) - half.T @ half  # [2, 2]
        sign = torch.tensor([1.0, -1.0]).double()
        variance = sign @ covariance @ sign
        deviation = variance.clamp_min(0).sqrt()
        mean = sign @ kernel @ self._weights
        return float(self.unit * mean), float(self.unit * deviation)


def bounds(entries: tuple[Entry, ...]) -> tuple[Tensor, Tensor]:
    """Lowest and highest numbers ``[p]``."""
    low = torch.tensor([entry.low for entry in entries])
    high = torch.tensor([entry.high for entry in entries])
    return low, high


def embedded(numbers: Tensor, entries: tuple[Entry, ...]) -> Tensor:
    """Numbers ``[c, p]`` as points ``[c, p, 2]``, float64: an angle that wraps on the unit circle,
    others in -1..1."""
    low, high = bounds(entries)
    share = (2 * (numbers - low) / (high - low) - 1).double()  # [c, p], -1..1
    wraps = torch.tensor([entry.wraps for entry in entries])
    angle = math.pi * share
    circle = torch.stack((angle.cos(), angle.sin()), -1)
    # a second coordinate of 0 adds nothing to a distance: one kernel serves for both kinds
    line = torch.stack((share, torch.zeros_like(share)), -1)
    return torch.where(wraps[:, None], circle, line)
