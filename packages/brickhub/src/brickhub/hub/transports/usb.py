"""USB: framing, and the transport to a hub with Pybricks 4.1 on a serial port.

Frames are the variant of Consistent Overhead Byte Stuffing (COBS) of SPIKE and Pybricks hubs
(https://lego.github.io/spike-prime-docs/encoding.html). A message is split into blocks at its bytes
0, 1 and 2, which are removed; a code before each block gives its length (including the code) and
the byte that ended it: ``byte * 84 + length + 2``; 255 stands for 84 bytes that none of them ended.
Then every byte is XORed with 3, so that no 1, 2 or 3 is left, and 2 ends the frame. A leading 1
(for messages of high priority) is ignored here.

Message, host to hub: ``1 on`` subscribes to events, ``2 tag command`` is a command of the profile,
``3 service u16`` reads a characteristic. Hub to host: ``1 tag u32`` is a command's error code (0
for none), ``2 event`` an event, ``3 service u16 value`` a characteristic. Source:
``lib/pbio/include/pbio/protocol.h`` of the firmware.
"""

import asyncio
import contextlib
import errno
import os
import struct
import threading
from collections.abc import Callable, Iterator
from dataclasses import dataclass
from typing import Any, Protocol

from brickhub import errors
from brickhub.hub.transports import profile
from brickhub.hub.transports.connection import Port
from brickhub.hub.transports.profile import refusal
from brickhub.hub.transports.pybricks_hub import ProfileTransport
from brickhub.robot import HubKind

FRAME_END = 0x02
_HIGH_PRIORITY = 0x01
_XOR = 0x03
_LARGEST_DELIMITER = 2
"""Bytes from 0 to this one end a block."""
_CODE_OFFSET = 2
"""Added to every code, so that none is one of the reserved bytes."""
_BLOCK_BYTES = 84
"""Largest block without its code: three delimiters times this many lengths fit a byte."""
_FULL = 0xFF
"""Code of a block of the full size that no delimiter ended."""


def encode_cobs(message: bytes) -> bytes:
    """Encode a message into a frame, including its end."""
    # The code of a block stands before it but is known only at its end; until then it is that of a
    # full block.
    out = bytearray((_FULL,))
    code_at = 0
    for byte in message:
        if byte <= _LARGEST_DELIMITER:
            block_bytes = len(out) - code_at
            out[code_at] = byte * _BLOCK_BYTES + block_bytes + _CODE_OFFSET
        else:
            out.append(byte)
            is_full = len(out) - code_at > _BLOCK_BYTES
            if not is_full:
                continue
        code_at = len(out)
        out.append(_FULL)
    # The last block ends as if a 0 followed, which the decoder leaves out.
    out[code_at] = len(out) - code_at + _CODE_OFFSET
    stuffed = bytes(byte ^ _XOR for byte in out)
    return stuffed + bytes((FRAME_END,))


def decode_cobs(frame: bytes) -> bytes:
    """Decode a frame, given without its end, into a message. Raises HubProtocolError if the frame
    is invalid."""
    stuffed = frame.removeprefix(bytes((_HIGH_PRIORITY,)))
    data = bytes(byte ^ _XOR for byte in stuffed)
    out = bytearray()
    position = 0
    while position < len(data):
        delimiter, size = _parse_code(data[position])
        block = data[position + 1 : position + size]
        if len(block) != size - 1:
            raise errors.HubProtocolError("a frame over USB is cut short; plug the hub in again")
        out += block
        position += size
        # What ended the last block is the end of the message and no byte of it.
        if delimiter is not None and position < len(data):
            out.append(delimiter)
    return bytes(out)


def _parse_code(code: int) -> tuple[int | None, int]:
    """The byte that ended a block, if any, and the length of the block including its code."""
    if code == _FULL:
        return None, _BLOCK_BYTES + 1
    if code <= _CODE_OFFSET:
        raise errors.HubProtocolError(
            "a frame over USB has a code that cannot be; plug the hub in again"
        )
    delimiter, size = divmod(code - _CODE_OFFSET - 1, _BLOCK_BYTES)
    return delimiter, size + 1


class Framer:
    """Splitter of a stream into frames. Overlong input is dropped up to the next end. ``damaged``:
    number of invalid frames."""

    def __init__(self, longest_bytes: int = 2048) -> None:
        self.damaged = 0
        self._longest_bytes = longest_bytes
        self._buffer = b""

    def feed(self, data: bytes) -> list[bytes]:
        """Take bytes and return the messages that they complete. Never raises."""
        messages = []
        *frames, rest = (self._buffer + data).split(bytes((FRAME_END,)))
        for frame in frames:
            try:
                if len(frame) > self._longest_bytes:
                    raise errors.HubProtocolError(
                        "a frame over USB is too long; plug the hub in again"
                    )
                message = decode_cobs(frame)
            except errors.HubProtocolError:
                self.damaged += 1
                continue
            # Two ends in a row have no message between them.
            if message:
                messages.append(message)
        # One byte more than allowed is kept, by which a frame that is too long is recognised.
        self._buffer = rest[: self._longest_bytes + 1]
        return messages


_LEGO_VENDOR = 0x0694
_PRODUCTS = {0x0009: 0x81, 0x0010: 0x81, 0x000D: 0x83, 0x0005: 0xE2, 0x0002: 0xE1}
"""USB product to Pybricks product: SPIKE Prime, Robot Inventor, SPIKE Essential, EV3, NXT."""
_READ_S = 0.05
"""Longest wait of the reading thread for a byte; then it looks whether the port is to be closed."""
_LAST_READ_S = 1.0
"""Time within which the reading thread ends."""
_PLUGGED_IN_S = 6.0
"""Time limit to find and connect a hub for the first time; one that does not answer says so within
it."""
# A message to the hub begins with one of these.
_SUBSCRIBE = 1
_COMMAND = 2
_READ = 3
# A message from the hub begins with one of these.
_RESPONSE = 1
_EVENT = 2
_VALUE = 3
_STANDARD = 1
_PYBRICKS = 2
_RESPONSE_BODY = struct.Struct("<BI")
_SELECTOR = struct.Struct("<BH")
_CHARACTERISTICS = {
    profile.DEVICE_NAME_UUID: (_STANDARD, 0x2A00),
    profile.FIRMWARE_REVISION_UUID: (_STANDARD, 0x2A26),
    profile.PROFILE_VERSION_UUID: (_STANDARD, 0x2A28),
    profile.PNP_ID_UUID: (_STANDARD, 0x2A50),
    profile.CAPABILITIES_UUID: (_PYBRICKS, 0x0003),
}


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
        return profile.kind_of(_PRODUCTS.get(self.product, 0))


def list_usb_hubs() -> list[UsbHub]:
    """Hubs on this computer's USB ports, by their USB ids."""
    from serial.tools.list_ports import comports

    ports = [port for port in comports() if port.vid == _LEGO_VENDOR and port.pid in _PRODUCTS]
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


class UsbPort:
    """Pybricks Profile over a serial port. Reads run in a separate thread; writes, which have a
    timeout, do not: at the end of this program, when the hub is stopped, Python starts no more work
    in other threads."""

    silence = (
        "it has LEGO's own firmware, or Pybricks before 4.1, which do not answer over USB: "
        "install Pybricks with "
        "https://code.pybricks.com, or else plug it in again"
    )

    def __init__(
        self,
        hub: UsbHub,
        open_serial: OpenSerial,
    ) -> None:
        self.name = hub.device
        self.address = hub.address
        self._hub = hub
        self._open_serial = open_serial
        self._serial: SerialPort | None = None
        self._framer = Framer()
        self._is_closing = threading.Event()
        self._tag = 0
        self._response: asyncio.Future[int] | None = None
        self._values: dict[tuple[int, int], asyncio.Future[bytes]] = {}

    async def open(
        self,
        on_event: Callable[[bytes], None],
        on_loss: Callable[[str], None],
    ) -> None:
        self._loop = asyncio.get_running_loop()
        self._on_event = on_event
        self._on_loss = on_loss
        with _serial_errors(f"open the serial port {self._hub.device}"):
            self._serial = await asyncio.to_thread(self._open_serial, self._hub.device)
        self._reader = threading.Thread(
            target=self._read_loop,
            args=(self._serial,),
            name="bricksrl-usb",
            daemon=True,
        )
        self._reader.start()
        # This ends a partial frame that another program may have left.
        await self._send(b"")
        name = await self.read(profile.DEVICE_NAME_UUID)
        self.name = name.decode("utf-8", "replace") or self._hub.device

    async def read(self, characteristic: str) -> bytes:
        selector = _CHARACTERISTICS[characteristic]
        future: asyncio.Future[bytes] = self._loop.create_future()
        self._values[selector] = future
        await self._send(bytes((_READ,)) + _SELECTOR.pack(*selector))
        value = await future
        # The first betas do not report this, but USB itself has a product id too.
        if not value and characteristic == profile.PNP_ID_UUID:
            product = _PRODUCTS.get(self._hub.product, 0)
            return struct.pack(
                "<BHHH",
                1,
                profile.LEGO_COMPANY_ID,
                product,
                0,
            )
        return value

    async def subscribe(self) -> None:
        await self._send(bytes((_SUBSCRIBE, 1)))

    async def write(
        self,
        command: bytes,
        operation: str,
    ) -> None:
        # The hub repeats the tag in its answer, by which an answer that came too late is
        # recognised.
        self._tag = (self._tag + 1) % 256
        self._response = self._loop.create_future()
        await self._send(bytes((_COMMAND, self._tag)) + command)
        code = await self._response
        if code:
            raise refusal(operation, code)

    async def close(self) -> None:
        serial = self._serial
        self._serial = None
        if serial is None:
            return
        self._is_closing.set()
        # The hub should not write what nobody reads.
        try:
            serial.write(encode_cobs(bytes((_SUBSCRIBE, 0))))
        finally:
            # On Windows a port must not be closed while it is being read.
            self._reader.join(_LAST_READ_S)
            serial.close()

    async def _send(self, message: bytes) -> None:
        serial = self._serial
        if serial is None:
            raise errors.HubDisconnectedError("the serial port is closed; open the link again")
        frame = encode_cobs(message) if message else bytes((FRAME_END,))
        with _serial_errors("write to the hub"):
            serial.write(frame)

    def _read_loop(self, serial: SerialPort) -> None:
        """Body of the reading thread."""
        reason = "its cable was pulled, or it was switched off"
        while not self._is_closing.is_set():
            try:
                data = serial.read(max(1, serial.in_waiting))
            # The port is gone, or is being closed, for which pyserial has no error of its own.
            except (OSError, TypeError, ValueError):
                break
            for message in self._framer.feed(data):
                self._call_in_loop(self._handle, message)
        if not self._is_closing.is_set():
            self._call_in_loop(self._on_loss, reason)

    def _call_in_loop(
        self,
        call: Callable[..., None],
        *arguments: object,
    ) -> None:
        # The event loop may have ended before this thread.
        with contextlib.suppress(RuntimeError):
            self._loop.call_soon_threadsafe(call, *arguments)

    def _handle(self, message: bytes) -> None:
        """Handle one message, in the event loop's thread; truncated ones are dropped."""
        kind = message[0]
        body = message[1:]
        if kind == _EVENT:
            self._on_event(body)
        elif kind == _RESPONSE and len(body) >= _RESPONSE_BODY.size:
            tag, code = _RESPONSE_BODY.unpack_from(body)
            response = self._response
            # A request that is done was cancelled at its timeout, or has been answered already.
            if response is None or response.done():
                return
            if tag == self._tag:
                response.set_result(code)
        elif kind == _VALUE and len(body) >= _SELECTOR.size:
            future = self._values.get(_SELECTOR.unpack_from(body))
            if future is not None and not future.done():
                future.set_result(body[_SELECTOR.size :])


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
