"""Ports of a plan that says none, as drawings of strangers do."""

from collections.abc import Iterable
from dataclasses import replace

from brickhub.errors import PlanError
from brickhub.robot import HubKind, MotorKind, SensorKind
from bricktwin.plans.part import DeviceKind
from bricktwin.plans.plan import Placed, Plan


def wired(plan: Plan) -> Plan:
    """The plan; if it says no port at all, with a port of its hub for each motor and sensor: motors
    first, in the order in which they are built in. Raises PlanError if the hub has too few."""
    motors = plan.devices(DeviceKind.MOTOR)
    sensors = plan.devices(DeviceKind.SENSOR)
    hubs = plan.devices(DeviceKind.HUB)
    devices = [*motors, *sensors]
    # A plan that says some ports has forgotten others, which is for its author to say.
    if not hubs or any(placed.port is not None for placed in devices):
        return plan
    ports: dict[int, str] = {}
    for placed in devices:
        free = _free_ports(plan, placed, ports.values())
        if not free:
            raise PlanError(
                f"{plan.path}, line {placed.line}: no port of the {hubs[0].name} is left for "
                f"{placed.name}; remove a motor or a sensor"
            )
        ports[placed.index] = free[0]
    parts = tuple(
        replace(placed, port=ports[placed.index]) if placed.index in ports else placed
        for placed in plan.parts
    )
    return replace(plan, parts=parts)


def _free_ports(
    plan: Plan,
    placed: Placed,
    taken: Iterable[str],
) -> list[str]:
    """Ports of the plan's hub that a device fits, and that no other has."""
    hub = HubKind(plan.devices(DeviceKind.HUB)[0].electric.name)
    is_motor = placed.electric.kind is DeviceKind.MOTOR
    kind = MotorKind(placed.electric.name) if is_motor else SensorKind(placed.electric.name)
    fitting = hub.model.takes(kind.model)
    return [port for port in fitting if port not in set(taken)]
