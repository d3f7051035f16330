"""System identification: fit of a twin's physics to a recorded robot's motion.

The recorded commands are replayed on virtual hubs, at the recorded times of the hub's clock, and
the parameters are optimised for the best agreement of the channels. Sensor noise is estimated from
the rest at the start of the log. A parameter that the log does not identify keeps its default, and
is reported as such.
"""

from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray
from scipy.optimize import minimize
from scipy.stats import qmc

from brickhub.errors import TwinError
from brickhub.hub.link.lockstep import HubLink
from brickhub.hub.link.profiles import IDEAL
from brickhub.robot import Robot, UltrasonicSensor
from brickhub.seed import check_seed
from brickhub.virtual.machine import CONTROL_LOOP_MS
from brickhub.virtual.virtual_transport import VirtualHub
from bricktwin import robots
from bricktwin.twin.make_body import make_body
from bricktwin.twin.motion_log import RunLog
from bricktwin.twin.physics import FITTED, PARAMETERS, Physics
from bricktwin.twin.scene import Scene

Vector = NDArray[np.float64]
OnReplay = Callable[[int, float], None]
"""A function that is called with the number of a replay, from 1, and the smallest error so far."""

_STRONG = ("battery_v", "motor_friction_scale", "mass_scale")
"""Parameters that affect all angles. The others affect details, and are fitted after these."""
_STARTS = 2
"""Points of the scan from which a search begins."""
_WIDE = 0.15
"""Size of the first simplex of a search, as a share of each parameter's range."""
_NARROW = 0.06
"""Size of the first simplex of the last search, which begins near the optimum."""
_SCAN = 21
"""Replays of the scan per parameter."""
_LONG = 20
"""Replays of a long search per parameter."""
_SHORT = 16
"""Replays of a short search per parameter."""
_DEVIATION = 0.25
"""Share of the randomization range by which a parameter is put off, to see if it is identified."""
_MIN_RISE = 0.15
"""Relative rise of the error from which on a parameter counts as identified."""
_MIN_ERROR = 0.01
"""Least error, in roughnesses, as which smaller ones count."""
_MIN_REST_STEPS = 4
"""Number of steps up to which a rest tells nothing about the noise."""
_HUBER_DELTA = 3.0
"""Differences beyond this many roughnesses count linearly rather than quadratically."""
_NOISES = tuple(name for name in PARAMETERS if "noise" in name)
_NOISE_FREE = dict.fromkeys(_NOISES, 0.0)
_LEAD_MS = 1
"""The hub's program receives a command of the host one millisecond later."""


@dataclass(frozen=True)
class FittedPhysics:
    """Result of fitting a twin to a log.

    Attributes:
        physics: the twin's parameters; those that the log does not identify are the defaults.
        identified: identified parameters, and the relative rise of the error when a parameter is
            off by a quarter of its randomization range.
        unidentified: parameters that were fitted but not identified.
        error_before, error_after: root mean square error of each channel, in its unit, with the
            default and with the fitted physics.
        replays: number of replays of the log.
    """

    physics: Physics
    identified: dict[str, float]
    unidentified: tuple[str, ...]
    error_before: dict[str, float]
    error_after: dict[str, float]
    replays: int


def replay(
    log: RunLog,
    physics: Physics,
    robot: Robot | None = None,
    scene: Scene | None = None,
) -> Vector:
    """Channels ``[n + 1, n_channels]`` of a noise-free twin that gets a log's commands at the same
    times, by default on a floor with the wall that the log shows. Raises UnknownNameError or
    TwinError if there is no such robot, or it has no twin."""
    if robot is None:
        robot = robots.get(log.robot)
    # Noise and delays are off, because the commands are given at the times of the log.
    quiet = replace(physics, **_NOISE_FREE).with_link(IDEAL)
    hub = VirtualHub(make_body(robot, scene=scene or _scene(log), physics=quiet))
    channels = []
    with HubLink(hub, robot, log.interface) as link:
        channels.append(link.read().values)
        offset_ms = hub.machine.time_ms - int(log.times_ms[0])
        # Commands must meet the control loop at the same point of its period as in the log.
        offset_ms += -offset_ms % CONTROL_LOOP_MS
        for command, start_ms in zip(log.commands, _starts_ms(log, physics), strict=True):
            wait_ms = offset_ms + start_ms - _LEAD_MS - hub.machine.time_ms
            if wait_ms > 0:
                # Reading lets the time of the virtual hub pass.
                hub.read(wait_ms / 1000)
            channels.append(link.act(command).values)
    return np.array(channels, dtype=np.float64)


def fit(
    log: RunLog,
    *,
    robot: Robot | None = None,
    scene: Scene | None = None,
    names: Sequence[str] = FITTED,
    seed: int = 0,
    on_replay: OnReplay | None = None,
) -> FittedPhysics:
    """Fit a twin's physics to a log, with some 300 replays: two minutes on one core for ten seconds
    of log.

    Args:
        robot: robot of the log; ``None`` for the built-in one of that name.
        scene: its surroundings; ``None`` for a floor with the wall that the log shows, if any.
        names: parameters to fit.
        seed: seed of the initial points of the search.

    Raises:
        TwinError: motion cannot identify a parameter, or the log is too short.
        DescriptionError: the seed is invalid.
    """
    check_seed(seed)
    unknown = sorted(set(names) - set(FITTED))
    if unknown or not names:
        raise TwinError(
            f"motion does not tell {', '.join(unknown) or 'nothing'}; choose from "
            f"{', '.join(FITTED)}"
        )
    if len(log.commands) < 2 * len(names):
        raise TwinError(
            f"the log has {len(log.commands)} steps; record {2 * len(names)} or more, `bricktwin "
            "twin record` makes 160"
        )
    search = _Search(
        log,
        robot,
        scene,
        _noise(log),
        on_replay,
    )
    default = Physics()
    error_before = search.errors(default)
    physics = Physics(**search.noise)
    rises = {}
    # A robot that only rests shows its noise and nothing else.
    if log.commands.any():
        physics = search.find(tuple(names), seed)
        rises = search.rises(physics, tuple(names))
    identified = {name: rise for name, rise in rises.items() if rise >= _MIN_RISE}
    unidentified = tuple(name for name in names if name not in identified)
    # Parameters that the log does not identify keep their defaults, because what the search made of
    # them is chance.
    physics = replace(physics, **{name: getattr(default, name) for name in unidentified})
    error_after = search.errors(physics)
    return FittedPhysics(
        physics=physics,
        identified=identified,
        unidentified=unidentified,
        error_before=error_before,
        error_after=error_after,
        replays=search.replays,
    )


class _Search:
    """Search for the parameters, with a counter of replays."""

    def __init__(
        self,
        log: RunLog,
        robot: Robot | None,
        scene: Scene | None,
        noise: dict[str, float],
        on_replay: OnReplay | None,
    ) -> None:
        self.noise = noise
        self.replays = 0
        self._log = log
        self._robot = robot
        self._scene = scene
        self._on_replay = on_replay
        self._lowest = np.inf
        channels = log.interface.channels
        self._wraps = np.array([channel.wraps for channel in channels])
        # Differences are measured in these deviations, so that channels of different units count
        # alike.
        sigma = []
        for channel in channels:
            deviation = noise.get(channel.noise or "", 0.0)
            sigma.append(np.hypot(channel.roughness, deviation))
        self._sigma = np.array(sigma)

    def difference(self, physics: Physics) -> Vector:
        """Channels of twin minus robot, ``[n, n_channels]``; wrapped angles are compared relative
        to the start."""
        channels = replay(
            self._log,
            physics,
            self._robot,
            self._scene,
        )
        difference = channels - self._log.channels  # [n + 1, n_channels]
        # Headings are compared the shorter way round, because whole turns are no error.
        wrapped = (difference - difference[0] + 180.0) % 360.0 - 180.0
        difference = np.where(self._wraps, wrapped, difference)[1:]
        self.replays += 1
        squares = (difference / self._sigma) ** 2
        error = float(np.sqrt(np.mean(squares)))
        self._lowest = min(self._lowest, error)
        if self._on_replay is not None:
            self._on_replay(self.replays, self._lowest)
        return difference

    def errors(self, physics: Physics) -> dict[str, float]:
        """Root mean square difference of each channel."""
        squares = self.difference(physics) ** 2
        rms = np.sqrt(squares.mean(axis=0))  # [n_channels]
        names = [channel.name for channel in self._log.interface.channels]
        return dict(zip(names, rms.tolist(), strict=True))

    def error(self, physics: Physics) -> float:
        """Objective: a robust root mean square (pseudo-Huber loss) of the scaled differences."""
        # The loss grows as the square of small differences but only in proportion to large ones, so
        # that a robot that slips once does not decide everything.
        squares = (self.difference(physics) / self._sigma) ** 2
        roots = np.sqrt(1.0 + squares / _HUBER_DELTA**2)
        losses = 2.0 * _HUBER_DELTA**2 * (roots - 1.0)
        return float(np.sqrt(np.mean(losses)))

    def find(
        self,
        names: tuple[str, ...],
        seed: int,
    ) -> Physics:
        """Fit the strong parameters, then the weak ones, then the strong ones again."""
        strong = tuple(name for name in names if name in _STRONG)
        weak = tuple(name for name in names if name not in _STRONG)
        best = Physics(**self.noise)
        if strong:
            starts = self.scan(best, strong, seed)
            # The error has several valleys, so the search starts from several points.
            refined = (self.refine(start, strong, _WIDE, _LONG) for start in starts)
            best = min(refined, key=self.error)
        if weak:
            best = self.refine(best, weak, _WIDE, _SHORT)
        return self.refine(best, strong, _NARROW, _SHORT) if strong else best

    def scan(
        self,
        base: Physics,
        names: tuple[str, ...],
        seed: int,
    ) -> list[Physics]:
        """The best of quasi-random points spread over all ranges."""
        sequence = qmc.Halton(len(names), rng=seed)
        points = sequence.random(_SCAN * len(names))
        candidates = [base, *(self._physics(base, names, point) for point in points)]
        best_first = sorted(candidates, key=self.error)
        return best_first[:_STARTS]

    def refine(
        self,
        start: Physics,
        names: tuple[str, ...],
        width: float,
        replays: int,
    ) -> Physics:
        """Local search with Nelder-Mead, without gradients, as these vanish in the rounding of the
        angles.

        Args:
            width: size of the initial simplex, as a share of each parameter's range.
            replays: maximum number of replays per parameter.
        """
        start_shares = []
        for name in names:
            bounds = _bounds(name)
            above_low = getattr(start, name) - bounds[0]
            start_shares.append(above_low / np.ptp(bounds))
        shares = np.array(start_shares)
        # The simplex extends away from the nearer bound, where it would be clipped flat.
        inwards = np.where(shares > 0.5, -width, width)
        edges = np.diag(inwards)  # [n, n]
        simplex = np.vstack((shares, shares + edges))  # [n + 1, n]

        def error_at(shares: Vector) -> float:
            return self.error(self._physics(start, names, shares))

        result = minimize(
            error_at,
            shares,
            method="Nelder-Mead",
            bounds=[(0.0, 1.0)] * len(names),
            options={
                "initial_simplex": simplex,
                "maxfev": replays * len(names),
            },
        )
        return self._physics(start, names, result.x)

    def rises(
        self,
        best: Physics,
        names: tuple[str, ...],
    ) -> dict[str, float]:
        """Relative rise of the error when one parameter is off, averaged over both sides."""
        lowest = max(self.error(best), _MIN_ERROR)
        rises = {}
        for name in names:
            deviation = _DEVIATION * np.ptp(PARAMETERS[name].random_range)
            low, high = PARAMETERS[name].allowed_range
            errors = []
            for sign in (-1.0, 1.0):
                value = getattr(best, name) + sign * deviation
                # A parameter at an end of its allowed range can be off to one side only.
                if low <= value <= high:
                    off = replace(best, **{name: float(value)})
                    errors.append(self.error(off))
            mean = sum(errors) / len(errors)
            rises[name] = mean / lowest - 1.0
        return rises

    def _physics(
        self,
        base: Physics,
        names: tuple[str, ...],
        shares: Vector,
    ) -> Physics:
        """Parameters at shares 0..1 of their search ranges."""
        values = {}
        for name, share in zip(names, shares, strict=True):
            low, high = _bounds(name)
            values[name] = float(low + share * (high - low))
        return replace(base, **values)


def _bounds(name: str) -> Vector:
    """Search range of a parameter: its randomization range, extended by half to either side."""
    low, high = PARAMETERS[name].random_range
    lowest, highest = PARAMETERS[name].allowed_range
    margin = (high - low) / 2
    lower = max(lowest, low - margin)
    upper = min(highest, high + margin)
    return np.array([lower, upper])


def _scene(log: RunLog) -> Scene | None:
    """Scene with a wall at the distance that the robot measured at the start, if any."""
    index = log.interface.distance_index
    if index is None:
        return None
    distance_mm = float(log.channels[0, index])
    # A reading at either end of the sensor's range may mean that nothing was seen.
    if not UltrasonicSensor.NEAREST_MM < distance_mm < UltrasonicSensor.FARTHEST_MM:
        return None
    return Scene(wall_distance_mm=(distance_mm, distance_mm))


def _starts_ms(log: RunLog, physics: Physics) -> NDArray[np.int64]:
    """Start of each command, on the hub's clock of the log."""
    settle = log.interface.settle
    if settle.fixed_ms is not None:
        # With a fixed time, the hub begins a command, waits for that time, and then answers.
        return log.times_ms[1:] - settle.fixed_ms
    # Otherwise the start follows from the time that the host took, and the link's way to the hub
    # and back.
    idle_ms = np.round(log.gaps_ms + physics.link_interval_ms)
    return log.times_ms[:-1] + idle_ms.astype(np.int64)


def _noise(log: RunLog) -> dict[str, float]:
    """Sensor noise, from the rest at the start; only for sensors in the log."""
    moving = np.flatnonzero(log.commands.any(axis=1))
    rest_steps = int(moving[0]) if len(moving) else len(log.commands)
    rest = log.channels[: rest_steps + 1]
    if len(rest) <= _MIN_REST_STEPS:
        return {}
    deviations = rest.std(axis=0, ddof=1)
    means = rest.mean(axis=0)
    squares: dict[str, list[float]] = {}
    for channel, deviation, mean in zip(
        log.interface.channels,
        deviations,
        means,
        strict=True,
    ):
        is_saturated = mean >= channel.high
        if channel.noise is None or is_saturated:
            continue
        # Where noise grows with the reading, that share is known, and only the rest is fitted.
        share = 0.0 if channel.noise_share is None else getattr(Physics(), channel.noise_share)
        remaining = max(0.0, float(deviation) - share * mean)
        squares.setdefault(channel.noise, []).append(remaining**2)
    noise = {}
    for name, values in squares.items():
        _, highest = PARAMETERS[name].allowed_range
        mean = float(np.sqrt(np.mean(values)))
        noise[name] = min(mean, highest)
    return noise
