"""Tables of readings over time, as programs and spreadsheets of any country write them."""

import csv
import math
import re
from dataclasses import dataclass
from pathlib import Path

from brickhub.errors import TwinError

_SEPARATORS = "\t;,"
"""Separators of columns; a line has the first one that it contains anywhere in the table."""
_EXAMPLE = "a line such as: 2.5, red"
_REMEDY = "give a file with lines such as: 2.5, red"
_EXAMPLES = {",": "2.5, red", ";": "2.5; red", "\t": "2.5, a tab, and red"}
"""Cells of a line, by what separates them."""
_DECLARATION = re.compile(r'"?sep=(.)"?', re.IGNORECASE)
"""First line with which Excel declares the separator."""
_DECIMAL_COMMA = re.compile(r"([-+]?\d*),(\d+)(\s*(?!deg)(?:[^\W\d]+|%)?)", re.IGNORECASE)
"""A number with any unit, so that a unit that nothing has is refused as such; but 10,5 deg are a
pitch and a roll."""

_TYPOGRAPHIC = str.maketrans(
    {"\N{NO-BREAK SPACE}": " ", "\N{NARROW NO-BREAK SPACE}": " ", "\N{MINUS SIGN}": "-"}
)
"""Characters that spreadsheets of some languages write into numbers, and those that a number is
read with."""


@dataclass(frozen=True)
class Row:
    """Row of a table: the text of its reading from a simulated time on, where it is written, and
    what separates its cells."""

    time_s: float
    text: str
    place: str
    separator: str


def read_rows(path: Path) -> list[Row]:
    """Rows of a table of readings, in order of time. Raises TwinError, with the line, if there are
    none or one is wrong."""
    lines = _text(path).splitlines()
    declared = _DECLARATION.fullmatch(lines[0].strip()) if lines else None
    if declared is not None:
        # Lines are emptied and not removed, because messages count them.
        lines[0] = ""
    # A tab at the beginning of a line stays, because an empty cell is before it.
    contents = [line.partition("#")[0].strip(" \r") for line in lines]
    separator = _used_separator(contents) if declared is None else declared[1]
    rows: list[Row] = []
    is_first = True
    for number, content in enumerate(contents, 1):
        cells = _cells(content, separator)
        if not any(cells):
            continue
        place = f"{path}, line {number}"
        # Spreadsheets write the names of the columns into the first line.
        has_digit = any(character.isdigit() for character in cells[0])
        names_columns = is_first and not has_digit
        is_first = False
        if not names_columns:
            rows.append(_row(cells, place, separator, rows))
    if not rows:
        raise TwinError(f"{path} has no readings; write {_EXAMPLE}")
    return rows


def _used_separator(contents: list[str]) -> str:
    """The separator of columns of a table."""
    for mark in _SEPARATORS:
        for line in contents:
            if mark in line:
                return mark
    return ","


def _text(path: Path) -> str:
    """Text of a file in UTF-8, in UTF-16 as spreadsheets write it, or in the characters of Western
    Europe."""
    try:
        data = path.read_bytes()
    except OSError as error:
        reason = error.strerror or str(error)
        raise TwinError(f"cannot read the readings in '{path}' ({reason}); {_REMEDY}") from None
    # A byte order mark, or a zero byte beside each letter of a time, means UTF-16.
    if data.startswith((b"\xff\xfe", b"\xfe\xff")):
        encodings = ["utf-16"]
    elif b"\0" in data[:4]:
        encodings = ["utf-16-be" if data.startswith(b"\0") else "utf-16-le"]
    else:
        # UTF-8 is tried first, because hardly any text in the other encoding is valid in it.
        encodings = ["utf-8-sig", "cp1252"]
    for encoding in encodings:
        try:
            text = data.decode(encoding)
        except UnicodeDecodeError:
            continue
        if "\0" not in text:
            return text.translate(_TYPOGRAPHIC)
    raise TwinError(f"cannot read the readings in '{path}' (it is no text); {_REMEDY}")


def _cells(content: str, separator: str) -> list[str]:
    """Cells of a line without quotes and with decimal points, and without empty ones at its end."""
    # An empty line gives no row.
    rows = list(csv.reader([content], delimiter=separator, skipinitialspace=True))
    cells = [cell.strip() for cell in rows[0]] if rows else []
    while cells and not cells[-1]:
        cells.pop()
    # Unless it is quoted, a cell has a comma only where commas do not separate cells.
    return [_with_point(cell) for cell in cells]


def _with_point(cell: str) -> str:
    """A number with a decimal comma as one with a point; anything else unchanged."""
    match = _DECIMAL_COMMA.fullmatch(cell)
    if match is None:
        return cell
    whole, fraction, unit = match.groups()
    return f"{whole}.{fraction}{unit}"


def _row(
    cells: list[str],
    place: str,
    separator: str,
    before: list[Row],
) -> Row:
    try:
        time_s = float(cells[0])
    except ValueError:
        # The check below refuses NaN, and thereby also "nan" and "inf", which Python reads as
        # numbers.
        time_s = math.nan
    # In a table with other separators, a comma would be part of the time.
    example = f"a line such as: {_EXAMPLES.get(separator, f'2.5 {separator} red')}"
    if not math.isfinite(time_s):
        raise TwinError(f"{place}: '{cells[0]}' is not a time in seconds; write {example}")
    if len(cells) < 2:
        raise TwinError(f"{place} has a time and no reading; write {example}")
    previous_s = before[-1].time_s if before else -math.inf
    if time_s < previous_s:
        raise TwinError(
            f"{place}: {time_s:g} s comes after {previous_s:g} s; write the lines in order of time"
        )
    return Row(
        time_s,
        ",".join(cells[1:]),
        place,
        separator,
    )
