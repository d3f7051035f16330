"""Hubs, motors and sensors. Positions from LDraw.org's part library; masses of the inside are estimates."""

from __future__ import annotations

from bricksrl.plans.catalogue.build import electric_part, sites
from bricksrl.plans.geometry import Solid, Triple, box, cylinder
from bricksrl.plans.part import Device, DeviceKind, Part, Site

_SPIKE_CABLE_MM = 250.0
"""Motors and sensors of SPIKE Prime; source: LEGO Education's technical sheets."""
_DOWN_Y: Triple = (0.0, -1.0, 0.0)


def electric() -> list[Part]:
    """All hubs, motors and sensors."""
    return [*_hubs(), *_angular_motors(), *_other_motors(), *_sensors()]


def _hubs() -> list[Part]:
    prime = sites(
        "o x20: -60,-50,-80 -60,-30,-80 -60,-10,-80 -60,-50,80 -60,-30,80 -60,-10,80"
        " 60,-50,-80 60,-30,-80 60,-10,-80 60,-50,80 60,-30,80 60,-10,80 -60,-10,-40 -60,-10,40 60,-10,-40 60,-10,40"
        "| o y20: -60,-70,-100 -60,-70,100 60,-70,-100 60,-70,100 -60,-10,-100 -60,-10,-60 -60,-10,60 -60,-10,100"
        " 60,-10,-100 60,-10,-60 60,-10,60 60,-10,100 -20,-10,-100 -20,-10,100 20,-10,-100 20,-10,100"
        "| o z20: -40,-50,-100 -40,-30,-100 -40,-10,-100 40,-50,-100 40,-30,-100 40,-10,-100"
        " -40,-50,100 -40,-30,100 -40,-10,100 40,-50,100 40,-30,100 40,-10,100"
    )
    prime_ports: dict[str, Triple] = {"A": (-70, -68, 40), "C": (-70, -68, 0), "E": (-70, -68, -40)}
    prime_ports |= {"B": (70, -68, 40), "D": (70, -68, 0), "F": (70, -68, -40)}
    technic = sites(
        "o x20: -80,0,-60 -80,0,60 80,0,-60 80,0,60"
        "| o y20: -80,0,-80 -80,0,-40 -80,0,40 -80,0,80 80,0,-80 80,0,-40 80,0,40 80,0,80"
    )
    move = sites(
        "+ x20: -50,66,140 50,66,140"
        "| o x20: -50,66,-140 -50,66,-120 -50,66,-100 -50,66,-20 50,66,-140 50,66,-120 50,66,-100 50,66,-20"
    )
    technic_ports: dict[str, Triple] = {"A": (-40, -20, -89), "B": (40, -20, -89), "C": (-40, -20, 89), "D": (40, -20, 89)}
    move_ports: dict[str, Triple] = {"C": (-30, 20, -160), "D": (30, 20, -160)}
    city_ports: dict[str, Triple] = {"A": (-20, 26, -80), "B": (20, 26, -80)}
    shell, inventor = box((0, -40, 0), (140, 80, 220)), ("45601p01", "45601p02", "45601c01")
    return [
        _hub("67718", "Prime hub with battery", 230.0, "prime", prime, shell, prime_ports, ("67718p01", "67718c01", "bb1142c01")),
        _hub("45601", "Inventor hub with battery", 230.0, "prime", prime, shell, prime_ports, inventor),
        _hub("22127", "Technic hub with batteries", 228.0, "technic", technic, box((0, 0, 0), (180, 100, 178)), technic_ports),
        _hub("26910", "Move hub with batteries", 213.0, "move", move, box((0, 46, 0), (120, 100, 320)), move_ports),
        _hub("28738", "City hub with batteries", 135.0, "city", (), box((0, 46, 0), (80, 100, 160)), city_ports),
    ]


def _hub(
    number: str,
    name: str,
    mass_g: float,
    kind: str,
    holes: tuple[Site, ...],
    case: Solid,
    ports: dict[str, Triple],
    aliases: tuple[str, ...] = (),
) -> Part:
    """A hub; one without holes sits on studs, which are not modelled, so it counts as connected."""
    device = Device(DeviceKind.HUB, kind, case.centre, ports=tuple(ports.items()))
    return electric_part(number, name, mass_g, device, holes, (case,), aliases=aliases, is_loose=not holes)


def _angular_motors() -> list[Part]:
    """Motors of SPIKE Prime: shaft along y, disc at -y; the medium and the large one also have an axle hole at +y."""
    disc = sites("+ y20: 0,-40,0 | o y20: -20,-40,0 20,-40,0 0,-40,20", turns=True)
    back = sites("+ y20: 0,20,0", turns=True)
    turning = (cylinder((0, -41, 0), "y", 18.0, 28.5),)
    front = "-20,-20 -20,20 20,-20 20,20"
    sides = "".join(f" {x},{yz.split(',')[0]},{yz.split(',')[1]}" for x in (-20, 20) for yz in front.split())
    medium = sites(
        f"o x20:{sides} -20,-20,140 -20,20,140 20,-20,140 20,20,140"
        "| o y20: -20,20,0 20,20,0 0,20,-20 0,20,140 | o z20: -20,0,140 20,0,140"
    )
    wide = "".join(f" {x},{y},{z}" for x in (-40, 40) for y in (-20, 20) for z in (-20, 20, 100, 140))
    large = sites(
        f"o x20:{wide}"
        "| o y20: -40,-20,0 -40,-20,80 -40,-20,120 -40,20,0 -40,20,80 -40,20,120"
        " 40,-20,0 40,-20,80 40,-20,120 40,20,0 40,20,80 40,20,120"
        "| o z20: -40,0,-20 -40,0,140 40,0,-20 40,0,140"
    )
    small = sites(
        f"o x20:{sides} | o y20: -20,-20,60 20,-20,60 -20,20,60 20,20,60 -20,20,0 20,20,0 0,20,-20 | o z20: -20,0,60 20,0,60"
    )
    medium_case, large_case = box((0, 0, 60.5), (60, 60, 179)), box((0, 0, 60), (100, 60, 180))
    small_case = box((0, 0, 20.5), (60, 60, 99))
    medium_names, large_names = ("54696", "54696p01", "54696p01c01", "54696p02c01", "54696c01"), ("54675c01", "69730", "69730c01")
    rows = [
        ("54696p02", "Medium angular motor", 60.0, "spike-medium", (*medium, *disc, *back), medium_case, 150.0, medium_names),
        ("54675", "Large angular motor", 95.0, "spike-large", (*large, *disc, *back), large_case, 150.0, large_names),
        ("68488", "Small angular motor", 33.0, "spike-small", (*small, *disc), small_case, 70.0, ("68488c01",)),
    ]
    return [
        _motor(number, name, mass, kind, holes, (case,), turning, rear, aliases)
        for number, name, mass, kind, holes, case, rear, aliases in rows
    ]


def _motor(
    number: str,
    name: str,
    mass_g: float,
    kind: str,
    holes: tuple[Site, ...],
    solids: tuple[Solid, ...],
    turning: tuple[Solid, ...],
    rear: float,
    aliases: tuple[str, ...],
    shaft: Triple = _DOWN_Y,
) -> Part:
    device = Device(DeviceKind.MOTOR, kind, (0.0, 0.0, rear), _SPIKE_CABLE_MM, shaft=shaft)
    return electric_part(number, name, mass_g, device, holes, solids, turning=turning, aliases=aliases)


def _other_motors() -> list[Part]:
    """Motors of Powered Up: shaft along z, axle hole at -z."""
    shaft = sites("+ z20: 0,0,0", turns=True)
    forward = (0.0, 0.0, -1.0)
    large = sites(
        "o x20: -20,-20,0 -20,20,0 20,-20,0 20,20,0 -20,-20,140 -20,20,140 20,-20,140 20,20,140"
        "| o z20: -20,0,0 0,-20,0 0,20,0 20,0,0 -20,0,140 20,0,140"
    )
    extra = sites(
        "o x20: -20,-20,0 -20,-20,140 -20,20,0 -20,20,140 20,-20,0 20,-20,140 20,20,0 20,20,140"
        " -40,-20,20 -40,-20,120 -40,0,20 -40,0,120 -40,20,20 -40,20,120 -20,-40,40 -20,-40,120 -20,40,40 -20,40,120"
        " 40,-20,20 40,-20,120 40,0,20 40,0,120 40,20,20 40,20,120 20,-40,40 20,-40,120 20,40,40 20,40,120"
        "| o z20: -20,0,0 0,-20,0 0,20,0 20,0,0 -20,0,140 20,0,140"
    )
    interactive = sites("o z20: -20,34,-50 0,14,-50 0,54,-50 20,34,-50")
    turned = sites("+ z20: 0,34,-50", turns=True)
    rows = [
        ("22169", "Technic L motor", 75.0, "technic-l", (*large, *shaft), box((0, 0, 70), (60, 78, 160)), 150.0),
        ("22172", "Technic XL motor", 111.0, "technic-xl", (*extra, *shaft), box((0, 0, 70), (100, 98, 160)), 150.0),
        ("26913", "Interactive motor", 46.0, "interactive", (*interactive, *turned), box((0, 34, 0), (80, 76, 120)), 60.0),
    ]
    return [
        _motor(number, name, mass, kind, holes, (case,), (), rear, (f"{number}c01",), forward)
        for number, name, mass, kind, holes, case, rear in rows
    ]


def _sensors() -> list[Part]:
    ahead = (0.0, 0.0, -1.0)
    small = sites("o x20: -20,-20,0 -20,20,0 20,-20,0 20,20,0 | o z20: -20,0,0 20,0,0")
    eyes = sites("o x20: -60,-20,0 -60,20,0 60,-20,0 60,20,0 | o z20: -60,0,0 60,0,0")
    force = sites(
        "o x20: -20,-20,-40 -20,-20,40 -20,20,-40 -20,20,40 20,-20,-40 20,-20,40 20,20,-40 20,20,40"
        "| o y20: -20,20,-20 -20,20,20 20,20,-20 20,20,20 | o z20: -20,0,40 20,0,40"
    )
    case = (box((0, 0, -19.5), (60, 58, 59)),)
    long_case = (box((0, 0.5, -5), (60, 59, 110)), cylinder((0, 0, -62), "z", 16.0, 20.0))
    return [
        _sensor("37316", "Distance sensor", 30.0, "UltrasonicSensor", eyes, (box((0, 0, -29.5), (140, 58, 79)),), ahead),
        _sensor("37308", "Color sensor", 12.0, "ColorSensor", small, case, ahead),
        _sensor("37312", "Force sensor", 20.0, "ForceSensor", force, long_case, ahead),
        _sensor("47592", "Color light matrix", 14.0, "ColorLightMatrix", small, case, ahead),
        _sensor("26912", "Color and distance sensor", 14.0, "ColorDistanceSensor", (), (box((0, 22, 0), (40, 52, 80)),), ahead),
        _sensor("20844", "Infrared sensor", 12.0, "InfraredSensor", (), (box((0, 10, 0), (80, 28, 40)),), ahead),
        _sensor("20841", "Tilt sensor", 12.0, "TiltSensor", (), (box((0, 10, 0), (80, 28, 40)),), (0.0, 1.0, 0.0)),
    ]


def _sensor(
    number: str, name: str, mass_g: float, kind: str, holes: tuple[Site, ...], solids: tuple[Solid, ...], looks: Triple
) -> Part:
    """A sensor; those of WeDo and Boost sit on studs, which are not modelled, so they count as connected."""
    device = Device(DeviceKind.SENSOR, kind, (0.0, 0.0, 10.0), _SPIKE_CABLE_MM, looks=looks)
    return electric_part(number, name, mass_g, device, holes, solids, aliases=(f"{number}c01",), is_loose=not holes)
