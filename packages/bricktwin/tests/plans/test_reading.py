"""LDraw files: steps, sub-assemblies, comments, malicious files."""

from __future__ import annotations

import io
import random
import time
import zipfile
from contextlib import suppress

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from plan_lines import BEAM, PLANS, pin, plan_of

from brickhub.errors import PlanError
from bricktwin.plans import ldraw_text
from bricktwin.plans.part import DeviceKind
from bricktwin.plans.plan import MAX_PARTS, read_plan
from bricktwin.plans.planned_robot import planned

WHEEL = (
    "0 FILE wheel.ldr",
    "1 16 0 0 10 1 0 0 0 1 0 0 0 1 39367p02.dat",
    "0 STEP",
    "1 71 0 0 30 1 0 0 0 1 0 0 0 1 3713.dat",
)


def test_steps_and_notes():
    plan = plan_of(
        "0 A beam",
        "0 // First a beam.",
        BEAM,
        "0 STEP",
        "0 STEP",
        "0 // Then",
        "0 // a pin.",
        pin(0, 10, 0),
    )
    assert plan.title == "A beam"
    assert [(step.new, step.note) for step in plan.steps] == [
        ((0,), "First a beam."),
        ((1,), "Then a pin."),
    ]
    assert plan.mass_g == pytest.approx(1.226 + 0.193, abs=0.01)


def test_lines_after_the_end_of_a_model_belong_to_none():
    plan = plan_of(
        "0 FILE a.ldr",
        "0 Name: a.ldr",
        "0 Author: somebody",
        BEAM,
        "0 NOFILE",
        BEAM,
        "0 FILE b.ldr",
        BEAM,
    )
    assert (plan.title, len(plan.parts)) == ("try", 1)


@pytest.mark.parametrize(
    "end", [[], ["0 NOFILE"], ["0 FILE b.ldr", BEAM], ["0 FILE a.dat", BEAM, "0 FILE a.dat", BEAM]]
)
def test_comment_without_a_part_after_it_is_no_other_parts(end: list[str]) -> None:
    with pytest.raises(PlanError, match=r"line 3: no part follows this comment; move it before"):
        plan_of("0 FILE main.ldr", BEAM, "0 !BRICKSRL FIXED", *end)


def test_title_is_no_other_line_of_the_header() -> None:
    header = (
        "0",
        "0 Name: a.ldr",
        "0 Author: me",
        "0 BFC CERTIFY CCW",
        '0 ROTATION CENTER 0 0 0 1 "Custom"',
        "0 // A note",
    )
    assert plan_of(*header, BEAM).title == "try"
    assert plan_of(*header, "0 My car", BEAM).title == "My car"


def test_colour_with_a_leading_zero_is_decimal():
    colours = [
        placed.colour
        for placed in plan_of(
            BEAM.replace("1 4", "1 014"),
            BEAM.replace("1 4", "1 0x2FF0000"),
            BEAM.replace("1 4", "1 #2FF0000"),
        ).parts
    ]
    assert colours == [14, 0x2FF0000, 0x2FF0000]


def test_time_grows_linearly_with_notes():
    start_s = time.process_time()
    assert (
        len(plan_of(*["0 // word word word word"] * 40_000, BEAM).steps[0].note) == 40_000 * 20 - 1
    )
    assert time.process_time() - start_s < 3.0


def test_time_does_not_grow_with_empty_steps():
    start_s = time.process_time()
    assert (
        len(
            plan_of(
                "0 FILE a.ldr",
                *[BEAM.replace("32316.dat", "b.ldr")] * 300,
                "0 FILE b.ldr",
                BEAM,
                *["0 STEP"] * 20_000,
            ).parts
        )
        == 300
    )
    assert time.process_time() - start_s < 3.0


def test_sub_assembly_is_built_before_joining():
    plan = plan_of(
        "0 FILE car.ldr", BEAM, "0 STEP", "1 1 100 0 0 -1 0 0 0 1 0 0 0 -1 wheel.ldr", *WHEEL
    )
    assert [step.assembly for step in plan.steps] == [(), ("wheel.ldr:4",), ("wheel.ldr:4",), ()]
    assert plan.steps[-1].joined == ((1, 2),)
    wheel = plan.parts[1]
    assert (wheel.colour, wheel.line, wheel.part.number) == (1, 6, "39367p02")
    assert np.allclose(wheel.position, [100, 0, -10])
    assert np.allclose(wheel.to_part(wheel.to_plan(np.array([[1.0, 2, 3]]))), [[1, 2, 3]])


def test_comments_apply_to_next_part():
    plan = plan_of(
        "0 !BRICKSRL ROBOT walker",
        "0 !BRICKSRL PARTS 3",
        "0 !BRICKSRL PORT a left",
        BEAM,
        "0 !BRICKSRL FREE",
        BEAM,
        BEAM,
    )
    assert (plan.robot, plan.count) == ("walker", 3)
    assert [(one.port, one.device, one.is_free) for one in plan.parts] == [
        ("A", "left", False),
        (None, None, True),
        (None, None, False),
    ]


def test_equal_parts_at_two_places_are_two():
    plan = plan_of(BEAM, "0 STEP", BEAM.replace("1 4 0 0 0", "1 4 0 0 60"))
    assert plan.parts[0] != plan.parts[1]
    assert len(set(plan.parts)) == 2


def test_unknown_parts_are_kept_with_their_lines():
    plan = plan_of(BEAM, BEAM.replace("32316", "99999"), BEAM.replace("32316", "99999"))
    assert [(unknown.number, unknown.lines) for unknown in plan.unknown] == [("99999", (2, 3))]


@pytest.mark.parametrize(
    ("lines", "says"),
    [
        (["1 4 0 0 0 1 0 0 0 1 0 0 0 1"], "line 1: cannot place a part"),
        (["1 4 0 0 nan 1 0 0 0 1 0 0 0 1 32316.dat"], "line 1: cannot place a part"),
        (["1 4 0 0 1e30 1 0 0 0 1 0 0 0 1 32316.dat"], "line 1: a number is 1,000,000 or more"),
        (["1 red 0 0 0 1 0 0 0 1 0 0 0 1 32316.dat"], "line 1: cannot place a part"),
        (
            ["1 4 0 0 0 2 0 0 0 1 0 0 0 1 32316.dat"],
            "line 1: '32316.dat' is stretched; place it without scaling",
        ),
        (
            ["1 4 0 0 0 0 0 0 0 1 0 0 0 1 a.ldr", "0 FILE a.ldr", BEAM],
            "line 1: 'a.ldr' is stretched; place it without scaling",
        ),
        (["0 !BRICKSRL PORT"], "line 1: 'PORT' is not understood; write ROBOT NAME"),
        (["0 !BRICKSRL"], "line 1: '' is not understood"),
        (
            ["0 FILE a.ldr", "0 FILE A.LDR"],
            "line 2: 'A.LDR' is the name of two models; give each one its own",
        ),
        (["0 nothing"], "places no part"),
        (
            ["0 FILE a.ldr", "1 4 0 0 0 1 0 0 0 1 0 0 0 1 a.ldr"],
            "line 2: 'a.ldr' would be nested in itself",
        ),
    ],
)
def test_unreadable_file_raises(lines, says):
    with pytest.raises(PlanError) as error:
        plan_of(*lines)
    assert says in str(error.value)
    assert "\n" not in str(error.value)


@pytest.mark.parametrize("before", ["0 a comment", "0 FILE empty.ldr"])
def test_plan_is_the_first_model_that_places_something(before: str) -> None:
    assert (
        len(plan_of(before, "0 FILE main.ldr", "1 4 0 0 0 1 0 0 0 1 0 0 0 1 32316.dat").parts) == 1
    )


def test_recursive_models_are_bounded():
    text = ["0 FILE m0.ldr", *["1 4 0 0 0 1 0 0 0 1 0 0 0 1 m1.ldr"] * 10]
    for level in range(1, 12):
        text += [f"0 FILE m{level}.ldr", *[f"1 4 0 0 0 1 0 0 0 1 0 0 0 1 m{level + 1}.ldr"] * 10]
    text += ["0 FILE m12.ldr", BEAM]
    with pytest.raises(PlanError, match=f"more than {MAX_PARTS} parts"):
        plan_of(*text)


def test_large_binary_or_missing_file_raises(tmp_path):
    large, binary = tmp_path / "large.ldr", tmp_path / "binary.ldr"
    large.write_bytes(b"0 x\n" * (ldraw_text.MAX_BYTES // 4 + 1))
    binary.write_bytes(bytes(range(256)) * 4)
    for path, says in (
        (large, "more than 8 MB"),
        (binary, "is not a text file"),
        (tmp_path / "no.ldr", "name an LDraw file"),
        (tmp_path, "name"),
    ):
        with pytest.raises(PlanError, match=says):
            read_plan(path)


def _zipped(name: str, data: bytes, method: int = zipfile.ZIP_DEFLATED) -> bytes:
    buffer = io.BytesIO()
    with zipfile.ZipFile(buffer, "w", method) as archive:
        archive.writestr(name, data)
    return buffer.getvalue()


def test_studio_file_is_a_zip(tmp_path):
    path = tmp_path / "robot.io"
    path.write_bytes(_zipped("model.ldr", (PLANS / "two_wheeler.ldr").read_bytes()))
    assert len(read_plan(path).parts) == len(read_plan(PLANS / "two_wheeler.ldr").parts)


@pytest.mark.parametrize("member", ["Model.ldr", "robot/model.ldr", "my car.mpd"])
def test_model_of_a_zip_may_have_another_name(tmp_path, member):
    path = tmp_path / "robot.io"
    with zipfile.ZipFile(path, "w") as archive:
        archive.writestr("a.png", b"")
        archive.writestr(member, BEAM)
    assert len(read_plan(path).parts) == 1


@pytest.mark.parametrize("encoding", ["utf-8-sig", "utf-16", "latin-1"])
def test_text_may_have_other_encodings_and_ends_of_lines(tmp_path, encoding):
    path = tmp_path / "robot.ldr"
    path.write_bytes(f"0 Größe\r\n{BEAM}\r\n".encode(encoding))
    assert len(read_plan(path).parts) == 1


def test_quoted_name_with_spaces():
    plan = plan_of(
        "0 FILE a.ldr", '1 16 0 0 0 1 0 0 0 1 0 0 0 1 "my car.ldr"', "0 FILE my car.ldr", BEAM
    )
    assert [placed.line for placed in plan.parts] == [4]


def test_parts_in_a_buffer_only_show_a_way():
    plan = plan_of(
        BEAM,
        "0 BUFEXCHG A STORE",
        pin(0, -90, 0),
        "0 STEP",
        "0 BUFEXCHG A RETRIEVE",
        pin(0, 10, 0),
        "0 BUFEXCHG B RETRIEVE",
    )
    assert [(placed.line, placed.step) for placed in plan.parts] == [(1, 0), (6, 1)]
    assert plan.title == "try"


def test_malicious_zip_raises(tmp_path):
    path, model = tmp_path / "robot.io", _zipped("model.ldr", BEAM.encode())
    at = model.index(b"PK\x01\x02") + 8
    encrypted = model[:at] + b"\x01" + model[at + 1 :]
    bomb = _zipped("model.ldr", b"0 x\n" * (ldraw_text.MAX_BYTES // 4 + 1))
    packed = _zipped("model.ldr", f"{BEAM}\n".encode() * 50, zipfile.ZIP_LZMA)
    cases = (
        (packed[:60] + bytes(15) + packed[75:], "damaged zip"),
        (packed[:60] + bytes(15) + packed[75:], "damaged zip"),
        (
            _zipped("picture.png", bytes(ldraw_text.MAX_BYTES + 1), zipfile.ZIP_STORED),
            "more than 8 MB.* without its renderings",
        ),
        (encrypted, "is encrypted by Studio"),
        (_zipped("x", b""), "has no model.ldr"),
        (bomb, "more than 8 MB"),
        (model[:60], "damaged zip"),
    )
    for data, says in cases:
        path.write_bytes(data)
        with pytest.raises(PlanError, match=says):
            read_plan(path)


@given(st.lists(st.text(alphabet="01 -.!eBRICKSLPOTFDAxyzldrt/n\\", max_size=60), max_size=8))
def test_any_text_parses_or_raises_plan_error(lines):
    with suppress(PlanError):
        assert plan_of(*lines).steps is not None


def test_damaged_zip_is_read_or_raises(tmp_path):
    model, path, errors = _zipped("model.ldr", f"{BEAM}\n".encode() * 20), tmp_path / "robot.io", 0
    for seed in range(600):
        rng = random.Random(seed)
        damaged = bytearray(model)
        for _ in range(rng.randint(1, 4)):
            damaged[rng.randrange(len(damaged))] = rng.randrange(256)
        path.write_bytes(damaged[: rng.randrange(len(damaged))] if rng.random() < 0.2 else damaged)
        try:
            read_plan(path)
        except PlanError:
            errors += 1
    assert 100 < errors < 600


@pytest.mark.parametrize("angle", ["x", "nan", "1e9", "90 deg"])
def test_invalid_angle_raises(angle):
    with pytest.raises(PlanError, match="is not understood"):
        plan_of(f"0 !BRICKSRL PORT A left {angle}", BEAM)


def test_mirrored_half_is_made_of_turned_parts():
    half = [
        "1 16 0 20 0 1 0 0 0 1 0 0 0 1 32316.dat",
        pin(0, 10, 20),
        "1 0 40 20 30 0 0 1 0 1 0 -1 0 0 32140.dat",
    ]
    lines = [
        "1 4 0 0 0 1 0 0 0 1 0 0 0 1 half.ldr",
        "1 4 0 0 0 -1 0 0 0 1 0 0 0 1 half.ldr",
        "0 FILE half.ldr",
        *half,
    ]
    parts = plan_of(*lines).parts
    for part, mirrored in zip(parts[:3], parts[3:], strict=True):
        assert np.linalg.det(mirrored.rotation) == pytest.approx(1.0)
        points = part.to_plan(part.part.samples) * (-1, 1, 1)
        assert mirrored.part.contains(mirrored.to_part(points), -0.2).all()


def test_equal_sub_models_have_ports_of_their_own():
    place = "1 4 {} 0 0 1 0 0 0 1 0 0 0 1 leg.ldr"
    leg = ["0 FILE leg.ldr", BEAM, "1 4 0 0 0 1 0 0 0 1 0 0 0 1 54696p02.dat"]
    plan = plan_of(
        "0 !BRICKSRL PORT A left 30",
        place.format(0),
        "0 !BRICKSRL PORT B right",
        place.format(400),
        *leg,
    )
    motors = plan.devices(DeviceKind.MOTOR)
    assert [(motor.port, motor.device, motor.angle_deg) for motor in motors] == [
        ("A", "left", 30.0),
        ("B", "right", 0.0),
    ]


@pytest.mark.parametrize(
    ("comment", "says"),
    [
        (
            "PORT A",
            (
                "line 2: 'legs.ldr' has 2 motors and sensors; write PORT before a motor or "
                "sensor in it"
            ),
        ),
        ("FREE", "line 2: 'legs.ldr' is no part; write FREE, FIXED and BALL before a part in it"),
    ],
)
def test_comment_before_sub_model_is_not_dropped(comment, says):
    motor = "1 4 {} 0 0 1 0 0 0 1 0 0 0 1 54696p02.dat"
    legs = [
        "1 4 0 0 0 1 0 0 0 1 0 0 0 1 legs.ldr",
        "0 FILE legs.ldr",
        motor.format(0),
        motor.format(400),
    ]
    with pytest.raises(PlanError, match=says):
        plan_of(f"0 !BRICKSRL {comment}", *legs)


def test_mirrored_hub_is_refused():
    with pytest.raises(
        PlanError, match="line 1: '67718.dat' is mirrored, and .* has a left and a right; turn it"
    ):
        plan_of("1 4 0 0 0 -1 0 0 0 1 0 0 0 1 67718.dat")


def test_only_unknown_parts_may_be_stretched():
    hose = "1 4 0 0 0 1 0 0 0 9 0 0 0 1 hose_piece.dat"
    assert len(plan_of(BEAM, hose).unknown) == 1
    plan = plan_of(hose, hose.replace("hose_piece", "32316"), BEAM)
    assert [(fault.line, fault.text) for fault in plan.faults] == [
        (2, "'32316.dat' is stretched; place it without scaling")
    ]


def test_rest_of_a_damaged_file_is_read(findings):
    lines = [
        BEAM,
        "1 4 0 0 zero 1 0 0 0 1 0 0 0 1 32316.dat",
        "1 4 0 90 0 -1 0 0 0 1 0 0 0 1 67718.dat",
        "1 4 0 0",
    ]
    plan = plan_of(*lines)
    assert [placed.line for placed in plan.parts] == [1]
    found = [
        (one.line, one.detail.partition(";")[0])
        for one in findings(*lines)
        if one.name == "unreadable"
    ]
    assert found[::2] == [(2, "cannot place a part"), (4, "cannot place a part")]
    assert found[1] == (
        3,
        "'67718.dat' is mirrored, and Prime hub with battery has a left and a right",
    )
    with pytest.raises(
        PlanError,
        match=r"try.ldr, line 2: cannot place a part; write 1, a colour, 12 numbers and a file",
    ):
        planned(plan)


@pytest.mark.parametrize(
    "kind", ["!LDRAW_ORG Unofficial_Part", "UNOFFICIAL PART", "Unofficial Part", "No header"]
)
def test_embedded_part_files_may_repeat(kind):
    plate = ["0 FILE 99999.dat", f"0 {kind}", "1 16 0 0 0 1 0 0 0 1 0 0 0 1 box.dat"]
    plan = plan_of("0 FILE a.ldr", BEAM, BEAM.replace("32316", "99999"), *plate, *plate)
    assert len(plan.parts) == 1
    assert [(one.number, len(one.lines)) for one in plan.unknown] == [("99999", 1)]


SEGMENT = "1 16 0 0 0 1 0 0 0 1 0 0 0 1 u9218.dat"


@pytest.mark.parametrize(
    "segments",
    [
        ["1 16 0 0 0 1 0 0 0 9 0 0 0 1 4-4cyli.dat"] * 40,
        ["0 !LDCAD GENERATED [generator=LDCad 1.6] [master=a.ldr]", *[SEGMENT] * 40],
        ["0 !LDCAD GENERATED [generator=LDCad 1.6]", "0 UNOFFICIAL PART", *[SEGMENT] * 40],
        [
            "0 !LDCAD GENERATED [generator=LDCad 1.6]",
            *[SEGMENT] * 40,
            "0 FILE u9218.dat",
            "3 16 0 0 0 1 0 0 0 1 0",
        ],
    ],
)
def test_segmented_hose_is_one_piece(segments):
    plan = plan_of(
        "0 FILE a.ldr", BEAM, BEAM.replace("32316.dat", "hose.ldr"), "0 FILE hose.ldr", *segments
    )
    assert (len(plan.parts), plan.unknown, plan.drawn) == (1, (), (3,))


def test_cable_of_ldcad_keeps_the_motor_at_its_end():
    motor, cable = SEGMENT.replace("u9218", "54675"), SEGMENT.replace("u9218.dat", "cable.ldr")
    inner = [
        "0 FILE cable.ldr",
        "0 !LDCAD GENERATED [generator=LDCad 1.7]",
        motor,
        SEGMENT.replace("u9218.dat", "piece.ldr"),
        SEGMENT,
    ]
    piece = [
        "0 FILE piece.ldr",
        "0 !LDCAD GENERATED [master=cable.ldr]",
        "0 UNOFFICIAL PART",
        SEGMENT,
        SEGMENT,
    ]
    plan = plan_of("0 FILE a.ldr", cable, *inner, *piece)
    assert [placed.part.number for placed in plan.parts] == ["54675"]
    assert (plan.unknown, len(plan.drawn)) == ((), 1)


def test_hose_of_lsynth_is_one_piece(findings):
    begin, end = "0 SYNTH BEGIN TECHNIC_FLEX_AXLE 0", "0 SYNTH END"
    lines = [
        BEAM,
        begin,
        SEGMENT,
        "0 SYNTH SYNTHESIZED BEGIN",
        SEGMENT,
        "0 SYNTH SYNTHESIZED END",
        end,
        "0 !BRICKSRL PARTS 2",
    ]
    plan = plan_of(*lines)
    assert (len(plan.parts), plan.unknown, plan.drawn) == (1, (), (2,))
    assert findings(*lines) == []
    with pytest.raises(
        PlanError, match="line 2: no 0 SYNTH END follows; write it after the last segment"
    ):
        plan_of(*lines[:5])


def test_ball_has_place_in_frame_of_next_part() -> None:
    plan = plan_of("0 !BRICKSRL BALL 0 60 -1.5", BEAM)
    assert plan.parts[0].ball == (0.0, 60.0, -1.5)
    for wrong in ("0 !BRICKSRL BALL 0 60", "0 !BRICKSRL BALL 0 60 nan", "0 !BRICKSRL BALL a b c"):
        with pytest.raises(PlanError, match="BALL X Y Z"):
            plan_of(wrong, BEAM)
