"""Transport to a hub with Pybricks 4.1 on a serial port of USB."""

import asyncio
import contextlib
import errno
import os
import threading
from collections.abc import Callable, Iterator
from dataclasses import dataclass
from typing import Any, Protocol

from brickhub import errors
from brickhub.hub.transports import profile
from brickhub.hub.transports.connection import Port
from brickhub.hub.transports.framed_port import LOSS, UNSUBSCRIBED, FramedPort
from brickhub.hub.transports.pybricks_hub import ProfileTransport
from brickhub.robot import HubKind

LEGO_VENDOR = 0x0694
"""USB vendor."""
PRODUCTS = {0x0009: 0x81, 0x0010: 0x81, 0x000D: 0x83, 0x0005: 0xE2, 0x0002: 0xE1}
"""USB product to Pybricks product: SPIKE Prime, Robot Inventor, SPIKE Essential, EV3, NXT."""
_READ_S = 0.05
"""Longest wait of the reading thread for a byte; then it looks whether the port is to be closed."""
_LAST_READ_S = 1.0
"""Time within which the reading thread ends."""
_PLUGGED_IN_S = 6.0
"""Time limit to find and connect a hub for the first time; one that does not answer says so within
it."""


class SerialPort(Protocol):
    """Used part of ``serial.Serial``; ``read`` waits for ``_READ_S`` at most."""

    @property
    def in_waiting(self) -> int: ...

    def read(self, size: int, /) -> bytes: ...

    def write(self, data: bytes, /) -> int | None: ...

    def close(self) -> None: ...


OpenSerial = Callable[[str], SerialPort]


@dataclass(frozen=True)
class UsbHub:
    """Hub on a serial port.

    Attributes:
        device: name of the port.
        address: identifier of the hub: its serial number if known, else the port.
        product: id of the USB product; 0 if unknown.
    """

    device: str
    address: str
    product: int = 0

    @property
    def kind(self) -> HubKind | None:
        """Its kind; ``None`` if unknown."""
        return profile.kind_of(PRODUCTS.get(self.product, 0))


def list_usb_hubs() -> list[UsbHub]:
    """Hubs on this computer's USB ports, by their USB ids."""
    from serial.tools.list_ports import comports

    ports = [port for port in comports() if port.vid == LEGO_VENDOR and port.pid in PRODUCTS]
    return [UsbHub(port.device, port.serial_number or port.device, port.pid) for port in ports]


class UsbTransport(ProfileTransport):
    """A :class:`~brickhub.hub.transport.Transport` over USB.

    Args:
        port: serial port, such as ``/dev/ttyACM0`` or ``COM3``; without one there must be a single
            hub.
        open_serial: opens a serial port; by default with pyserial.
        find_hubs: lists the connected hubs.
        options: see :class:`ProfileTransport`.
    """

    def __init__(
        self,
        port: str | None = None,
        *,
        open_serial: OpenSerial | None = None,
        find_hubs: Callable[[], list[UsbHub]] = list_usb_hubs,
        **options: Any,
    ) -> None:
        super().__init__(**options)
        self._serial_port = port
        self._open_serial = open_serial or _open_serial
        self._find_hubs = find_hubs

    def _search_s(self) -> float:
        """A hub that is plugged in is there within a second; only one that was lost is waited
        for."""
        search_s = super()._search_s()
        if self._first_hub is not None:
            return search_s
        return min(search_s, _PLUGGED_IN_S)

    async def _find(self, timeout_s: float) -> Port:
        # Listing ports blocks, so it runs in a thread.
        hubs = await asyncio.to_thread(self._find_hubs)
        port = self._serial_port
        first = self._first_hub
        # A hub that was plugged in again may be at another port.
        if first is not None:
            hubs = [hub for hub in hubs if hub.address == first.address]
        elif port is not None:
            # Windows accepts its port names in lower case too.
            hubs = [hub for hub in hubs if hub.device.casefold() == port.casefold()]
        # A port that was named is tried even if no known hub is there.
        is_first_hub_there = first is None or first.address == port
        if not hubs and port is not None and is_first_hub_there:
            hubs = [UsbHub(port, port)]
        if not hubs:
            raise errors.HubNotFoundError(
                "no hub with Pybricks 4.1 is on USB; plug it in and switch it on, or name its "
                "serial port"
            )
        if len(hubs) > 1:
            ports = ", ".join(hub.device for hub in hubs)
            raise errors.AmbiguousHubError(
                f"several hubs are on USB: {ports}; say which one by its port, such as "
                f"usb:{hubs[0].device}"
            )
        return UsbPort(hubs[0], self._open_serial)


class UsbPort(FramedPort):
    """Pybricks Profile over a serial port. Reads run in a separate thread; writes, which have a
    timeout, do not: at the end of this program, when the hub is stopped, Python starts no more work
    in other threads."""

    def __init__(
        self,
        hub: UsbHub,
        open_serial: OpenSerial,
    ) -> None:
        super().__init__(hub.device, hub.address, PRODUCTS.get(hub.product, 0))
        self._hub = hub
        self._open_serial = open_serial
        self._serial: SerialPort | None = None
        self._is_closing = threading.Event()

    async def _open(self) -> None:
        self._loop = asyncio.get_running_loop()
        with _serial_errors(f"open the serial port {self._hub.device}"):
            self._serial = await asyncio.to_thread(self._open_serial, self._hub.device)
        self._reader = threading.Thread(
            target=self._read_loop,
            args=(self._serial,),
            name="bricksrl-usb",
            daemon=True,
        )
        self._reader.start()

    async def close(self) -> None:
        serial = self._serial
        self._serial = None
        if serial is None:
            return
        self._is_closing.set()
        # The hub should not write what nobody reads.
        try:
            serial.write(UNSUBSCRIBED)
        finally:
            # On Windows a port must not be closed while it is being read.
            self._reader.join(_LAST_READ_S)
            serial.close()

    async def _put(
        self,
        frame: bytes,
        operation: str,
    ) -> None:
        serial = self._serial
        if serial is None:
            raise errors.HubDisconnectedError("the serial port is closed; open the link again")
        with _serial_errors(operation):
            serial.write(frame)

    def _read_loop(self, serial: SerialPort) -> None:
        """Body of the reading thread."""
        while not self._is_closing.is_set():
            try:
                data = serial.read(max(1, serial.in_waiting))
            # The port is gone, or is being closed, for which pyserial has no error of its own.
            except (OSError, TypeError, ValueError):
                break
            if data:
                self._call_in_loop(self._take, data)
        if not self._is_closing.is_set():
            self._call_in_loop(self._on_loss, LOSS)

    def _call_in_loop(
        self,
        call: Callable[..., None],
        *arguments: object,
    ) -> None:
        # The event loop may have ended before this thread.
        with contextlib.suppress(RuntimeError):
            self._loop.call_soon_threadsafe(call, *arguments)


def _open_serial(device: str) -> SerialPort:
    import serial

    # The hub sends only while the port is open (DTR, which pyserial sets).
    port: SerialPort = serial.Serial(
        device,
        timeout=_READ_S,
        write_timeout=1.0,
        exclusive=True,
    )
    return port


@contextlib.contextmanager
def _serial_errors(operation: str) -> Iterator[None]:
    """Translate pyserial's errors into ours."""
    try:
        yield
    # OSError covers serial.SerialException, which is one.
    except OSError as error:
        # Of an error of the system pyserial's text has its number twice, and Python's own words.
        why = errors.message_of(error) if error.errno is None else os.strerror(error.errno)
        if error.errno in (errno.EACCES, errno.EPERM):
            remedy = "allow it: on Linux, join the group dialout and log in again"
            raise errors.UsbUnavailableError(
                f"could not {operation} ({why}); {remedy}", errors.Reason.DENIED
            ) from error
        remedy = "plug the hub in, switch it on, and close other programs that use it"
        raise errors.HubDisconnectedError(f"could not {operation} ({why}); {remedy}") from error
