"""A page with a hub on its cable, for Python of the tab without a browser."""

from __future__ import annotations

import threading
from typing import Any

from played_page import TestedPage
from played_usb_hub import PlayedUsbHub, SocketSerial

from brickhub.robot import Robot
from brickhub.virtual.body import Body

EV3_PRODUCT = 0x0005
MAX_WRITE_BYTES = 60
"""Largest command that the firmware of an EV3 takes."""


class CablePage(TestedPage):
    """A page with a hub on its cable; implements ``HubPage``, too.

    Attributes:
        hub: at the other end of the cable.
        product: USB product that the browser tells.
        written: each write of Python's.
    """

    def __init__(self, robot: Robot, body: Body | None = None) -> None:
        super().__init__()
        self.hub = PlayedUsbHub(robot, "EV3", body)
        self.hub.max_write_bytes = MAX_WRITE_BYTES
        self.product = EV3_PRODUCT
        self.written: list[bytes] = []
        self._serial: SocketSerial | None = None

    def close(self) -> None:
        self.hub.close()

    def write(self, data: bytes) -> None:
        """Write to the hub."""
        if self._serial is None:
            raise OSError("it is not connected")
        self._serial.write(data)

    def ask(self, number: int, operation: str, characteristic: str, data: str) -> None:
        answer: dict[str, Any] = {"kind": "answer", "number": number}
        try:
            answer.update(self._done(operation, bytes.fromhex(data)))
        except OSError as error:
            answer.update(error="NetworkError", message=str(error))
        self.put(answer)

    def _done(self, operation: str, data: bytes) -> dict[str, Any]:
        if operation == "connect":
            self._serial = self.hub.open_serial("")
            threading.Thread(target=self._listen, args=(self._serial,), daemon=True).start()
            return {"product": self.product}
        if operation == "close":
            serial = self._serial
            self._serial = None
            if serial is not None:
                serial.close()
            return {}
        assert operation == "write", operation
        self.written.append(data)
        self.write(data)
        return {}

    def _listen(self, serial: SocketSerial) -> None:
        while True:
            try:
                data = serial.read(256)
            except OSError:
                break
            if data:
                self.put({"kind": "event", "data": data.hex()})
        serial.close()
        # Nobody is told of an end of one's own.
        if self._serial is serial:
            self._serial = None
            self.put({"kind": "lost"})
