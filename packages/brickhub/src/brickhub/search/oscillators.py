"""Legs that turn endlessly, each held at its phase: a central pattern generator (Ijspeert, 2008)
without states of its own.

All legs turn at one speed, a share of the largest; one that is ahead of its phase is commanded to
fall back to it within the step. The legs of one side lag behind their mirror images by half a turn
(a symmetrical gait, Hildebrand, 1965), so that a robot of ``k`` mirrored pairs has ``k`` numbers,
and walks straight: how far it turns shows in no trial of a few steps.
"""

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass

from brickhub.entry import Entry
from brickhub.errors import DescriptionError
from brickhub.hub.interface import Interface
from brickhub.robot import Robot
from brickhub.search.onboard.turn_legs import turn_legs
from brickhub.search.structure import formula_source

TURN_DEG = 360.0
"""A turn."""
_turn_legs: Callable[..., list[float]] = turn_legs
_LEG_COLUMNS = (
    "# Of a leg: index of the angle, index of the action, sign of both, change of the action for a",
    "# degree, half a turn or none (deg), place of its phase among the numbers or 0.",
)
NO_LEGS = "oscillators need motors that turn endlessly and whose angles are observed; choose linear"


@dataclass(frozen=True)
class Leg:
    """A leg of `Oscillators`.

    Attributes:
        angle, action: indices of its angle among what is observed, and of its action.
        sign: factor of both; -1 for a motor that walks forwards by turning backwards.
        gain: change of an action that turns it one degree further in a step.
        half_turn_deg: half a turn if it lags behind its mirror image, else 0.
        place: index of its phase among the numbers; 0 for a leg of the first pair, which has none,
            as all others lag behind it.
    """

    angle: int
    action: int
    sign: int
    gain: float
    half_turn_deg: float
    place: int

    @property
    def row(self) -> tuple[int, int, int, float, float, int]:
        """Its columns in the formula."""
        return (
            self.angle,
            self.action,
            self.sign,
            self.gain,
            self.half_turn_deg,
            self.place,
        )


class Oscillators:
    """Legs that turn endlessly, each held at its phase.

    Args:
        legs: the legs.
        numbers: the speed, then the phases.
        size: number of actions; motors that are no legs do nothing.
    """

    def __init__(
        self,
        legs: Sequence[Leg],
        numbers: Sequence[Entry],
        size: int,
    ) -> None:
        self.legs = tuple(legs)
        self.numbers = tuple(numbers)
        self.size = size
        self._rows = [leg.row for leg in legs]

    def act(
        self,
        observed: Sequence[float],
        numbers: Sequence[float],
    ) -> list[float]:
        """Actions ``[m]`` on an observation ``[n]`` by numbers ``[p]``, in their units."""
        return _turn_legs(
            self._rows,
            self.size,
            observed,
            numbers,
        )

    def hub_source(self) -> str:
        """MicroPython that defines ``act_by(observed, numbers)``, as `act`."""
        lines = [formula_source("turn_legs"), f"SIZE = {self.size}", *_LEG_COLUMNS, "LEGS = ("]
        for leg in self.legs:
            angle, action, sign, gain, half_turn_deg, place = leg.row
            lines.append(
                f"    ({angle}, {action}, {sign}, {gain:.5g}, {half_turn_deg:g}, {place}),"
            )
        lines += [
            ")",
            "",
            "",
            "def act_by(observed, numbers):",
            "    return turn_legs(LEGS, SIZE, observed, numbers)",
        ]
        return "\n".join(lines) + "\n"


def oscillators(
    robot: Robot,
    interface: Interface,
    *,
    angles: Mapping[str, int] | None = None,
    steps: int = 1,
) -> Oscillators:
    """Oscillators for the legs of a robot.

    Args:
        angles: index of each observed angle that wraps, by the name of its channel; by default the
            channels are what is observed.
        steps: steps of the interface in which an action is repeated.

    Raises:
        DescriptionError: fewer than two motors, and not the only one, turn endlessly and have their
            angles observed.
    """
    if angles is None:
        channels = enumerate(interface.channels)
        angles = {channel.name: index for index, channel in channels if channel.wraps}
    turns_deg = _turns_deg(interface, angles, steps)
    # One motor may turn all legs, which then need only a speed; beside others, it is a turntable.
    turns_all = len(turns_deg) == len(interface.commands) > 0
    if len(turns_deg) < 2 and not turns_all:
        raise DescriptionError(NO_LEGS)
    places = {command.name: index for index, command in enumerate(interface.commands)}
    groups = _groups(robot, list(turns_deg))
    legs: list[Leg] = []
    for place, group in enumerate(groups):
        for in_mirror, name in enumerate(group):
            # A motor that is mounted the other way round walks forwards by turning backwards.
            sign = robot.in_mirror(name)[1] if in_mirror else 1
            leg = Leg(
                angle=angles[f"{name}_angle"],
                action=places[name],
                sign=sign,
                gain=1.0 / turns_deg[name],
                half_turn_deg=in_mirror * TURN_DEG / 2,
                place=place,
            )
            legs.append(leg)
    numbers = [Entry("speed", -1.0, 1.0)]
    for first, *_ in groups[1:]:
        phase = Entry(
            f"{first}_phase",
            0.0,
            TURN_DEG,
            "deg",
            wraps=True,
        )
        numbers.append(phase)
    return Oscillators(legs, numbers, len(interface.commands))


def _groups(robot: Robot, names: Sequence[str]) -> list[tuple[str, ...]]:
    """Legs by pairs of mirror images; a leg without one is a group of its own."""
    groups: list[tuple[str, ...]] = []
    for left, right in robot.mirrored:
        # A motor in the middle is its own image.
        if left in names and right in names and left != right:
            groups.append((left, right))
    paired = {name for group in groups for name in group}
    groups += [(name,) for name in names if name not in paired]
    return groups


def _turns_deg(
    interface: Interface,
    angles: Mapping[str, int],
    steps: int,
) -> dict[str, float]:
    """Degrees that an action of 1 turns in a step, by the name of each motor that turns endlessly
    and whose angle is observed."""
    # Of steps without a fixed time, a second is as good as any.
    step_ms = interface.settle.fixed_ms or 1000
    turns_deg: dict[str, float] = {}
    for command in interface.commands:
        if command.unit == "deg":
            # A command of an absolute angle turns by nothing that is known here.
            deg_per_unit = float(command.is_turn_by)
        elif command.unit == "deg/s":
            deg_per_unit = step_ms / 1000.0
        else:
            deg_per_unit = 0.0
        if deg_per_unit and f"{command.name}_angle" in angles:
            turns_deg[command.name] = deg_per_unit * steps * (command.high - command.low) / 2.0
    return turns_deg
