"""Numbers and titles of reports."""

from __future__ import annotations

import math

import pytest

from bricktwin.report_page import plain_number, report_page


@pytest.mark.parametrize(
    ("value", "digits", "text"),
    [
        (1010.0, 3, "1010"),
        (1013.4, 4, "1013"),
        (123456.0, 4, "123456"),
        (-12345.6, 4, "-12346"),
        (0.05246, 4, "0.05246"),
        (0.0000123, 3, "0.0000123"),
        (9.99996, 4, "10"),
        (20.0, 4, "20"),
        (-0.5, 3, "-0.5"),
        (-0.0, 4, "0"),
        (math.nan, 4, "nan"),
        (-math.inf, 4, "-inf"),
    ],
)
def test_numbers_have_no_exponent(value: float, digits: int, text: str) -> None:
    assert plain_number(value, digits) == text


def test_title_is_text() -> None:
    page = report_page("<b> & co", "<h1>kept</h1>")
    assert "<title>&lt;b&gt; &amp; co</title>" in page and "<h1>kept</h1>" in page
