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
"""Called with the number of a replay, from 1, and the smallest error so far."""

# Parameters that affect all angles. The others affect details, and are fitted after these.
_STRONG = ("battery_v", "motor_friction_scale", "mass_scale")
_STARTS = 2
# of a parameter's range
_WIDE = 0.15
_NARROW = 0.06
# replays per parameter
_SCAN = 21
_LONG = 20
_SHORT = 16
# share of the randomization range: a parameter is identified if a deviation by this
_DEVIATION = 0.25
_MIN_RISE = 0.15  # raises the error by this share or more
_MIN_ERROR = 0.01  # smaller errors, in roughnesses, count as this
_MIN_REST_STEPS = 4
# differences beyond this many roughnesses count linearly rather than quadratically
_HUBER_DELTA = 3.0
_NOISES = tuple(name for name in PARAMETERS if "noise" in name)
_NOISE_FREE = dict.fromkeys(_NOISES, 0.0)
# The hub's program receives a command of the host one millisecond later.
_LEAD_MS = 1


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
    log: RunLog, physics: Physics, robot: Robot | None = None, scene: Scene | None = None
) -> Vector:
    """Channels ``[n + 1, n_channels]`` of a noise-free twin that gets a log's commands at the same
    times, by default on a floor with the wall that the log shows. Raises UnknownNameError or
    TwinError if there is no such robot, or it has no twin."""
    robot = robots.get(log.robot) if robot is None else robot
    hub = VirtualHub(
        make_body(
            robot,
            scene=scene or _scene(log),
            physics=replace(physics, **_NOISE_FREE).with_link(IDEAL),
        )
    )
    rows = []
    with HubLink(hub, robot, log.interface) as link:
        first = link.read()
        rows.append(first.values)
        offset_ms = hub.machine.time_ms - int(log.times_ms[0])
        # commands meet the control loop at the same point of its period
        offset_ms += -offset_ms % CONTROL_LOOP_MS
        for command, start_ms in zip(log.commands, _starts_ms(log, physics), strict=True):
            wait_ms = offset_ms + start_ms - _LEAD_MS - hub.machine.time_ms
            if wait_ms > 0:
                hub.read(wait_ms / 1000)
            rows.append(link.act(command).values)
    return np.array(rows, dtype=np.float64)


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
    search = _Search(log, robot, scene, _noise(log), on_replay)
    before = search.errors(Physics())
    physics = Physics(**search.noise)
    rises = {}
    if log.commands.any():
        physics = search.find(tuple(names), seed)
        rises = search.rises(physics, tuple(names))
    identified = {name: rise for name, rise in rises.items() if rise >= _MIN_RISE}
    default = Physics()
    unidentified = tuple(name for name in names if name not in identified)
    physics = replace(physics, **{name: getattr(default, name) for name in unidentified})
    return FittedPhysics(
        physics, identified, unidentified, before, search.errors(physics), search.replays
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
        self._sigma = np.array(
            [
                np.hypot(channel.roughness, noise.get(channel.noise or "", 0.0))
                for channel in channels
            ]
        )

    def difference(self, physics: Physics) -> Vector:
        """Channels of twin minus robot, ``[n, n_channels]``; wrapped angles are compared relative
        to the start."""
        difference = replay(self._log, physics, self._robot, self._scene) - self._log.channels
        difference = np.where(
            self._wraps, (difference - difference[0] + 180.0) % 360.0 - 180.0, difference
        )[1:]
        self.replays += 1
        self._lowest = min(self._lowest, float(np.sqrt(np.mean((difference / self._sigma) ** 2))))
        if self._on_replay is not None:
            self._on_replay(self.replays, self._lowest)
        return difference

    def errors(self, physics: Physics) -> dict[str, float]:
        """Root mean square difference of each channel."""
        rms = np.sqrt((self.difference(physics) ** 2).mean(axis=0))
        return {
            channel.name: float(value)
            for channel, value in zip(self._log.interface.channels, rms, strict=True)
        }

    def error(self, physics: Physics) -> float:
        """Objective: a robust root mean square (pseudo-Huber loss) of the scaled differences."""
        squares = (self.difference(physics) / self._sigma) ** 2
        return float(
            np.sqrt(
                np.mean(2.0 * _HUBER_DELTA**2 * (np.sqrt(1.0 + squares / _HUBER_DELTA**2) - 1.0))
            )
        )

    def find(self, names: tuple[str, ...], seed: int) -> Physics:
        """Fit the strong parameters, then the weak ones, then the strong ones again."""
        strong = tuple(name for name in names if name in _STRONG)
        weak = tuple(name for name in names if name not in _STRONG)
        best = Physics(**self.noise)
        if strong:
            starts = self.scan(best, strong, seed)
            best = min(
                (self.refine(start, strong, _WIDE, _LONG) for start in starts), key=self.error
            )
        if weak:
            best = self.refine(best, weak, _WIDE, _SHORT)
        return self.refine(best, strong, _NARROW, _SHORT) if strong else best

    def scan(self, base: Physics, names: tuple[str, ...], seed: int) -> list[Physics]:
        """The best of quasi-random points spread over all ranges."""
        points = qmc.Halton(len(names), rng=seed).random(_SCAN * len(names))
        return sorted(
            (base, *(self._physics(base, names, point) for point in points)), key=self.error
        )[:_STARTS]

    def refine(self, start: Physics, names: tuple[str, ...], width: float, replays: int) -> Physics:
        """Local search with Nelder-Mead, without gradients, as these vanish in the rounding of the
        angles.

        Args:
            width: size of the initial simplex, as a share of each parameter's range.
            replays: maximum number of replays per parameter.
        """
        shares = np.array(
            [(getattr(start, name) - _bounds(name)[0]) / np.ptp(_bounds(name)) for name in names]
        )
        # Away from the nearer bound, where the initial simplex would be clipped flat.
        corners = shares + np.diag(np.where(shares > 0.5, -width, width))
        result = minimize(
            lambda shares: self.error(self._physics(start, names, shares)),
            shares,
            method="Nelder-Mead",
            bounds=[(0.0, 1.0)] * len(names),
            options={
                "initial_simplex": np.vstack((shares, corners)),
                "maxfev": replays * len(names),
            },
        )
        return self._physics(start, names, result.x)

    def rises(self, best: Physics, names: tuple[str, ...]) -> dict[str, float]:
        """Relative rise of the error when one parameter is off, averaged over both sides."""
        lowest = max(self.error(best), _MIN_ERROR)
        rises = {}
        for name in names:
            deviation = _DEVIATION * np.ptp(PARAMETERS[name].random_range)
            (low, high) = PARAMETERS[name].allowed_range
            values = [getattr(best, name) + sign * deviation for sign in (-1.0, 1.0)]
            errors = [
                self.error(replace(best, **{name: float(value)}))
                for value in values
                if low <= value <= high
            ]
            rises[name] = sum(errors) / len(errors) / lowest - 1.0
        return rises

    def _physics(self, base: Physics, names: tuple[str, ...], shares: Vector) -> Physics:
        """Parameters at shares 0..1 of their search ranges."""
        bounds = [_bounds(name) for name in names]
        values = {
            name: float(low + share * (high - low))
            for name, share, (low, high) in zip(names, shares, bounds, strict=True)
        }
        return replace(base, **values)


def _bounds(name: str) -> Vector:
    """Search range of a parameter: its randomization range, extended by half to either side."""
    low, high = PARAMETERS[name].random_range
    lowest, highest = PARAMETERS[name].allowed_range
    margin = (high - low) / 2
    return np.array([max(lowest, low - margin), min(highest, high + margin)])


def _scene(log: RunLog) -> Scene | None:
    """Scene with a wall at the distance that the robot measured at the start, if any."""
    index = log.interface.distance_index
    distance_mm = 0.0 if index is None else float(log.channels[0, index])
    is_wall = UltrasonicSensor.NEAREST_MM < distance_mm < UltrasonicSensor.FARTHEST_MM
    return Scene(wall_distance_mm=(distance_mm, distance_mm)) if is_wall else None


def _starts_ms(log: RunLog, physics: Physics) -> NDArray[np.int64]:
    """Start of each command, on the hub's clock of the log."""
    settle = log.interface.settle
    if settle.fixed_ms is not None:
        return log.times_ms[1:] - settle.fixed_ms
    return log.times_ms[:-1] + np.round(log.gaps_ms + physics.link_interval_ms).astype(np.int64)


def _noise(log: RunLog) -> dict[str, float]:
    """Sensor noise, from the rest at the start; only for sensors in the log."""
    moving = np.flatnonzero(log.commands.any(axis=1))
    rest = log.channels[: (int(moving[0]) if len(moving) else len(log.commands)) + 1]
    if len(rest) <= _MIN_REST_STEPS:
        return {}
    deviation = rest.std(axis=0, ddof=1)
    squares: dict[str, list[float]] = {}
    for channel, value, mean in zip(
        log.interface.channels, deviation, rest.mean(axis=0), strict=True
    ):
        if channel.noise is None or mean >= channel.high:  # saturated
            continue
        share = 0.0 if channel.noise_share is None else getattr(Physics(), channel.noise_share)
        squares.setdefault(channel.noise, []).append(max(0.0, float(value) - share * mean) ** 2)
    deviations = {name: float(np.sqrt(np.mean(values))) for name, values in squares.items()}
    return {
        name: min(value, PARAMETERS[name].allowed_range[1]) for name, value in deviations.items()
    }
