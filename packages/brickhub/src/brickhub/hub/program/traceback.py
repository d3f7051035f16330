"""Summary of a hub's MicroPython traceback in one line, with location and remedy."""

from __future__ import annotations

import re

from brickhub.hub.transport import MAIN_FILE

_HINTS = {
    "ENODEV": "plug the device into the port that the robot's description names",
    "MemoryError": "use fewer commands and channels, or a larger hub",
}


def describe_traceback(text: str, source: str, name: str = MAIN_FILE) -> str:
    """One line from the hub's output: the last exception, its line in ``source`` (file ``name``), and a remedy."""
    text = text[text.rfind("Traceback (") :]
    error = next((line.strip() for line in reversed(text.splitlines()) if _is_error(line)), "an unknown error")
    numbers = re.findall(rf'File "{re.escape(name)}", line (\d+)', text)
    lines = source.splitlines()
    where = ""
    if numbers and 1 <= int(numbers[-1]) <= len(lines):
        where = f" at line {numbers[-1]} ({lines[int(numbers[-1]) - 1].strip()})"
    remedy = next((hint for key, hint in _HINTS.items() if key in error), "correct the cause, then call open()")
    return f"the program on the hub raised {error}{where}; {remedy}"


def _is_error(line: str) -> bool:
    """True if a line names an exception: neither indented, nor the heading, nor the firmware's closing message."""
    return re.match(r"[A-Za-z_]\w*(:|$)", line) is not None
