"""LEGO sets with the hub, motors and sensors of a plan, and what they lack.

Other parts of the sets are not listed. The devices of 45678 and 45681 are from sales pages; those of the other sets, some
retired, are from memory: check them before buying.
"""

from __future__ import annotations

from collections import Counter
from collections.abc import Iterator
from dataclasses import dataclass, field

from bricksrl.plans.plan import Plan


@dataclass(frozen=True)
class LegoSet:
    """A set: number, and count of each hub, motor and sensor, by name in ``bricksrl.robots``."""

    number: str
    name: str
    devices: dict[str, int] = field(hash=False)


SETS = (
    LegoSet(
        "45678",
        "SPIKE Prime",
        {"prime": 1, "spike-medium": 2, "spike-large": 1, "UltrasonicSensor": 1, "ColorSensor": 1, "ForceSensor": 1},
    ),
    LegoSet("51515", "MINDSTORMS Robot Inventor", {"prime": 1, "spike-medium": 4, "UltrasonicSensor": 1, "ColorSensor": 1}),
    LegoSet("45681", "SPIKE Prime expansion", {"spike-large": 1, "ColorSensor": 1}),
    LegoSet("45345", "SPIKE Essential", {"essential": 1, "spike-small": 2, "ColorSensor": 1, "ColorLightMatrix": 1}),
    LegoSet("17101", "BOOST", {"move": 1, "interactive": 1, "ColorDistanceSensor": 1}),
    LegoSet(
        "31313",
        "MINDSTORMS EV3",
        {"ev3": 1, "ev3-large": 2, "ev3-medium": 1, "Ev3TouchSensor": 1, "Ev3ColorSensor": 1, "Ev3InfraredSensor": 1},
    ),
    LegoSet(
        "45544",
        "MINDSTORMS Education EV3",
        {
            "ev3": 1,
            "ev3-large": 2,
            "ev3-medium": 1,
            "Ev3TouchSensor": 2,
            "Ev3ColorSensor": 1,
            "Ev3GyroSensor": 1,
            "Ev3UltrasonicSensor": 1,
        },
    ),
)
SINGLY = {
    "prime": "45601",
    "spike-large": "45602",
    "spike-medium": "45603",
    "UltrasonicSensor": "45604",
    "ColorSensor": "45605",
    "ForceSensor": "45606",
    "spike-small": "45607",
    "ColorLightMatrix": "45608",
    "technic": "88012",
    "technic-l": "88013",
    "technic-xl": "88014",
    "ColorDistanceSensor": "88007",
    "city": "88009",
    "ev3": "45500",
    "ev3-large": "45502",
    "ev3-medium": "45503",
    "Ev3UltrasonicSensor": "45504",
    "Ev3GyroSensor": "45505",
    "Ev3ColorSensor": "45506",
    "Ev3TouchSensor": "45507",
    "Ev3InfraredSensor": "45509",
}
"""Numbers of devices sold separately."""
_HUBS = {"prime", "essential", "technic", "city", "move", "ev3"}


def purchases(plan: Plan) -> list[str]:
    """A line for each set with the plan's hub and what it lacks, the most complete first; empty without such a set."""
    names = {placed.part.device.name: placed.part.name for placed in plan.parts if placed.part.device is not None}
    needed = Counter(placed.part.device.name for placed in plan.parts if placed.part.device is not None)
    lines = sorted(_combined(needed), key=lambda found: (found[1].total(), len(found[0])))
    return [_line(sets, lacking, names) for sets, lacking in lines]


def _combined(needed: Counter[str]) -> Iterator[tuple[tuple[LegoSet, ...], Counter[str]]]:
    """Sets with a hub of the plan, alone or with a set without a hub that adds missing devices."""
    for base in SETS:
        if not _HUBS & set(needed) & set(base.devices):
            continue
        lacking = needed - Counter(base.devices)
        yield (base,), lacking
        for extra in SETS:
            if not _HUBS & set(extra.devices) and lacking & Counter(extra.devices):
                yield (base, extra), lacking - Counter(extra.devices)


def _line(sets: tuple[LegoSet, ...], lacking: Counter[str], names: dict[str, str]) -> str:
    have = " and ".join(f"{one.number} {one.name}" for one in sets)
    if not lacking:
        return f"{have}: all of its hub, motors and sensors"
    add = ", ".join(f"{count} x {names[name]} ({SINGLY.get(name, 'not sold singly')})" for name, count in sorted(lacking.items()))
    return f"{have}: add {add}"
