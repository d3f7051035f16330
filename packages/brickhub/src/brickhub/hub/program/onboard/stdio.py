"""MicroPython: communication with the host over standard input and output."""
# mypy: ignore-errors
# --- the hub's part ---

from micropython import kbd_intr
from uselect import POLLIN, poll
from usys import stdin, stdout

INCOMING = poll()
INCOMING.register(stdin, POLLIN)


def listen():
    kbd_intr(-1)  # byte 3 is data here, not Ctrl-C


def receive(patience_ms):
    """The next byte from the host, or nothing when none came in time."""
    return stdin.buffer.read(1) if INCOMING.poll(patience_ms) else b""


def put(piece):
    """Send what fits a notification."""
    stdout.buffer.write(piece)
