"""A simulated Pybricks hub on USB: framed messages over a byte stream."""

from __future__ import annotations

import asyncio
import contextlib
import os
import socket
import struct
import threading
from collections.abc import Callable, Coroutine
from typing import Any

from hub_firmware import PlayedFirmware, Refusal

from brickhub.hub.transports.cobs import Framer, encode_cobs
from brickhub.robot import Robot
from brickhub.virtual.body import Body

MAX_MESSAGE_BYTES = 512


class SocketSerial:
    """A serial port on a socket."""

    def __init__(self, end: socket.socket) -> None:
        self._end = end
        end.settimeout(0.05)

    @property
    def in_waiting(self) -> int:
        return 256

    def read(self, size: int) -> bytes:
        try:
            data = self._end.recv(size)
        except TimeoutError:
            return b""
        if not data:
            raise OSError("the device is gone")
        return data

    def write(self, data: bytes) -> int:
        self._end.sendall(data)
        return len(data)

    def close(self) -> None:
        self._end.close()


class PlayedUsbHub(PlayedFirmware):
    """A switched-on hub that may be plugged in.

    Attributes:
        change: function of the bytes that the hub sends.
        tells_product: whether it reports its product, unlike the first betas.
        max_write_bytes: largest command that it takes.
    """

    def __init__(self, robot: Robot, name: str = "Pybricks Hub", body: Body | None = None) -> None:
        super().__init__(robot, name, body)
        self.profile_version = "1.6.0"
        self.change: Callable[[bytes], bytes] = lambda data: data
        self.tells_product = True
        self.max_write_bytes = MAX_MESSAGE_BYTES - 1
        self.is_plugged_in = True
        self._is_subscribed = False
        self._write: Callable[[bytes], object] | None = None
        self._unplug: Callable[[], None] = lambda: None
        self._loop = asyncio.new_event_loop()
        self._thread = threading.Thread(target=self._loop.run_forever, name="usb hub", daemon=True)
        self._thread.start()
        self._cables: list[threading.Thread] = []
        self.submit(self.report_for_ever())

    @property
    def is_connected(self) -> bool:
        return self._is_subscribed and self._write is not None

    def submit(self, coroutine: Coroutine[Any, Any, Any]) -> Any:
        return asyncio.run_coroutine_threadsafe(coroutine, self._loop)

    async def notify(self, event: bytes) -> None:
        if self.is_connected:
            self._send(b"\x02" + event)

    async def settle(self) -> None:
        """Nothing: a hub on a cable is always in reach."""

    # ---- the cable

    def open_serial(self, device: str) -> SocketSerial:
        """Replacement for opening a serial port."""
        if not self.is_plugged_in:
            raise OSError(2, f"no such device {device}")
        ours, theirs = socket.socketpair()

        def unplug() -> None:
            with contextlib.suppress(OSError):
                ours.shutdown(socket.SHUT_RDWR)

        self._unplug = unplug
        self._attach(ours.recv, ours.sendall, ours.close)
        return SocketSerial(theirs)

    def attach_terminal(self) -> str:
        """A pseudo terminal connected to the hub; returns its name, once."""
        import tty

        master, slave = os.openpty()
        tty.setraw(slave)
        name, ours = os.ttyname(slave), [slave]

        def let_go() -> None:
            while ours:
                os.close(ours.pop())

        def read(size: int) -> bytes:
            data = os.read(master, size)
            # from now on the host alone holds it open, as it holds DTR: when it dies, this side
            # reads the end
            let_go()
            return data

        self._attach(read, lambda data: os.write(master, data), lambda: os.close(master))
        self._unplug = let_go
        return name

    def pull_the_cable(self) -> None:
        self.is_plugged_in = False
        self._unplug()

    def close(self) -> None:
        super().close()
        self._unplug()
        for cable in self._cables:
            cable.join(5)

        async def cancel() -> None:
            for task in asyncio.all_tasks():
                if task is not asyncio.current_task():
                    task.cancel()

        self.submit(cancel()).result(5)
        self._loop.call_soon_threadsafe(self._loop.stop)
        self._thread.join(5)
        self._loop.close()

    def _attach(
        self,
        read: Callable[[int], bytes],
        write: Callable[[bytes], object],
        shut: Callable[[], None],
    ) -> None:
        self._write = write
        thread = threading.Thread(
            target=self._listen, args=(read, write, shut), name="usb cable", daemon=True
        )
        self._cables.append(thread)
        thread.start()

    def _listen(
        self,
        read: Callable[[int], bytes],
        write: Callable[[bytes], object],
        shut: Callable[[], None],
    ) -> None:
        framer = Framer()
        while True:
            try:
                data = read(4096)
            except OSError:
                data = b""
            if not data:
                break
            for message in framer.feed(data):
                self.submit(self._on_message(message)).result(5)
        if self._write is write:
            self._write, self._is_subscribed = None, False
        shut()

    def _send(self, message: bytes) -> None:
        if self._write is not None:
            with contextlib.suppress(OSError):
                self._write(self.change(encode_cobs(message)))

    async def _on_message(self, message: bytes) -> None:
        kind, body = message[0], message[1:]
        if kind == 1:
            self._is_subscribed = bool(body[0])
            await self.send_status()
        elif kind == 2:
            try:
                await self.command(body[1:])
                code = 0
            except Refusal as refusal:
                code = refusal.code
            self._send(struct.pack("<BBI", 1, body[0], code))
        elif kind == 3:
            self._send(b"\x03" + body[:3] + self._value(*struct.unpack("<BH", body[:3])))

    def _value(self, service: int, number: int) -> bytes:
        values = {
            (1, 0x2A00): self.name.encode(),
            (1, 0x2A26): b"4.1.0b4",
            (1, 0x2A28): self.profile_version.encode(),
            (1, 0x2A50): self.product if self.tells_product else b"",
            (2, 3): self.capabilities(self.max_write_bytes),
        }
        return values.get((service, number), b"")
