"""LDraw reader, with generated libraries."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest
from ldraw_library import placed, write_library

from bricktwin.plans import ldraw_library
from bricktwin.plans.ldraw_library import Floats, rgba, triangles_of

CERTIFIED = "0 BFC CERTIFY CCW\n"


def volume(triangles: Floats) -> float:
    """Volume of a closed surface; negative if inverted."""
    return float(
        np.einsum("ij,ij->", triangles[:, 0], np.cross(triangles[:, 1], triangles[:, 2])) / 6
    )


def read(tmp_path: Path, **parts: str) -> ldraw_library.Triangles:
    return triangles_of(write_library(tmp_path, **parts), "a.dat")


def test_ldraw_part_is_scaled_moved_coloured(tmp_path: Path) -> None:
    read_back = read(
        tmp_path,
        a=CERTIFIED + placed("box8.dat", size=(10, 2, 3), offset="100 0 0") + placed("b.dat", 15),
        b=CERTIFIED + placed("box8.dat"),
    )
    assert set(read_back) == {ldraw_library.MAIN_COLOUR, 15}
    main, white = read_back[ldraw_library.MAIN_COLOUR], read_back[15]
    assert main.shape == white.shape == (12, 3, 3)
    assert (main.min(axis=(0, 1)).tolist(), main.max(axis=(0, 1)).tolist()) == (
        [90, -2, -3],
        [110, 2, 3],
    )
    assert volume(main) == pytest.approx(20 * 4 * 6)
    assert volume(white) == pytest.approx(8)


@pytest.mark.parametrize(("first", "sign"), [("", 1), ("0 BFC INVERTNEXT\n", -1)])
@pytest.mark.parametrize("mirror", [1, -1])
def test_winding_survives_mirroring(tmp_path: Path, first: str, sign: int, mirror: int) -> None:
    text = CERTIFIED + first + placed("box8.dat", size=(mirror, 1, 1)) + placed("box8.dat", 15)
    triangles = read(tmp_path, a=text)
    assert volume(triangles[ldraw_library.MAIN_COLOUR]) == pytest.approx(8 * sign)
    assert volume(triangles[15]) == pytest.approx(8), "only the next line is turned"


def test_winding(tmp_path: Path) -> None:
    triangle = "3 16 0 0 0 1 0 0 0 1 0\n"
    root = write_library(
        tmp_path, ccw=CERTIFIED + triangle, cw="0 BFC CERTIFY CW\n" + triangle, unknown=triangle
    )
    ccw, cw, unknown = (
        triangles_of(root, f"{name}.dat")[ldraw_library.MAIN_COLOUR]
        for name in ("ccw", "cw", "unknown")
    )
    assert np.array_equal(cw, ccw[:, ::-1])
    assert np.array_equal(unknown, np.concatenate([ccw, cw])), "seen from both sides"


def test_colours(tmp_path: Path) -> None:
    root = write_library(tmp_path)
    assert rgba(root, 15) == (1.0, 1.0, 1.0, 1.0)
    assert rgba(root, 47) == pytest.approx((16 / 255, 192 / 255, 32 / 255, 128 / 255))
    assert rgba(root, 0x2FF0080) == pytest.approx((1.0, 0.0, 128 / 255, 1.0))
    assert rgba(root, -3) == rgba(root, 4711) == (0.5, 0.5, 0.5, 1.0)


def test_colour_with_a_leading_zero_is_decimal(tmp_path: Path) -> None:
    corners = "0 0 0 1 0 0 0 1 0"
    assert set(read(tmp_path, a=f"3 016 {corners}\n3 0x2FF0000 {corners}")) == {16, 0x2FF0000}


def test_broken_ldraw_lines_are_skipped(tmp_path: Path) -> None:
    broken = (
        "3 16 0 0 zero 1 0 0 0 1 0\n4 16 1 2 3\n1 16 0 0 0\n3\n3 red 0 0 0 1 0 0 0 1 0\n"
        "3 16 nan 0 0 1 0 0 0 1 0\n"
    )
    text = CERTIFIED + broken + placed("not there.dat") + placed("box8.dat")
    assert volume(read(tmp_path, a=text)[ldraw_library.MAIN_COLOUR]) == pytest.approx(8)


def test_ldraw_folder_follows_variable(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    root = write_library(tmp_path / "library")
    monkeypatch.setattr(ldraw_library, "_SYSTEM_FOLDERS", (str(tmp_path / "nowhere"), str(root)))
    monkeypatch.delenv("LDRAWDIR", raising=False)
    assert ldraw_library.folder() == root
    monkeypatch.setenv("LDRAWDIR", str(write_library(tmp_path / "other")))
    assert ldraw_library.folder() == tmp_path / "other"


def test_invalid_ldraw_variable_warns(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, caplog: pytest.LogCaptureFixture
) -> None:
    monkeypatch.setenv("LDRAWDIR", str(tmp_path))
    assert ldraw_library.folder() is None
    assert "is not an LDraw library" in caplog.text


def test_file_that_is_part_of_itself_is_left_out(tmp_path: Path) -> None:
    assert read(tmp_path, a=placed("b.dat") * 4, b=placed("box8.dat") + placed("a.dat") * 4) == {}


TRIANGLE = "3 16 0 0 0 1 0 0 0 1 0\n"
FACES = {
    "ccw": [[[0, 0, 0], [1, 0, 0], [0, 1, 0]]],
    "cw": [[[0, 1, 0], [1, 0, 0], [0, 0, 0]]],
}


@pytest.mark.parametrize(
    ("header", "seen"),
    [
        ([], "both"),
        (["CERTIFY"], "ccw"),
        (["CERTIFY CCW"], "ccw"),
        (["CERTIFY CW"], "cw"),
        # Naming a winding certifies a file as well.
        (["CCW"], "ccw"),
        (["CW"], "cw"),
        (["CLIP CW"], "cw"),
        (["NOCERTIFY"], "both"),
        (["CLIP"], "both"),
        # A later line changes what it names, and keeps the rest.
        (["CERTIFY CW", "CCW"], "ccw"),
        (["CERTIFY CCW", "CW"], "cw"),
        (["CERTIFY CW", "CLIP"], "cw"),
        (["CERTIFY CCW", "NOCLIP"], "ccw"),
        (["CERTIFY CCW", "NOCERTIFY"], "both"),
        (["CERTIFY CW", "CERTIFY"], "cw"),
        (["NOCERTIFY", "CERTIFY CCW"], "ccw"),
    ],
)
def test_a_file_says_from_which_side_its_triangles_are_seen(
    tmp_path: Path, header: list[str], seen: str
) -> None:
    text = "".join(f"0 BFC {words}\n" for words in header) + TRIANGLE
    expected = FACES["ccw"] + FACES["cw"] if seen == "both" else FACES[seen]
    assert read(tmp_path, a=text)[ldraw_library.MAIN_COLOUR].tolist() == expected


@pytest.mark.parametrize(
    ("between", "sign"), [("", -1), ("\n", -1), ("0 a comment\n", 1), (TRIANGLE, 1)]
)
def test_invertnext_holds_for_the_next_line_that_is_not_empty(
    tmp_path: Path, between: str, sign: int
) -> None:
    text = CERTIFIED + "0 BFC INVERTNEXT\n" + between + placed("box8.dat")
    triangles = read(tmp_path, a=text)[ldraw_library.MAIN_COLOUR]
    box = triangles[-12:]
    assert volume(box) == pytest.approx(8 * sign)


def test_a_quadrilateral_is_two_triangles(tmp_path: Path) -> None:
    text = CERTIFIED + "4 2 0 0 0 2 0 0 2 3 0 0 3 0\n"
    (code, triangles), *others = read(tmp_path, a=text).items()
    assert code == 2 and not others
    assert triangles.tolist() == [
        [[0, 0, 0], [2, 0, 0], [2, 3, 0]],
        [[0, 0, 0], [2, 3, 0], [0, 3, 0]],
    ]


def test_a_part_is_turned_and_moved_as_its_line_says(tmp_path: Path) -> None:
    # A quarter of a turn about y, twice as high, 5 along x.
    text = CERTIFIED + "1 16 5 6 7 0 0 1 0 2 0 -1 0 0 b.dat\n"
    found = read(tmp_path, a=text, b=CERTIFIED + "3 16 1 0 0 0 1 0 0 0 1\n")
    assert found[ldraw_library.MAIN_COLOUR].tolist() == [[[5, 6, 6], [5, 8, 7], [6, 6, 7]]]


def test_a_part_comes_before_a_primitive_of_its_name(tmp_path: Path) -> None:
    root = write_library(tmp_path, a=CERTIFIED + TRIANGLE)
    (root / "p" / "a.dat").write_text(CERTIFIED + TRIANGLE * 2)
    assert len(triangles_of(root, "a.dat")[ldraw_library.MAIN_COLOUR]) == 1
    assert triangles_of(root, "missing.dat") == {}


@pytest.mark.parametrize("missing", ["LDConfig.ldr", "parts"])
def test_a_folder_without_colours_or_parts_is_no_library(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, missing: str
) -> None:
    root = write_library(tmp_path / "library")
    (root / missing).rename(root / "elsewhere")
    monkeypatch.delenv("LDRAWDIR", raising=False)
    monkeypatch.setattr(ldraw_library, "_SYSTEM_FOLDERS", (str(root),))
    assert ldraw_library.folder() is None
    # The user's own folder counts, though another one is installed.
    good = write_library(tmp_path / "good")
    monkeypatch.setattr(ldraw_library, "_SYSTEM_FOLDERS", (str(root), str(good)))
    assert ldraw_library.folder() == good
    monkeypatch.setenv("LDRAWDIR", str(root))
    assert ldraw_library.folder() is None


def test_colours_of_a_library_may_be_transparent(tmp_path: Path) -> None:
    root = write_library(tmp_path)
    lines = (
        "0 !COLOUR Red CODE 4 VALUE #FF0000 EDGE #000000",
        "0 !COLOUR Clear CODE 5 VALUE #00FF00 EDGE #000000 ALPHA 51",
        "0 !COLOUR Odd CODE 6 VALUE #0000FF EDGE #000000 ALPHA 999",
        "0 // !COLOUR None CODE 7 VALUE #0000FF EDGE #000000",
        "0 !COLOUR Short CODE 8 VALUE #00FF EDGE #000000",
    )
    (root / "LDConfig.ldr").write_text("\n".join(lines))
    assert rgba(root, 4) == (1.0, 0.0, 0.0, 1.0)
    assert rgba(root, 5) == (0.0, 1.0, 0.0, 0.2)
    assert rgba(root, 6) == (0.0, 0.0, 1.0, 1.0)
    assert rgba(root, 7) == rgba(root, 8) == (0.5, 0.5, 0.5, 1.0)
    # From the least direct colour on, a code says red, green and blue itself.
    assert rgba(root, 0x2000000) == (0.0, 0.0, 0.0, 1.0)
