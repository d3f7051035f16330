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
    template = Template(
        resources.files("bricktwin").joinpath("report.html").read_text(encoding="utf-8")
    )
    return template.substitute(title=html.escape(title), body=body)


def plain_number(value: float, digits: int = 4) -> str:
    """Number rounded to significant digits, without an exponent, trailing zeros, or a minus before
    zero.

    Digits before the decimal point are all kept: 12345.6 is "12346".
    """
    if not math.isfinite(value) or value == 0.0:
        return f"{abs(value):g}" if value == 0.0 else f"{value:g}"
    leading = math.floor(math.log10(abs(value)))
    text = f"{value:.{max(0, digits - 1 - leading)}f}"
    return text.rstrip("0").rstrip(".") if "." in text else text
