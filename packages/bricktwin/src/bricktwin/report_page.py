"""Frame of every report: one HTML file with a look that also prints."""

from __future__ import annotations

import html
import math
from importlib import resources
from string import Template


def report_page(title: str, body: str) -> str:
    """Report as one HTML file.

    Args:
        title: its title, as plain text.
        body: its contents, as HTML.
    """
    file = resources.files("bricktwin").joinpath("report.html")
    template = Template(file.read_text(encoding="utf-8"))
    return template.substitute(title=html.escape(title), body=body)


def plain_number(value: float, digits: int = 4) -> str:
    """Number rounded to significant digits, without an exponent, trailing zeros, or a minus before
    zero.

    Digits before the decimal point are all kept: 12345.6 is "12346".
    """
    if value == 0.0:
        # -0.0 equals 0.0, and must not show its minus sign.
        return "0"
    if not math.isfinite(value):
        return f"{value:g}"
    leading = math.floor(math.log10(abs(value)))
    decimals = max(0, digits - 1 - leading)
    text = f"{value:.{decimals}f}"
    if "." not in text:
        # Only zeros behind the point go, because those of 1200 are digits of the number.
        return text
    return text.rstrip("0").rstrip(".")
