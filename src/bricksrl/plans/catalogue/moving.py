"""Gears, racks, turntables, wheels. Sizes from LDraw.org's part library."""

from __future__ import annotations

from bricksrl.plans.catalogue.build import part, sites, tubes
from bricksrl.plans.geometry import AXES, Solid, Triple, ball, box, cylinder, ring
from bricksrl.plans.part import Fit, Gear, GearForm, MassSource, Part, Site

_Z = AXES["z"]
_CENTRE = (0.0, 0.0, 0.0)
_TOOTH_DEPTH = 0.5
"""Depth of a gear's solid below the pitch circle, so that meshing gears do not collide."""


def moving() -> list[Part]:
    """All moving parts."""
    return [*_gears(), *_worms_and_racks(), *_differentials(), *_turntables(), *_wheels(), *_casters(), *_chains()]


def _disc(teeth: int, width: float, centre: Triple = _CENTRE) -> Solid:
    return cylinder(centre, _Z, width, 1.25 * teeth - _TOOTH_DEPTH)


def _gears() -> list[Part]:
    around = "0,-20,0 0,20,0 -20,0,0 20,0,0"
    spur, bevel, double = GearForm.SPUR, GearForm.BEVEL, GearForm.DOUBLE_BEVEL
    rows: list[tuple[str, int, GearForm, float, str, tuple[str, ...]]] = [
        ("10928", 8, spur, 0.289, "+ z20: 0,0,0", ("3647",)),
        ("94925", 16, spur, 0.925, "+ z20: 0,0,0", ("4019", "401926")),
        ("3648b", 24, spur, 1.182, "+ z20: 0,0,0", ("3648a", "3648", "24505")),
        ("3649", 40, spur, 3.513, f"+ z20: 0,0,0 {around}", ("34432",)),
        ("32270", 12, double, 0.746, "+ z20: 0,0,0", ()),
        ("18575", 20, double, 1.257, "+ z20: 0,0,0", ("32269",)),
        ("46372", 28, double, 2.268, f"+ z20: 0,0,0 | o z20: {around}", ()),
        ("32498", 36, double, 3.703, "+ z20: 0,-20,0 0,0,0 0,20,0 | o z20: -20,0,0 20,0,0", ()),
    ]
    parts = [
        _gear(number, f"Gear {teeth}, {form.value}", teeth, form, mass, text, 20.0, 0.0, aliases)
        for number, teeth, form, mass, text, aliases in rows
    ]
    return [
        *parts,
        _gear("18946", "Gear 16 with clutch, pin hole", 16, spur, 0.972, "o z20: 0,0,0", 20.0, 0.0, ("6542", "6542a", "6542b")),
        _gear("2471", "Gear 24 with clutch, pin hole", 24, spur, 1.353, "o z20: 0,0,0", 20.0, 0.0, ()),
        _gear("6589", "Gear 12, bevel", 12, bevel, 0.290, "+ z10: 0,0,2", 10.0, 2.0, ("59443b",)),
        _gear("32198", "Gear 20, bevel", 20, bevel, 0.645, "+ z10: 0,0,-2", 10.0, -2.0, ()),
        _gear("87407", "Gear 20, bevel, pin hole", 20, bevel, 0.756, "o z20: 0,0,-10", 10.0, -5.0, ()),
        _gear("3650c", "Gear 24, crown", 24, GearForm.CROWN, 1.284, "+ z20: 0,0,2", 10.0, 7.0, ("3650b", "3650a", "3650")),
    ]


def _gear(
    number: str,
    name: str,
    teeth: int,
    form: GearForm,
    mass_g: float,
    text: str,
    width: float,
    middle: float,
    aliases: tuple[str, ...],
) -> Part:
    part_sites, centre = sites(text), (0.0, 0.0, middle)
    disc: tuple[Solid, ...] = (_disc(teeth, width, centre),)
    if form is GearForm.DOUBLE_BEVEL:  # bevelled, so that two can meet at a right angle
        disc = (_disc(teeth, 10.0), cylinder(_CENTRE, _Z, 20.0, 1.25 * teeth - 6.0))
    solids = (*disc, *tubes(part_sites))
    gear = Gear(form, teeth, centre, _Z, width, set_back=0.0 if form is GearForm.BEVEL else 5.0)
    return part(number, name, "gears", mass_g, part_sites, solids=solids, gears=(gear,), aliases=aliases)


def _worms_and_racks() -> list[Part]:
    # One thread; beside a gear its pitch radius is that of 8 teeth.
    thread = Gear(GearForm.WORM, 1, _CENTRE, _Z, 40.0)
    worm = part(
        "4716",
        "Worm 2",
        "gears",
        0.631,
        sites("+ z40: 0,0,0"),
        solids=(cylinder(_CENTRE, _Z, 40.0, 9.5),),
        gears=(thread,),
        aliases=("32905",),
    )
    racks = []
    for number, length, teeth, mass_g, text in (
        ("87761", 7, 18, 1.556, "+ z20: -40,0,0 40,0,0 | o y20: -60,0,0 60,0,0"),
        ("64781", 13, 34, 2.890, "+ z20: -100,0,0 100,0,0 | o y20: -120,0,0 120,0,0"),
    ):
        part_sites = sites(text)
        gear = Gear(GearForm.RACK, teeth, (0.0, -7.5, 0.0), AXES["x"], 20.0, (0.0, -1.0, 0.0))
        body = (box((0.0, 1.5, 0.0), (20.0 * length, 17.0, 20.0)),)
        source = MassSource.VOLUME if length == 7 else MassSource.RULE
        racks.append(part(number, f"Rack {length}", "gears", mass_g, part_sites, solids=body, gears=(gear,), source=source))
    return [worm, *racks]


def _differentials() -> list[Part]:
    """A differential of 28 teeth: gears of 12 on both axles and one on its peg, 36.3 LDU off centre in BrickLink's Studio."""
    parts = []
    for number, offset, aliases in (("62821", 0.0, ()), ("62821b", -36.3, ())):
        centre = f"0,{offset:g}"
        part_sites = sites(f"o z10: {centre},-25 {centre},25 | peg x10: 15.5,{offset:g},0")
        solids = (
            cylinder((0.0, offset, 24.0), _Z, 7.0, 34.5),
            *(ring((0.0, offset, z), _Z, 12.0, 25.0, 7.0) for z in (-24.0, 24.0)),
            *(box((x, offset, 0.0), (4.0, 14.0, 36.0)) for x in (-23.0, 23.0)),
        )
        teeth = Gear(GearForm.BEVEL, 28, (0.0, offset, 24.0), _Z, 7.0, set_back=-1.0)
        parts.append(part(number, "Differential 28", "gears", 3.0, part_sites, solids=solids, gears=(teeth,), aliases=aliases))
    return parts


def _turntables() -> list[Part]:
    """Turntables, upper and lower halves; their turntable sites coincide."""
    joint = Site(Fit.TURNTABLE, _CENTRE, AXES["y"], 20.0)
    upper_holes = sites("o x20: -40,-20,-20 -40,-20,0 -40,-20,20 40,-20,-20 40,-20,0 40,-20,20")
    lower_holes = sites("o x20: -40,20,-20 -40,20,0 -40,20,20 40,20,-20 40,20,0 40,20,20")
    teeth = Gear(GearForm.SPUR, 60, (0.0, 2.5, 0.0), AXES["y"], 15.0)
    upper = (
        ring((0, -8, 0), "y", 4.0, 70.0, 40.0),
        ring((0, 2.5, 0), "y", 15.0, 74.5, 68.0),
        *(box((x, -20, 0), (20, 20, 60)) for x in (-40, 40)),
    )
    lower = (ring((0, 3, 0), "y", 14.0, 66.0, 45.0), *(box((x, 20, 0), (20, 20, 60)) for x in (-40, 40)))
    small = Gear(GearForm.DOUBLE_BEVEL, 28, _CENTRE, AXES["y"], 20.0)
    small_upper, small_lower = sites("o z20: -20,-20,0 20,-20,0"), sites("o z20: -20,20,0 20,20,0")
    return [
        part("18938", "Turntable 60, upper half", "turntables", 8.146, (*upper_holes, joint), solids=upper, gears=(teeth,)),
        part("18939", "Turntable 60, lower half", "turntables", 5.355, (*lower_holes, joint), solids=lower),
        part(
            "99010",
            "Turntable 28, upper half",
            "turntables",
            1.797,
            (*small_upper, joint),
            solids=(ring((0, 0, 0), "y", 20.0, 34.5, 27.5), cylinder((0, -7, 0), "y", 6.0, 30.0), *tubes(small_upper)),
            gears=(small,),
        ),
        part(
            "99009",
            "Turntable 28, lower half",
            "turntables",
            1.294,
            (*small_lower, joint),
            solids=(cylinder((0, 3, 0), "y", 14.0, 26.0), *tubes(small_lower)),
        ),
    ]


def _wheels() -> list[Part]:
    motor_wheel = sites("+ z20: 0,0,0 | o z20: -40,0,0 -20,0,0 0,-40,0 0,-20,0 0,20,0 0,40,0 20,0,0 40,0,0")
    tyre = (ring(_CENTRE, _Z, 35.0, 70.0, 56.0), cylinder(_CENTRE, _Z, 20.0, 57.0))
    holes = "-17.32,-10,0 -17.32,10,0 0,-20,0 0,20,0 17.32,-10,0 17.32,10,0"
    three = "-17.32,-10,0 17.32,-10,0 0,20,0"
    rows: list[tuple[str, str, float, str, float, float, float, tuple[str, ...]]] = [
        ("56145", "Rim 30 x 20", 3.715, "+ z20: 0,0,-10", 38.0, 50.0, 0.0, ("42716",)),
        ("56908", "Rim 43 x 26", 8.184, f"+ z20: 0,0,-10 | o z20: {holes}", 54.0, 66.0, 0.0, ()),
        ("44772", "Rim 56 x 34", 12.884, f"+ z40: 0,0,0 | o z20: {three}", 70.0, 84.0, 0.0, ()),
        ("55982", "Rim 14 x 18", 1.42, "+ z20: 0,0,10", 21.0, 36.0, 0.0, ()),
        ("56903", "Rim 8 x 18", 1.01, "+ z20: 0,0,0", 21.0, 20.0, 0.0, ()),
        ("56904", "Rim 14 x 30", 4.06, "+ z20: 0,0,-10", 38.0, 38.0, 0.0, ()),
        ("86652", "Rim 18 x 37", 5.87, f"+ z20: 0,0,0 | o z20: {holes}", 55.0, 26.0, 0.0, ()),
        ("32020", "Rim 18 x 37, long hub", 5.97, f"+ z26: 0,0,0 | o z20: {holes}", 55.0, 26.0, 0.0, ()),
        ("41896", "Rim 26 x 43", 8.42, f"+ z40: 0,0,0 | o z20: {three}", 54.0, 66.0, 0.0, ()),
        ("88517", "Motorcycle rim 17 x 75", 16.59, f"+ z20: 0,0,0 | o z20: {holes}", 94.0, 42.0, 0.0, ()),
        ("2903", "Motorcycle rim 14 x 62", 10.9, "+ z20: 0,0,0", 79.3, 34.0, 0.0, ()),
        ("4185b", "Wedge belt wheel", 0.886, "+ z10: 0,0,0", 30.0, 10.0, 24.0, ("4185", "4185a")),
        ("57520", "Sprocket wheel", 1.124, "+ z20: 0,0,0", 31.5, 20.0, 0.0, ()),
        ("3736", "Pulley 37", 1.982, "+ z20: 0,0,0", 46.7, 20.0, 0.0, ()),
    ]
    parts = [
        part(
            number,
            name,
            "wheels",
            mass,
            sites(text),
            solids=(cylinder(_CENTRE, _Z, width, radius),),
            aliases=aliases,
            wheel_mm=wheel_mm,
        )
        for number, name, mass, text, radius, width, wheel_mm, aliases in rows
    ]
    cross = " ".join(f"{x},0,0 0,{x},0" for x in (-80, -60, -40, -20, 20, 40, 60, 80))
    corners = " ".join(f"{x},{y},0" for x in (-60, -40, 40, 60) for y in (-60, -40, 40, 60) if abs(x) + abs(y) > 80)
    wheel_88 = sites(f"+ z20: 0,0,0 | o z20: {cross} {corners}")
    tyre_88 = (ring(_CENTRE, _Z, 35.0, 109.8, 95.0), cylinder(_CENTRE, _Z, 20.0, 96.0))
    tyre_43 = (ring(_CENTRE, _Z, 54.0, 54.0, 37.0), cylinder(_CENTRE, _Z, 50.0, 38.0))
    rim_63 = sites(f"+ z20: 0,0,0 | o z20: {holes}")
    tyre_63 = (ring((0.0, 0.0, -9.5), _Z, 50.0, 78.3, 54.0), cylinder(_CENTRE, _Z, 26.0, 55.0))
    tyred = [
        ("39367p02", "Wheel 56 x 14 with tyre", 13.187, motor_wheel, tyre, 56.0, ("39367p01", "39367", "39367pb01", "39367pb02")),
        ("49295p02", "Wheel 88 x 14 with tyre", 27.1, wheel_88, tyre_88, 87.8, ("49295p01", "49295", "49295c01")),
        ("56145c01", "Rim 30 x 20 with tyre 43", 10.261, sites("+ z20: 0,0,-10"), tyre_43, 43.2, ("bl_56145c01",)),
        ("86652c01", "Rim 18 x 37 with tyre 63", 26.7, rim_63, tyre_63, 62.6, ("32020c01",)),
    ]
    with_tyres = [
        part(number, name, "wheels", mass, part_sites, solids=solids, wheel_mm=wheel_mm, aliases=aliases)
        for number, name, mass, part_sites, solids, wheel_mm, aliases in tyred
    ]
    disc = (cylinder((0.0, 5.0, 0.0), "y", 10.0, 30.0),)
    flat = part("2723", "Disc 3 x 3", "wheels", 0.765, sites("+ y10: 0,5,0"), solids=disc, aliases=("2958", "52901", "4218868"))
    knobs = part(
        "32072",
        "Knob wheel, its mesh not known",
        "wheels",
        0.769,
        sites("+ z20: 0,0,0"),
        solids=(cylinder(_CENTRE, _Z, 20.0, 19.0),),
    )
    tyres = [
        _tyre(number, f"Tyre {diameter:g}", diameter, width, mass)
        for number, diameter, width, mass in (
            ("92402", 30.4, 34.0, 6.047),
            ("30391", 30.4, 34.0, 5.965),
            ("56898", 42.8, 36.0, 9.158),
            ("44309", 43.2, 54.0, 6.546),
            ("41897", 56.0, 70.0, 13.597),
            ("55976", 56.8, 64.0, 19.260),
            ("32019", 62.6, 50.0, 20.833),
            ("56891", 36.7, 45.0, 9.65),
            ("30699", 43.6, 36.0, 11.39),
            ("15413", 49.4, 50.4, 8.81),
            ("61481", 43.2, 66.0, 10.89),
            ("58090", 30.4, 34.0, 6.93),
            ("6578", 30.4, 35.0, 2.63),
            ("44771", 68.8, 88.0, 20.39),
            ("61480", 68.5, 86.0, 26.09),
            ("2995", 68.0, 100.0, 42.61),
            ("45982", 81.8, 96.0, 30.63),
            ("23799", 81.6, 110.0, 31.64),
            ("2902", 81.6, 35.0, 12.95),
            ("11957", 100.7, 48.0, 27.5),
            ("30648", 24.0, 36.0, 3.47),
            ("87697", 20.0, 28.0, 2.17),
            ("87414", 14.3, 16.0, 0.64),
        )
    ]
    return [*with_tyres, *parts, flat, knobs, *tyres]


def _tyre(number: str, name: str, wheel_mm: float, width: float, mass_g: float) -> Part:
    """A tyre; its connection to the rim is not modelled."""
    body = (ring(_CENTRE, _Z, width, 1.25 * wheel_mm, 0.8 * wheel_mm),)
    return part(number, name, "tyres", mass_g, (), solids=body, wheel_mm=wheel_mm, is_loose=True)


def _chains() -> list[Part]:
    """Links of chains over spur gears, from the eye to the pin along z."""
    plates = tuple(box((x, 0.0, 8.0), (2.0, 9.0, 18.0)) for x in (-8.0, 8.0))
    link = (*plates, *(cylinder((0.0, 0.0, z), AXES["x"], 14.0, 2.0) for z in (8.0, 16.0)))
    tread = (*link, box((0.0, -6.0, 8.0), (52.0, 4.0, 14.0)))
    return [
        part("3711", "Chain link", "chains", 0.079, (), solids=link, aliases=("3711a",), is_loose=True),
        part("3873", "Chain link with a tread", "chains", 0.190, (), solids=tread, is_loose=True),
    ]


def _casters() -> list[Part]:
    """A caster: the H frame with a ball in its cup, as one part."""
    part_sites = sites("o x20: 0,-20,-40 0,-20,40 0,0,-40 0,0,0 0,0,40 0,20,-40 0,20,40 | o y20: 0,0,-20 0,0,20")
    body = (
        box((0, 0, 0), (20, 20, 80)),
        box((0, 0, -40), (20, 58, 20)),
        box((0, 0, 40), (20, 58, 20)),
        cylinder((0, 33, 0), "y", 36.0, 28.0),
        ball((0, 46, 0), 24.0),
    )
    return [
        part("39370c01", "Ball caster", "wheels", 7.690, part_sites, solids=body, aliases=("39370",), wheel_mm=19.2),
        part("52629", "Ball 19 mm", "wheels", 3.853, (), solids=(ball(_CENTRE, 24.0),), is_loose=True),
    ]
