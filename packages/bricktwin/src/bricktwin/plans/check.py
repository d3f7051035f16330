"""Check of a plan: mistakes with their lines in the file and what to do."""

from collections import Counter
from collections.abc import Iterable, Iterator, Sequence
from dataclasses import dataclass

import numpy as np

from brickhub.errors import counted
from brickhub.finding import Finding, Outcome
from brickhub.robot import HubKind, MotorKind, SensorKind
from brickhub.robot.hardware import MotorModel, SensorModel
from bricktwin.plans.bodies import MAX_BODIES, RATE_LENGTH, Bodies, find_bodies
from bricktwin.plans.building import Fault, Occupancy, step_faults
from bricktwin.plans.connections import Connection, Mesh, connections, meshes, neighbours, reached
from bricktwin.plans.geometry import MM_PER_LDU, Floats
from bricktwin.plans.part import DeviceKind
from bricktwin.plans.plan import Placed, Plan, Unknown

_MAX_NAMES = 5
_MIN_RATE = 0.02
_SPINNING = ("axles", "pins", "bushes")
"""Families whose spin about their own axis moves nothing; those with an axis along x first."""
_REACH = 40.0
"""Distance at which an unknown part may hold others, LDU: half of a Brick 2 x 4."""
_SLACK_MM = 30.0
"""Length that the bends of a cable need."""
_Mistake = tuple[int, str, str]
"""A mistake: its line in the file (0 for the whole plan), its name, and what is wrong and what to
do."""


@dataclass(frozen=True)
class Structure:
    """Connections, meshing and chained gears, and bodies of a plan."""

    connections: tuple[Connection, ...]
    meshes: tuple[Mesh, ...]
    bodies: Bodies


def structure_of(plan: Plan) -> Structure:
    """Compute the structure of a plan."""
    links = connections(plan.parts)
    gears = meshes(plan.parts)
    return Structure(tuple(links), tuple(gears), find_bodies(plan.parts, links, gears))


def check(plan: Plan) -> list[Finding]:
    """All findings about a plan, in the order of its lines; empty if it can be built."""
    mistakes = [(fault.line, "unreadable", fault.text) for fault in plan.faults]
    if plan.parts:
        structure = structure_of(plan)
        occupancy = Occupancy(plan.parts)
        guesses = held_by_unknown(plan, plan.unknown)
        mistakes += _check_connections(plan, structure, guesses)
        collisions = [
            (plan.parts[index], plan.parts[other]) for index, other in occupancy.collisions()
        ]
        for first, second in collisions:
            text = f"{second.name} is inside {first.name} of line {first.line}; move one of the two"
            mistakes.append((second.line, "collision", text))
        mistakes += _check_gears(plan, structure)
        mistakes += _check_motions(plan, structure, guesses)
        colliding = {placed.index for pair in collisions for placed in pair}
        mistakes += _check_steps(
            plan,
            structure,
            occupancy,
            colliding,
            guesses,
        )
        mistakes += _check_wiring(plan)
    mistakes += _check_count(plan)
    mistakes += [(lack.line, "not drawn", lack.text) for lack in plan.undrawn]
    return [Finding(name, Outcome.ERROR, text, line) for line, name, text in sorted(mistakes)]


def held_by_unknown(plan: Plan, unknowns: Iterable[Unknown]) -> list[frozenset[int]]:
    """The parts around each place of unknown parts, which may hold these parts together."""
    low = np.array([placed.bounds[0] for placed in plan.parts]).reshape(-1, 3)
    high = np.array([placed.bounds[1] for placed in plan.parts]).reshape(-1, 3)
    groups = []
    for unknown in unknowns:
        for position in unknown.positions:
            # A gap below 0 [n] means that the place is inside of a part's bounds, which is near
            # too.
            gap = np.maximum(low - position, position - high).max(axis=1)
            groups.append(frozenset(np.flatnonzero(gap < _REACH).tolist()))
    return groups


def _check_count(plan: Plan) -> Iterator[_Mistake]:
    """Unknown parts, and a part count other than declared."""
    for unknown in plan.unknown:
        times = "once" if len(unknown.lines) == 1 else f"{len(unknown.lines)} times"
        text = (
            f"part {unknown.number} ({times}) is not in the catalogue; use another, or add it there"
        )
        if unknown.is_file:
            text = (
                f"{unknown.number} ({times}) is a model in a file of its own, which is not "
                "beside the plan; put it there, or join"
            )
            text += " both into one .mpd"
        held = frozenset().union(*held_by_unknown(plan, [unknown]))
        if held:
            text += f"; what it holds, of {counted(len(held), 'part')} around it, is not checked"
        yield unknown.lines[0], "missing file" if unknown.is_file else "unknown part", text
    # Unknown and unreadable parts count too, because each line that places something is a part of
    # the robot.
    unknown_count = sum(len(unknown.lines) for unknown in plan.unknown)
    count = len(plan.parts) + unknown_count + len(plan.drawn) + len(plan.faults)
    if plan.count not in (None, count):
        yield (
            0,
            "count",
            (
                f"the plan says PARTS {plan.count}, but places {count}; put back what is "
                "missing, or "
                "correct the number"
            ),
        )


def _check_connections(
    plan: Plan,
    structure: Structure,
    guesses: Sequence[frozenset[int]],
) -> Iterator[_Mistake]:
    """Pins in axle holes, misaligned axles, connections that are not deep enough, unconnected
    parts."""
    for link in structure.connections:
        male = plan.parts[link.male]
        female = plan.parts[link.female]
        pair = f"{male.name} and {female.name} of line {female.line}"
        if not link.fits:
            yield male.line, "misfit", f"{pair}: a pin does not go into an axle hole; use an axle"
        elif link.is_crossed:
            yield (
                male.line,
                "misfit",
                f"{pair}: the axle is misaligned with its hole; turn one of them",
            )
        elif not link.is_seated:
            text = (
                f"{pair}: only {link.depth * MM_PER_LDU:.1f} mm are inside; push it in, or use "
                "a longer part"
            )
            yield male.line, "half-held", text
    connected = {part for members in structure.bodies.members for part in members}
    if guesses:
        connected |= reached([min(connected)], neighbours(structure.connections, guesses))
    for placed in plan.parts:
        if placed.index not in connected and not placed.part.is_loose:
            yield (
                placed.line,
                "loose",
                (
                    f"{placed.name} is not connected to the main body; add a pin or an axle, or "
                    "remove it"
                ),
            )
    guessed = frozenset().union(*guesses)
    uses = Counter(link.male for link in structure.connections if link.fits)
    for placed in plan.parts:
        if placed.part.family == "pins" and uses[placed.index] == 1 and placed.index not in guessed:
            yield (
                placed.line,
                "half-held",
                f"{placed.name} goes into one part only; add a second part, or remove it",
            )


def _check_gears(plan: Plan, structure: Structure) -> Iterator[_Mistake]:
    """Adjacent gears that mesh badly."""
    for mesh in structure.meshes:
        if mesh.is_good:
            continue
        first = plan.parts[mesh.first]
        second = plan.parts[mesh.second]
        yield (
            second.line,
            "gears",
            f"the teeth of {second.name} and {first.name} of line {first.line} {mesh.fault}",
        )


def _check_motions(
    plan: Plan,
    structure: Structure,
    guesses: Sequence[frozenset[int]],
) -> Iterator[_Mistake]:
    """Findings on parts that move although all motors are braked, and on motors that cannot
    turn."""
    bodies = structure.bodies
    if len(bodies.members) > MAX_BODIES:
        yield (
            0,
            "half-held",
            (
                f"{len(bodies.members)} parts or groups of parts can move, too many to check; "
                "connect them"
            ),
        )
        return
    motors = [joint.motor for joint in bodies.joints if joint.motor is not None]
    motions = bodies.motions(locked=motors)
    if motions.shape[1]:
        guessed = frozenset().union(*guesses)
        for number, members in enumerate(bodies.members):
            rates = _remove_spin(plan, members, motions[6 * number : 6 * number + 6])
            # Parts that are marked as free are meant to move, and parts next to unknown ones may be
            # held by these.
            may_move = any(plan.parts[part].is_free or part in guessed for part in members)
            if may_move or np.abs(rates).max() < _MIN_RATE:
                continue
            names = _names([plan.parts[part] for part in members])
            text = (
                f"{names} can swing or slide; connect it at a second place, or write 0 "
                "!BRICKSRL FREE before it"
            )
            yield min(plan.parts[part].line for part in members), "half-held", text
    yield from _check_motors(plan, bodies, motors)


def _remove_spin(
    plan: Plan,
    members: tuple[int, ...],
    rates: Floats,
) -> Floats:
    """Rates [6, n] of a body; an axle with bushes may spin, and so may a pin, so their spin is
    removed."""
    placed = [plan.parts[part] for part in members]
    bars: list[Placed] = []
    for family in _SPINNING[:2]:
        bars += [part for part in placed if part.part.family == family]
    if not bars or any(part.part.family not in _SPINNING for part in placed):
        return rates
    axis = bars[0].rotation[:, 0]
    point = bars[0].position / RATE_LENGTH
    angular = rates[3:]
    # The spin is removed by keeping only what it leaves alone: the velocity of a point on the axis,
    # and the angular rate across it.
    linear = rates[:3] + np.cross(angular, point, axis=0)
    across = angular - np.outer(axis, axis @ angular)
    return np.concatenate([linear, across])


def _check_motors(
    plan: Plan,
    bodies: Bodies,
    motors: list[int],
) -> Iterator[_Mistake]:
    if not motors:
        return
    motions = bodies.motions()
    rates = np.array(
        [joint.rates(motions) for joint in bodies.joints if joint.motor is not None]
    ).reshape(len(motors), -1)
    locked = [
        motor
        for motor, row in zip(motors, rates, strict=True)
        if not len(row) or np.abs(row).max() < _MIN_RATE
    ]
    for motor in locked:
        text = (
            f"{plan.parts[motor].name} cannot turn: its load is fixed to its mount; remove a "
            "pin or a gear"
        )
        yield plan.parts[motor].line, "locked", text
    rank = int(np.linalg.matrix_rank(rates, tol=_MIN_RATE)) if rates.size else 0
    if rank < len(motors) - len(locked):
        names = ", ".join(
            f"line {plan.parts[motor].line}" for motor in motors if motor not in locked
        )
        yield (
            plan.parts[motors[0]].line,
            "locked",
            f"motors block one another ({names}): they drive the same part; remove one",
        )


def _names(placed: list[Placed]) -> str:
    counts = Counter(part.name for part in placed)
    names = [f"{count} x {name}" if count > 1 else name for name, count in counts.items()]
    text = ", ".join(names[:_MAX_NAMES])
    if len(names) > _MAX_NAMES:
        text += f" and {len(names) - _MAX_NAMES} more"
    return text


def _check_steps(
    plan: Plan,
    structure: Structure,
    occupancy: Occupancy,
    colliding: set[int],
    guesses: Sequence[frozenset[int]],
) -> Iterator[_Mistake]:
    for fault in step_faults(
        plan,
        structure.connections,
        occupancy,
        guesses,
    ):
        placed = [
            plan.parts[part]
            for part in fault.parts
            if fault.kind is not Fault.BLOCKED or part not in colliding
        ]
        if not placed:
            continue
        yield (
            placed[0].line,
            "step",
            f"step {fault.step.index + 1}: {_names(placed)} {fault.kind.value}",
        )


def _check_wiring(plan: Plan) -> Iterator[_Mistake]:
    """Findings about hub, ports and cables."""
    hubs = plan.devices(DeviceKind.HUB)
    devices = plan.devices(DeviceKind.MOTOR, DeviceKind.SENSOR)
    if len(hubs) != 1:
        if devices or len(hubs) > 1:
            fault = "has no hub; add one" if not hubs else f"has {len(hubs)} hubs; leave one"
            yield hubs[-1].line if hubs else 0, "wiring", f"the plan {fault}"
        return
    positions = dict(hubs[0].electric.ports)
    used: dict[str, Placed] = {}
    for placed in devices:
        if placed.port is None:
            yield (
                placed.line,
                "wiring",
                f"{placed.name} has no port; write 0 !BRICKSRL PORT and its letter before it",
            )
        elif placed.port not in positions:
            text = (
                f"{placed.name} is on port {placed.port}, but the hub has "
                f"{', '.join(sorted(positions))}; choose one of these"
            )
            yield placed.line, "wiring", text
        elif placed.port in used:
            other = used[placed.port].line
            text = (
                f"{placed.name} is on port {placed.port}, and so is the one of line {other}; "
                "give each its own"
            )
            yield placed.line, "wiring", text
        else:
            used[placed.port] = placed
            yield from _fit(hubs[0], placed, placed.port)
            yield from _cable(hubs[0], positions[placed.port], placed)


def _fit(
    hub: Placed,
    placed: Placed,
    port: str,
) -> Iterator[_Mistake]:
    """Finding about a plug that does not fit its port."""
    fitting = HubKind(hub.electric.name).model.takes(_model_of(placed))
    if port not in fitting:
        remedy = (
            f"choose one of {', '.join(fitting)}" if fitting else "take one of the hub's family"
        )
        text = f"{placed.name} does not fit port {port} of {hub.name}; {remedy}"
        yield placed.line, "wiring", text


def _model_of(placed: Placed) -> MotorModel | SensorModel:
    """The kind of a motor or sensor, as robots have it."""
    device = placed.electric
    if device.kind is DeviceKind.MOTOR:
        return MotorKind(device.name).model
    return SensorKind(device.name).model


def _cable(
    hub: Placed,
    position: tuple[float, float, float],
    placed: Placed,
) -> Iterator[_Mistake]:
    length_mm = placed.electric.cable_mm
    way = hub.point(position) - placed.point(placed.electric.plug)
    # The way goes straight through everything, so a cable that is too short for it surely is too
    # short.
    needed_mm = float(np.linalg.norm(way)) * MM_PER_LDU + _SLACK_MM
    if needed_mm > length_mm:
        text = (
            f"the cable of {placed.name} has {length_mm:.0f} mm, but port {placed.port} needs "
            f"{needed_mm:.0f}; use a nearer port"
        )
        yield placed.line, "wiring", text
