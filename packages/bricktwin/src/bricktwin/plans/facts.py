"""Facts of a plan that complete a robot's description: its devices, gears and driven wheels. They are kept between processes."""

from __future__ import annotations

import json
from collections.abc import Sequence
from pathlib import Path
from typing import TYPE_CHECKING, NamedTuple

from bricktwin.kept import kept

if TYPE_CHECKING:
    from bricktwin.plans.planned_robot import PlannedRobot


class DeviceFacts(NamedTuple):
    """A hub, motor or sensor.

    Attributes:
        kind: ``"hub"``, ``"motor"`` or ``"sensor"``.
        name: as in ``bricktwin.robots``.
        part: name of the part.
        line: of the plan.
        port, label: of the plan, if it says them.
        top, front: directions [3] of these sides of a hub in the twin's axes.
    """

    kind: str
    name: str
    part: str
    line: int
    port: str | None
    label: str | None
    top: Sequence[float]
    front: Sequence[float]


class WheelFacts(NamedTuple):
    """The wheel that a motor drives: diameter, position to the left, and whether clockwise rolls forwards."""

    port: str
    diameter_mm: float
    left_m: float
    is_clockwise_forward: bool


class GearFacts(NamedTuple):
    """The gear train of a motor, as in ``mechanism.trains.Train``."""

    port: str
    gears: tuple[int, ...]
    ratio: float


class PlanFacts(NamedTuple):
    """Devices in the order hubs, motors, sensors; wheels and gears."""

    all_devices: Sequence[DeviceFacts]
    wheels: Sequence[WheelFacts]
    trains: Sequence[GearFacts]

    def devices(self, *kinds: str) -> list[DeviceFacts]:
        """The hubs, motors or sensors."""
        return [device for device in self.all_devices if device.kind in kinds]


def read_facts(path: Path) -> PlanFacts:
    """Facts of a plan file. Raises PlanError if the file is no plan, a motor has no port, or something has no twin."""

    def made() -> PlanFacts:
        from bricktwin.plans.planned_robot import planned_robot  # takes longer to import than kept facts to read

        return facts_of(planned_robot(path))

    return kept(lambda: (b"facts", path.read_bytes()), made, lambda facts: json.dumps(facts).encode(), _decoded)


def facts_of(design: PlannedRobot) -> PlanFacts:
    """Facts of the robot of a plan."""
    from bricktwin.plans.mechanism.kinematics import TO_TWIN
    from bricktwin.plans.part import DeviceKind

    devices = []
    for part in design.plan.devices(DeviceKind.HUB, DeviceKind.MOTOR, DeviceKind.SENSOR):
        top, front = (TO_TWIN @ part.rotation @ side for side in ((0.0, -1.0, 0.0), (0.0, 0.0, 1.0)))
        kind, name = part.electric.kind.value, part.electric.name
        devices.append(DeviceFacts(kind, name, part.name, part.line, part.port, part.device, top.tolist(), front.tolist()))
    wheels = [WheelFacts(at.port, at.diameter_mm, float(at.centre_m[1]), at.is_clockwise_forward) for at in design.rolling]
    return PlanFacts(devices, wheels, [GearFacts(train.port, train.gears, train.ratio) for train in design.trains])


def _decoded(data: bytes) -> PlanFacts:
    devices, wheels, trains = json.loads(data)
    return PlanFacts(
        [DeviceFacts(*row) for row in devices],
        [WheelFacts(*row) for row in wheels],
        [GearFacts(port, tuple(gears), ratio) for port, gears, ratio in trains],
    )
