"""Tables of readings, as programs and spreadsheets of any country write them."""

from __future__ import annotations

from pathlib import Path

import pytest

from brickhub.errors import TwinError
from brickhub.virtual.given_readings import GivenReading, parse_reading
from brickhub.virtual.stimuli import COLORS

RED, BLUE = COLORS["RED"], COLORS["BLUE"]


def table(folder: Path, text: str | bytes) -> GivenReading:
    path = folder / "table.csv"
    path.write_bytes(text if isinstance(text, bytes) else text.encode())
    return parse_reading("B=@table.csv", folder)


@pytest.mark.parametrize(
    "text",
    [
        "0, red\n2.5, blue\n",
        "0;red\n2,5;blue\n",
        "0;red\r\n2,5;blue\r\n",
        "0;red\r2,5;blue\r",
        "Zeit;Farbe\n0;red\n2,5;blue\n",
        "time,color\n0,red\n2.5,blue\n",
        "0\tred\n2,5\tblue\n",
        "0\tred\n2.5\tblue\n",
        "sep=;\n0;red\n2,5;blue\n",
        '"0";"red"\n"2,5";"blue"\n',
        '"time","color"\n"0","red"\n"2,5","blue"\n',
        "0;red;;\n2,5;blue;;\n;;;\n",
        "\ufeff0;red\n2,5;blue\n",
        "# made by hand\n\n0; red # the tape\n2,5 ; BLUE\n",
        "0;red\n2,5;blue\n".encode("utf-16"),
        "Zeit\tFarbe\r\n0\tred\r\n2,5\tblue\r\n".encode("utf-16-le"),
        "\ufeff0\tred\r\n2,5\tblue\r\n".encode("utf-16-be"),
        "Größe;Wert\n0;red\n2,5;blue\n".encode("cp1252"),
        "0;red\n2,5\N{NO-BREAK SPACE};blue\n",
    ],
)
def test_tables_of_all_countries(tmp_path: Path, text: str | bytes) -> None:
    reading = table(tmp_path, text)
    assert reading.times_s == (0.0, 2.5) and reading.values == (RED, BLUE)


@pytest.mark.parametrize(
    ("text", "values"),
    [
        ("0;12,5%\n", (12.5,)),
        ("0;12,5\n", (12.5,)),
        ("0;12,5 mm\n", (12.5,)),
        ('0,"12,5"\n', (12.5,)),
        ("0;120;80;50\n", ((120.0, 80.0, 50.0),)),
        ("0\t120\t80\t50\n", ((120.0, 80.0, 50.0),)),
        ("0, 120,80,50\n", ((120.0, 80.0, 50.0),)),
        ("0;10,5;-5,5\n", ((10.5, -5.5),)),
        ("0, 10, -5deg\n", ((10.0, -5.0),)),
        ("0;\N{MINUS SIGN}5\n", (-5.0,)),
    ],
)
def test_values(tmp_path: Path, text: str, values: tuple[object, ...]) -> None:
    assert table(tmp_path, text).values == values


@pytest.mark.parametrize(
    ("text", "says"),
    [
        (
            "0, 5%\n3,5, 10%\n",
            (
                "table.csv, line 2 (a comma separates columns here; write 2.5, or separate "
                "columns by ;)"
            ),
        ),
        ("3,5, 10%\n", "table.csv, line 1 (a comma"),
        ("3,5, red\n", "table.csv, line 1 (a comma"),
        ("0, red\nlater, blue\n", "line 2: 'later' is not a time in seconds"),
        ("0, red\n2\n", "line 2 has a time and no reading"),
        ("2, red\n1, blue\n", "line 2: 1 s comes after 2 s"),
        ("nan, red\n", "has no readings"),
        ("0, red\ninf, red\n", "line 2: 'inf' is not a time"),
        ("0, crimson\n", "line 1: crimson' is not a reading"),
        ("", "has no readings"),
        ("time;color\n", "has no readings"),
        (b"\x89PNG\r\n\x1a\n\0\0\0\rIHDR", "it is no text"),
    ],
)
def test_what_is_wrong_is_said_with_its_line(tmp_path: Path, text: str | bytes, says: str) -> None:
    with pytest.raises(TwinError) as caught:
        table(tmp_path, text)
    assert says in str(caught.value) and "\n" not in str(caught.value)


@pytest.mark.parametrize(
    ("text", "says", "followed"),
    [
        ("2,5;35,5 cm\n", "35.5 cm' is in cm; write it in mm, N, % or deg", "2,5;355 mm\n"),
        ("2,5\t35,5 cm\n", "35.5 cm' is in cm; write it in mm, N, % or deg", "2,5\t355 mm\n"),
        ('"2,5","35,5cm"\n', "35.5cm' is in cm; write it in mm, N, % or deg", "2.5, 355mm\n"),
        ("2,5;0,355 m\n", "0.355 m' is in m; write it in mm, N, % or deg", "2,5;355\n"),
        ("2,5 s;355 mm\n", "write a line such as: 2.5; red", "2.5; 355 mm\n"),
        ("2,5 s\t355 mm\n", "write a line such as: 2.5, a tab, and red", "2.5\t355 mm\n"),
        ("2,5;B=355mm\n", "give one such as red, ", "2,5;355mm\n"),
    ],
)
def test_advice_works_when_it_is_followed(
    tmp_path: Path, text: str, says: str, followed: str
) -> None:
    with pytest.raises(TwinError) as caught:
        table(tmp_path, text)
    assert says in str(caught.value) and "a comma separates" not in str(caught.value)
    assert table(tmp_path, followed).values == (355.0,)


def test_commas_are_not_blamed_where_they_separate_nothing(tmp_path: Path) -> None:
    reading = table(tmp_path, "0;35,5\n2,5;35,5;6\n")
    with pytest.raises(TwinError, match=r"line 2: \(35.5, 6.0\) is not a distance"):
        reading.sense_of("UltrasonicSensor")


@pytest.mark.parametrize("text", ["B=35.5cm", "B=35cm"])
def test_unit_of_the_command_line_that_nothing_has_is_said(text: str) -> None:
    with pytest.raises(TwinError, match="is in cm; write it in mm"):
        parse_reading(text)


def test_a_value_that_does_not_suit_the_sensor_has_its_line(tmp_path: Path) -> None:
    reading = table(tmp_path, "0, 5\n3,5, 10\n")
    with pytest.raises(
        TwinError, match=r"table.csv, line 2 \(a comma separates columns.* is not a surface"
    ):
        reading.sense_of("ColorSensor")
