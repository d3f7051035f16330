"""MicroPython: communication with the host over AppData, a buffer that the host overwrites.

Its first byte changes with every write, its second is the number of bytes that follow.
"""
# mypy: ignore-errors
# ruff: noqa: F821
# --- the hub's part ---

from pybricks.messaging import AppData
from pybricks.tools import StopWatch, wait

APP_DATA = AppData([(0, SLOT_BYTES)])
TAKEN = [0]
WAITED = StopWatch()


def listen():
    pass


def receive(patience_ms):
    """What the host wrote since the last time, or nothing when it wrote nothing in time."""
    WAITED.reset()
    data = APP_DATA.get_bytes(0)
    while data[0] == TAKEN[0]:
        if WAITED.time() >= patience_ms:
            return b""
        wait(1)
        data = APP_DATA.get_bytes(0)
    TAKEN[0] = data[0]
    return data[2 : 2 + data[1]]


def put(piece):
    """Send what fits a notification."""
    try:
        APP_DATA.write_bytes(piece)
    except OSError:
        pass  # nobody is connected; silence will end the program
