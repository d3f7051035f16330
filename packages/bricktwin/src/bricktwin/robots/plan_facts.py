"""Facts of building plans: hub, motors and sensors, what each moves, and where it looks; kept
between processes, as reading a plan takes long."""

from __future__ import annotations

import json
import math
from collections.abc import Iterator, Sequence
from pathlib import Path
from typing import TYPE_CHECKING, Any, NamedTuple

from brickhub.robot.spec import LOOKS
from bricktwin.kept import kept
from bricktwin.plans.ldraw_text import sources_of

if TYPE_CHECKING:
    from bricktwin.plans.mechanism.articulation import Drive
    from bricktwin.plans.mechanism.kinematics import Wheel
    from bricktwin.plans.plan import Placed, Plan
    from bricktwin.plans.planned_robot import PlannedRobot

_ALIGNED_COSINE = 0.999
"""Cosine of the largest angle, 2.6 degrees, at which a side of the hub looks along an axis."""
_LOOKS_COSINE = 0.8
"""Cosine of the largest angle, 37 degrees, at which a sensor looks along an axis."""


_TREADS = ("3873",)
"""Parts of chains that real robots drive on."""


class DeviceFacts(NamedTuple):
    """A hub, motor or sensor. Positions and directions are in the twin's axes: x ahead, y to the
    left, z up.

    Attributes:
        name: as in ``bricktwin.robots``.
        part: name of the part.
        line: of the plan.
        port, label: of the plan; "" and ``None`` for a hub, and ``None`` for a device without a
            name.
        sides: of a hub, the directions of its top and its front; fewer if it is at an angle.
        stops_deg: of a motor, the angles of its shaft at which what it drives meets something;
            empty if the plan says none.
        gears, ratio: of a motor, as in ``kinematics.Train``; none and 0 if it drives nothing.
        wheel_mm, wheel_left_m, is_forward: of a motor that turns a wheel: the wheel's diameter, 0
            for none, its position to the left, and whether clockwise rolls forwards.
        role: of a motor, what it moves, a ``Role``; "" if it moves nothing.
        at_m: of a motor, a point of the axis that it turns about; of others, their middle.
        axis: of a motor, the direction of that axis, about which clockwise is positive.
        way_deg: of a joint, the angles of its shaft at which its parts meet others; empty if it
            turns all around.
        looks: of a sensor, a name of ``LOOKS``; "" for one that looks askew.
        turns_with: of a motor, the port of an earlier one that turns it, as on one gear; "" for
            none.
    """

    name: str
    part: str
    line: int
    port: str
    label: str | None
    sides: tuple[str, ...]
    stops_deg: tuple[float, ...]
    gears: tuple[int, ...]
    ratio: float
    wheel_mm: float = 0.0
    wheel_left_m: float = 0.0
    is_forward: bool = True
    role: str = ""
    at_m: tuple[float, ...] = (0.0, 0.0, 0.0)
    axis: tuple[float, ...] = (0.0, 0.0, 0.0)
    way_deg: tuple[float, ...] = ()
    looks: str = ""
    turns_with: str = ""


class PlanFacts(NamedTuple):
    """Devices of a plan.

    Attributes:
        is_wired: whether the plan says the ports; else they were given in the order of its lines.
        lacks: what of the plan has no twin, in words.
    """

    hubs: Sequence[DeviceFacts]
    motors: Sequence[DeviceFacts]
    sensors: Sequence[DeviceFacts]
    is_wired: bool
    lacks: Sequence[str] = ()

    @property
    def hub_sides(self) -> tuple[str, ...]:
        """Directions of the top and the front of the hub; empty if there is none, or it is at an
        angle."""
        return self.hubs[0].sides if self.hubs else ()


def read_facts(path: Path) -> PlanFacts:
    """Facts of a plan file. Raises PlanError if the file is no plan, a motor has no port, or
    something has no twin."""

    def made() -> PlanFacts:
        # This is imported only where it is needed, because that takes longer than reading facts
        # that were kept.
        from bricktwin.plans.planned_robot import planned_robot

        return facts_of(planned_robot(path))

    return kept(
        lambda: (b"facts", *sources_of(path)),
        made,
        lambda facts: json.dumps(facts).encode(),
        _decoded,
    )


def facts_of(design: PlannedRobot) -> PlanFacts:
    """Facts of the robot of a plan."""
    from bricktwin.plans.mechanism.roles import roles_of
    from bricktwin.plans.part import DeviceKind

    roles = roles_of(design.plan, design.articulation)
    hubs = [_device_facts(placed) for placed in design.plan.devices(DeviceKind.HUB)]
    sensors = [_device_facts(placed) for placed in design.plan.devices(DeviceKind.SENSOR)]
    motors: list[DeviceFacts] = []
    for placed in design.plan.devices(DeviceKind.MOTOR):
        role = roles.get(placed.port or "", "")
        motors.append(_motor_facts(design, placed, role))
    return PlanFacts(hubs, motors, sensors, design.is_wired, list(_lacks(design.plan)))


def _lacks(plan: Plan) -> Iterator[str]:
    """What of a plan is left out of its twin, in words."""
    from bricktwin.plans.connections import meshes
    from bricktwin.plans.part import DeviceKind

    for unknown in plan.unknown:
        lines = ", ".join(str(line) for line in unknown.lines)
        yield (
            f"line {lines}: part {unknown.number} is not in the catalogue, so that what it holds "
            "may be loose"
        )
    for lack in plan.undrawn:
        yield f"line {lack.line}: {lack.text}"
    treads = [placed for placed in plan.parts if placed.part.number in _TREADS]
    if treads:
        first = treads[0]
        yield (
            f"line {first.line}: {first.name} turns gears, but drives no robot in its twin, where "
            "treads touch no floor; let it stand on wheels"
        )
    for hub in plan.devices(DeviceKind.HUB)[1:]:
        yield f"line {hub.line}: {hub.name} is a second hub; only the first one counts"
    for mesh in meshes(plan.parts):
        if not mesh.is_good:
            first = plan.parts[mesh.first]
            second = plan.parts[mesh.second]
            yield (
                f"line {second.line}: its teeth do not turn {first.name} of line {first.line}, as "
                f"they {mesh.fault}"
            )


def _device_facts(placed: Placed) -> DeviceFacts:
    """What every device has."""
    from bricktwin.plans.mechanism.kinematics import TO_TWIN, point_m_of

    # In the frame of the part the top is -y, because a plan's y points down, and the front is z.
    top = TO_TWIN @ placed.rotation @ (0.0, -1.0, 0.0)
    front = TO_TWIN @ placed.rotation @ (0.0, 0.0, 1.0)
    sides: list[str] = []
    for axis in (top, front):
        sides += [name for name, look in LOOKS.items() if axis @ look > _ALIGNED_COSINE]
    looks = ""
    if placed.electric.direction is not None:
        direction = TO_TWIN @ placed.rotation @ placed.electric.direction
        looks = next((name for name, look in LOOKS.items() if direction @ look > _LOOKS_COSINE), "")
    x_m, y_m, z_m = point_m_of(placed.position).tolist()
    return DeviceFacts(
        name=placed.electric.name,
        part=placed.name,
        line=placed.line,
        port=placed.port or "",
        label=placed.device,
        sides=tuple(sides),
        stops_deg=placed.stops_deg or (),
        gears=(),
        ratio=0.0,
        at_m=(x_m, y_m, z_m),
        looks=looks,
    )


def _motor_facts(
    design: PlannedRobot,
    placed: Placed,
    role: str,
) -> DeviceFacts:
    """What a motor has beside that: its gears, and what it moves."""
    from bricktwin.plans.planned_robot import stops_deg

    facts = _device_facts(placed)
    port = placed.port or ""
    for train in design.trains:
        if train.port == port:
            facts = facts._replace(gears=train.gears, ratio=train.ratio)
    for drive in design.articulation.drives:
        if drive.port == port:
            # A gear that turns the other way turns the axis round.
            axis = drive.joint.axis * (1.0 if drive.gear > 0 else -1.0)
            facts = facts._replace(
                role=str(role),
                at_m=tuple(drive.joint.point_m.tolist()),
                axis=tuple(axis.tolist()),
                # Turning about +y, which points to the left, rolls and walks forwards.
                is_forward=bool(axis[1] > 0),
            )
    for drive, wheel in design.rolling:
        if drive.port == port:
            facts = facts._replace(
                wheel_mm=wheel.diameter_mm,
                wheel_left_m=float(wheel.centre_m[1]),
            )
            if wheel.link != drive.joint.child:
                facts = _geared_facts(facts, design, drive, wheel)
    for first, second in design.geared_together:
        if second == port and not facts.turns_with:
            facts = facts._replace(turns_with=first)
    if role == "joint" and not facts.stops_deg:
        facts = facts._replace(way_deg=stops_deg(design, port) or ())
    return facts


def _geared_facts(
    facts: DeviceFacts,
    design: PlannedRobot,
    drive: Drive,
    wheel: Wheel,
) -> DeviceFacts:
    """Facts of a motor that turns a wheel through a differential, or with another motor: where and
    how the wheel turns, when all wheels turn alike."""
    from bricktwin.plans.mechanism.open_gears import turn_with

    made = design.articulation
    turn = turn_with(made.couplings, made.joints, drive.joint.child, wheel.link) / drive.gear
    ratio = math.hypot(*turn)
    joint = next(joint for joint in made.joints if joint.child == wheel.link)
    # Motors that turn a wheel one way each may hold it still together.
    axis = turn / ratio if ratio else joint.axis
    return facts._replace(
        ratio=ratio,
        at_m=tuple(joint.point_m.tolist()),
        axis=tuple(axis.tolist()),
        is_forward=bool(axis[1] > 0),
    )


def _decoded(data: bytes) -> PlanFacts:
    """Facts that were kept."""
    *devices, is_wired, lacks = json.loads(data)
    hubs, motors, sensors = ([_device(row) for row in rows] for rows in devices)
    return PlanFacts(hubs, motors, sensors, is_wired, lacks)


def _device(row: Sequence[Any]) -> DeviceFacts:
    # JSON has only lists. With tuples, facts that were kept equal those that were just made.
    values = [tuple(value) if isinstance(value, list) else value for value in row]
    return DeviceFacts._make(values)
