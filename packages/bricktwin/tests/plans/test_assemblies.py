"""Parts that LDraw composes of several lines."""

from __future__ import annotations

import numpy as np
import pytest
from plan_lines import BEAM, findings_of, plan_of

from bricktwin.plans.assemblies import Assembly, assemblies, components, is_known, is_piece
from bricktwin.plans.booklet.parts_list import needs, owned

AT = "1 {} {} {} {} 1 0 0 0 1 0 0 0 1 {}.dat"
TURNED = "1 {} {} {} {} 0 -1 0 1 0 0 0 0 1 {}.dat"
WHOLES = [assembly for assembly in assemblies() if assembly.here == "whole"]


def lines_of(assembly: Assembly, line: str = AT) -> list[str]:
    """The lines of an assembly, in this order."""
    return [line.format(piece.colour, *piece.place, piece.number) for piece in assembly.pieces]


@pytest.mark.parametrize("assembly", WHOLES, ids=lambda assembly: assembly.number)
def test_lines_of_a_part_are_that_part(assembly: Assembly) -> None:
    whole = plan_of(AT.format(16, 0, 0, 0, assembly.number))
    for lines in (lines_of(assembly), lines_of(assembly)[::-1]):
        plan = plan_of(*lines)
        assert (plan.unknown, [one.part for one in plan.parts]) == ((), [whole.parts[0].part])
        assert np.allclose(plan.parts[0].position, whole.parts[0].position)


def test_composed_part_may_lie_anywhere_and_its_shaft_be_turned() -> None:
    plan = plan_of(
        "1 4 100 0 0 0 0 1 0 1 0 -1 0 0 u9364c01.dat",
        "0 STEP",
        "1 4 100 -50 0 0.8 0 0.6 0 1 0 -0.6 0 0.8 u9363.dat",
        BEAM,
    )
    motor = plan.parts[0]
    assert (motor.part.number, motor.position.tolist(), motor.step) == ("54696p02", [100, 0, 0], 0)
    assert plan.unknown == ()
    away = plan_of(AT.format(4, 0, 0, 0, "u9364c01"), AT.format(4, 0, -90, 0, "u9363"))
    assert [one.number for one in away.unknown] == ["u9363"]  # no shaft of this motor


@pytest.mark.parametrize(
    ("hub", "battery"),
    [("45601", "45610"), ("67718", "67704"), ("67718p01", "45610"), ("95646", "95656")],
)
def test_hub_has_its_battery(hub: str, battery: str) -> None:
    place = (0, 90, 0) if hub == "95646" else (0, 0, 0)
    plan = plan_of(AT.format(15, 0, 0, 0, hub), AT.format(71, *place, battery))
    assert (len(plan.parts), plan.unknown) == (1, ())


# Either half of a universal joint stands for the whole, in whatever model it is.
DIVIDED = [assembly for assembly in WHOLES if assembly.number != "61903"]


@pytest.mark.parametrize("assembly", DIVIDED, ids=lambda assembly: assembly.number)
@pytest.mark.parametrize("name", ["rest.ldr", "rest.dat"])
@pytest.mark.parametrize("is_case_inside", [False, True])
def test_pieces_in_a_model_of_their_own_are_the_part(
    assembly: Assembly, name: str, *, is_case_inside: bool
) -> None:
    """Such as a hub whose battery is a sub-model."""
    whole = plan_of(AT.format(16, 0, 0, 0, assembly.number))
    first, *others = lines_of(assembly)
    inside, beside = ([first], others) if is_case_inside else (others, [first])
    place = f"1 16 0 0 0 1 0 0 0 1 0 0 0 1 {name}"
    for lines in ([place, *beside], [*beside, place]):
        plan = plan_of("0 FILE main.ldr", *lines, f"0 FILE {name}", *inside)
        assert (plan.unknown, plan.faults) == ((), ())
        assert [one.part for one in plan.parts] == [whole.parts[0].part]
        assert np.allclose(plan.parts[0].position, whole.parts[0].position)


def test_battery_in_a_model_elsewhere_is_that_of_its_hub() -> None:
    hub, battery = AT.format(15, 0, 0, 0, "45601"), AT.format(71, 0, 0, 0, "45610")
    turned = "1 16 {} 0 0 0 0 1 0 1 0 -1 0 0 {}.ldr"
    robot = ("0 FILE main.ldr", BEAM, turned.format(400, "hub"), "0 STEP")
    models = ("0 FILE hub.ldr", hub, "0 FILE battery.ldr", battery)
    plan = plan_of(*robot, turned.format(400, "battery"), *models)
    assert (plan.unknown, [one.part.number for one in plan.parts]) == ((), ["45601", "32316"])
    away = plan_of(*robot, turned.format(300, "battery"), *models)
    assert [one.number for one in away.unknown] == ["45610"]
    second = plan_of(*robot, *2 * [turned.format(400, "battery")], *models)
    assert [len(one.lines) for one in second.unknown] == [1]  # one hub has one


def test_shaft_in_a_model_of_its_own_may_have_the_comment() -> None:
    plan = plan_of(
        "0 FILE main.ldr",
        AT.format(16, 0, 0, 0, "u9367c01"),
        "1 16 0 0 0 1 0 0 0 1 0 0 0 1 shaft.ldr",
        "0 FILE shaft.ldr",
        "0 !BRICKSRL PORT A left 30",
        AT.format(4, 0, -50, 0, "u9363"),
    )
    assert [(one.port, one.device, one.angle_deg) for one in plan.parts] == [("A", "left", 30.0)]
    assert plan.unknown == ()


@pytest.mark.parametrize("order", [1, -1])
@pytest.mark.parametrize("port", [0, 1])
def test_comment_before_either_line_is_that_of_the_part(order: int, port: int) -> None:
    lines = [AT.format(16, 0, 0, 0, "u9367c01"), AT.format(4, 0, -50, 0, "u9363")][::order]
    lines.insert(port, "0 !BRICKSRL PORT A left 30")
    assert [(one.port, one.device, one.angle_deg) for one in plan_of(*lines).parts] == [
        ("A", "left", 30.0)
    ]


@pytest.mark.parametrize(
    "assembly", [one for one in assemblies() if one.here == "pieces"], ids=lambda one: one.number
)
def test_line_of_a_shortcut_is_its_pieces(assembly: Assembly) -> None:
    one, several = plan_of(AT.format(4, 10, 0, 0, assembly.number)), plan_of(*lines_of(assembly))
    assert [placed.part for placed in one.parts] == [placed.part for placed in several.parts]
    assert [(placed.position - (10, 0, 0)).tolist() for placed in one.parts] == [
        placed.position.tolist() for placed in several.parts
    ]
    assert (one.parts[0].colour, one.unknown) == (4, ())


@pytest.mark.parametrize("line", [AT, TURNED])
def test_caster_of_two_lines_is_held_listed_and_in_sets(line: str) -> None:
    place = (0, 46, 0) if line is AT else (-46, 0, 0)
    two = [line.format(71, 0, 0, 0, "39370"), line.format(15, *place, "52629")]
    assert findings_of(plan_of(*two)) == []
    assert findings_of(plan_of(*two[::-1])) == []
    assert str(owned(plan_of(*two), ["45678"])) == "45678 SPIKE Prime: 2 of 2 parts"
    assert needs(plan_of(*two)) == needs(plan_of(AT.format(71, 0, 0, 0, "39370c01")))


def test_components_are_parts_of_the_catalogue() -> None:
    assert components() == {
        "39370c01": ("39370", "52629"),
        "56145c01": ("56145", "44309"),
        "86652c01": ("86652", "32019"),
        "92911c01": ("92911", "99948"),
    }


@pytest.mark.parametrize(
    ("off", "is_one"),
    [
        ((0.0, 0.0, 0.0), True),
        ((1.9, -1.9, 1.9), True),
        ((2.0, 0.0, 0.0), False),
        ((0.0, -2.1, 0.0), False),
        ((0.0, 0.0, 2.1), False),
    ],
)
def test_a_piece_is_within_two_units_of_its_place(
    off: tuple[float, float, float], is_one: bool
) -> None:
    x, y, z = off
    lines = [AT.format(16, 0, 0, 0, "u9367c01"), AT.format(4, x, y - 50, z, "u9363")]
    assert (plan_of(*lines).unknown == ()) is is_one
    # So it is in a model of its own.
    shaft = "1 16 0 0 0 1 0 0 0 1 0 0 0 1 shaft.ldr"
    plan = plan_of("0 FILE main.ldr", lines[0], shaft, "0 FILE shaft.ldr", lines[1])
    assert (plan.unknown == ()) is is_one


def test_each_hub_takes_a_battery_of_its_own() -> None:
    hub, battery = AT.format(15, 0, 0, 0, "45601"), AT.format(71, 0, 0, 0, "45610")
    place = "1 16 0 0 0 1 0 0 0 1 0 0 0 1 {}.ldr"
    models = ("0 FILE hub.ldr", hub, "0 FILE battery.ldr", battery)
    names = ("hub", "hub", "battery", "battery")
    plan = plan_of("0 FILE main.ldr", BEAM, *map(place.format, names), *models)
    assert plan.unknown == () and len(plan.parts) == 3


@pytest.mark.parametrize(
    ("name", "known", "piece"),
    [
        ("32316.dat", True, False),
        ("32316.DAT", True, False),
        ("32316", True, False),
        ("99999.dat", False, False),
        # Lines of a motor, and of a hub, are no parts themselves.
        ("u9363.dat", False, True),
        ("U9363.DAT", False, True),
        ("45610.dat", False, True),
        ("rear.ldr", False, False),
        *((f"{one.number}.dat", True, False) for one in assemblies() if one.here == "pieces"),
    ],
)
def test_names_are_those_of_parts_of_pieces_or_of_models(
    name: str, known: bool, piece: bool
) -> None:
    assert is_known(name) is known and is_piece(name) is piece
