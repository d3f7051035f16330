"""MicroPython: frames, for every program that a host talks to while it runs.

Names in capitals that are not defined here are the constants of the wire; ``receive`` and ``put``
are in ``stdio.py`` or ``app_data.py``.

A frame is ``A5 seq payload crc``; one with ``seq`` 0 is a control frame, ``A5 00 kind payload
crc``.
"""
# mypy: ignore-errors
# ruff: noqa: F821
# --- the hub's part ---


def crc_table():
    table = []
    for crc in range(256):
        for _ in range(8):
            crc = crc << 1 ^ (CRC_POLYNOMIAL if crc & 0x80 else 0)
        table.append(crc)
    return bytes(table)


CRC_TABLE = crc_table()


def crc8(data):
    """Checksum of a frame; over a frame that ends with its checksum it is 0."""
    crc = 0
    for byte in data:
        crc = CRC_TABLE[crc ^ byte]
    return crc


def send(head):
    """Send a frame, in pieces that fit a notification."""
    frame = head + bytes([crc8(head)])
    for start in range(0, len(frame), PIECE_BYTES):
        put(frame[start : start + PIECE_BYTES])


def wire(value):
    """Round and saturate a channel to the 16 bits that it has."""
    return max(-32768, min(32767, round(value)))


class Reader:
    """Cuts what comes in into frames. Drops what is none, byte by byte."""

    def __init__(self):
        self.data = b""

    def size(self):
        """Length of the frame that begins here, 0 when none can; while it is unknown, more than
        there is."""
        data = self.data
        if not data:
            return 1
        if data[0] != MAGIC:
            return 0
        if len(data) == 1:
            return 2
        if data[1]:
            return COMMAND_BYTES
        return CONTROL_BYTES.get(data[2], 0) if len(data) > 2 else 3

    def frame(self, patience_ms):
        """The next valid frame, or None. Waits for input once; noise without end cannot keep the
        watchdog waiting."""
        for _ in range(64):
            size = self.size()
            if len(self.data) < size:
                more = receive(patience_ms)
                if not more:
                    return None
                patience_ms = 0
                self.data += more
            elif size and crc8(self.data[:size]) == 0:
                frame = self.data[:size]
                self.data = self.data[size:]
                return frame
            else:
                self.data = self.data[1:]
        return None
