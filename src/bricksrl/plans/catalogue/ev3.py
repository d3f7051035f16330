"""Brick, motors and sensors of MINDSTORMS EV3. Positions from LDraw.org's part library; masses are estimates.

No hub of ``bricksrl.robots`` supports them: their plans are checked, listed and drawn, but have no twin.
"""

from __future__ import annotations

from bricksrl.plans.catalogue.build import electric_part, sites
from bricksrl.plans.geometry import Solid, Triple, box, cylinder
from bricksrl.plans.part import Device, DeviceKind, Part, Site

_CABLE_MM = 500.0
"""Longest of its cables."""


def ev3() -> list[Part]:
    """All parts of EV3."""
    return [_brick(), *_motors(), *_sensors()]


def _device(
    number: str, name: str, mass_g: float, device: Device, holes: tuple[Site, ...], solids: tuple[Solid, ...], *turning: Solid
) -> Part:
    return electric_part(number, name, mass_g, device, holes, solids, turning=turning, aliases=(f"{number}c01",))


def _brick() -> Part:
    sides = " ".join(f"{x},0,{z}" for x in (-80, 80) for z in (-80, -60, -40, 40, 60, 80))
    lower = " ".join(f"{x},{y},{z}" for x in (-80, 80) for y in (20, 40) for z in (-80, 80))
    below = " ".join(f"{x},80,{z}" for x in (-60, -40, -20, 20, 40, 60) for z in (-120, 120))
    holes = sites(f"o x20: {sides} {lower} | o y20: {below}")
    middle: Triple = (0.0, 35.0, 0.0)
    device = Device(DeviceKind.HUB, "ev3", middle, ports=tuple((port, middle) for port in "ABCD1234"))
    return _device("95646", "EV3 brick with battery", 270.0, device, holes, (box((0, 35, 0), (180, 108, 278)),))


def _motors() -> list[Part]:
    medium = sites(
        "o x20: -20,-20,10 -20,20,10 20,-20,10 20,20,10 -20,40,30 -20,40,70 20,40,30 20,40,70"
        "| o z20: -20,0,10 0,-20,10 0,20,10 20,0,10 | + x20: -20,40,50 20,40,50"
    )
    large = sites(
        "o x20: -20,0,-180 -20,0,-140 20,0,-180 20,0,-140 0,-60,-80 0,-60,-40 | + x20: -20,0,-160 20,0,-160 0,-60,-60"
        "| o z20: -20,-100,-200 -20,-20,-200 0,-100,-200 0,-20,-200 20,-100,-200 20,-20,-200"
    )
    return [
        _device(
            "99455",
            "EV3 medium motor",
            36.0,
            Device(DeviceKind.MOTOR, "ev3-medium", (0.0, 10.0, 180.0), _CABLE_MM, shaft=(0.0, 0.0, -1.0)),
            (*medium, *sites("+ z20: 0,0,10", turns=True)),
            (box((0, 10, 90), (60, 78, 180)),),
        ),
        _device(
            "95658",
            "EV3 large motor",
            76.0,
            Device(DeviceKind.MOTOR, "ev3-large", (0.0, -60.0, -220.0), _CABLE_MM, shaft=(1.0, 0.0, 0.0)),
            (*large, *sites("+ x60: 0,0,0", turns=True)),
            (box((0, -60, -130), (58, 98, 200)), box((0, 0, -135), (58, 40, 110))),
            cylinder((0, 0, 0), "x", 60.0, 28.0),
        ),
    ]


def _sensors() -> list[Part]:
    """Sensors; all have an axle hole between two pin holes at the back."""
    back = sites("o x20: 0,0,-20 0,0,20 | + x20: 0,0,0")
    slim = (box((0, -39, -20), (60, 58, 98)), box((0, 0, 0), (18, 18, 58)))
    wide = (*slim, box((0, -40, -60), (138, 58, 58)))
    rows: list[tuple[str, str, float, tuple[Solid, ...]]] = [
        ("95650", "ColorSensor", 11.0, slim),
        ("95648", "TouchSensor", 11.0, slim),
        ("99380", "GyroSensor", 11.0, slim),
        ("95652", "UltrasonicSensor", 23.0, wide),
        ("95654", "InfraredSensor", 20.0, wide),
    ]
    return [
        _device(
            number,
            f"EV3 {name}",
            mass,
            Device(DeviceKind.SENSOR, f"Ev3{name}", (0.0, -29.0, 29.0), _CABLE_MM, looks=(0.0, 0.0, -1.0)),
            back,
            solids,
        )
        for number, name, mass, solids in rows
    ]
