"""Check of a plan's wiring: hub, ports, cable lengths."""

from __future__ import annotations

from collections.abc import Iterator

import numpy as np

from brickhub.finding import Finding, Outcome
from bricktwin.plans.geometry import MM_PER_LDU
from bricktwin.plans.part import DeviceKind
from bricktwin.plans.plan import Placed, Plan

_SLACK_MM = 30.0
"""Length of a cable that its bends need."""


def wiring(plan: Plan) -> Iterator[Finding]:
    """Findings about hub, ports and cables."""
    hubs = plan.devices(DeviceKind.HUB)
    devices = plan.devices(DeviceKind.MOTOR, DeviceKind.SENSOR)
    if len(hubs) != 1:
        if devices or len(hubs) > 1:
            fault = "has no hub; add one" if not hubs else f"has {len(hubs)} hubs; leave one"
            yield Finding("wiring", Outcome.ERROR, f"the plan {fault}", hubs[-1].line if hubs else 0)
        return
    positions = dict(hubs[0].electric.ports)
    used: dict[str, Placed] = {}
    for placed in devices:
        if placed.port is None:
            text = f"{placed.name} has no port; write 0 !BRICKSRL PORT and its letter before it"
            yield Finding("wiring", Outcome.ERROR, text, placed.line)
        elif placed.port not in positions:
            text = f"{placed.name} is on port {placed.port}, but the hub has {', '.join(sorted(positions))}; choose one of these"
            yield Finding("wiring", Outcome.ERROR, text, placed.line)
        elif placed.port in used:
            other = used[placed.port].line
            text = f"{placed.name} is on port {placed.port}, and so is the one of line {other}; give each its own"
            yield Finding("wiring", Outcome.ERROR, text, placed.line)
        else:
            used[placed.port] = placed
            yield from _cable(hubs[0], positions[placed.port], placed)


def _cable(hub: Placed, position: tuple[float, float, float], placed: Placed) -> Iterator[Finding]:
    length_mm = placed.electric.cable_mm
    needed = float(np.linalg.norm(hub.point(position) - placed.point(placed.electric.plug))) * MM_PER_LDU + _SLACK_MM
    if needed > length_mm:
        text = f"the cable of {placed.name} has {length_mm:.0f} mm, but port {placed.port} needs {needed:.0f}; use a nearer port"
        yield Finding("wiring", Outcome.ERROR, text, placed.line)
