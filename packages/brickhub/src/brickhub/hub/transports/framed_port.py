"""Pybricks Profile over a stream of bytes, whoever carries them: a serial port, or a page.

A message is a frame of :mod:`~brickhub.hub.transports.cobs`. Host to hub: ``1 on`` subscribes to
events, ``2 tag command`` is a command of the profile, ``3 service u16`` reads a characteristic. Hub
to host: ``1 tag u32`` is a command's error code (0 for none), ``2 event`` an event, ``3 service u16
value`` a characteristic. Source: ``lib/pbio/include/pbio/protocol.h`` of the firmware.
"""

import asyncio
import struct
from abc import ABC, abstractmethod
from collections.abc import Callable

from brickhub.hub.transports import profile
from brickhub.hub.transports.cobs import FRAME_END, Framer, encode_cobs
from brickhub.hub.transports.profile import refusal

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
_NOBODYS_TAG = 0
"""Tag of a command whose answer nobody waits for."""
_LAST_TAG = 255
LOSS = "its cable was pulled, or it was switched off"
"""Reason of a lost link."""
UNSUBSCRIBED = encode_cobs(bytes((_SUBSCRIBE, 0)))
"""Frame after which the hub reports nothing."""


def command_frame(command: bytes, tag: int = _NOBODYS_TAG) -> bytes:
    """Frame of a command of the profile; its answer has the tag, too."""
    return encode_cobs(bytes((_COMMAND, tag)) + command)


class FramedPort(ABC):
    """A :class:`~brickhub.hub.transports.connection.Port` over a stream of bytes.

    Args:
        name, address: of the hub, as far as they are known before it says its name.

    Attributes:
        product: its Pybricks product by what carries the bytes; 0 if unknown.
    """

    silence = (
        "it has LEGO's own firmware, or Pybricks before 4.1, which do not answer over USB: "
        "install Pybricks with "
        "https://code.pybricks.com, or else plug it in again"
    )

    def __init__(
        self,
        name: str,
        address: str,
        product: int = 0,
    ) -> None:
        self.name = name
        self.address = address
        self.product = product
        self._on_event: Callable[[bytes], None] = lambda _: None
        self._on_loss: Callable[[str], None] = lambda _: None
        self._framer = Framer()
        self._tag = _NOBODYS_TAG
        self._response: asyncio.Future[int] | None = None
        self._values: dict[tuple[int, int], asyncio.Future[bytes]] = {}

    @abstractmethod
    async def _open(self) -> None:
        """Begin to carry bytes: those of the hub go to `_take`, the end of all goes to
        ``_on_loss``."""

    @abstractmethod
    async def _put(
        self,
        frame: bytes,
        operation: str,
    ) -> None:
        """Carry bytes to the hub; ``operation`` describes them in error messages."""

    @abstractmethod
    async def close(self) -> None:
        """Disconnect."""

    async def open(
        self,
        on_event: Callable[[bytes], None],
        on_loss: Callable[[str], None],
    ) -> None:
        self._on_event = on_event
        self._on_loss = on_loss
        await self._open()
        # This ends a partial frame that another program may have left.
        await self._put(bytes((FRAME_END,)), "write to the hub")
        name = await self.read(profile.DEVICE_NAME_UUID)
        self.name = name.decode("utf-8", "replace") or self.name

    async def read(self, characteristic: str) -> bytes:
        selector = _CHARACTERISTICS[characteristic]
        future: asyncio.Future[bytes] = asyncio.get_running_loop().create_future()
        self._values[selector] = future
        await self._send(bytes((_READ,)) + _SELECTOR.pack(*selector))
        value = await future
        # The first betas do not report this, but USB itself has a product id too.
        if not value and characteristic == profile.PNP_ID_UUID:
            return struct.pack(
                "<BHHH",
                1,
                profile.LEGO_COMPANY_ID,
                self.product,
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
        self._tag = self._tag % _LAST_TAG + 1
        self._response = asyncio.get_running_loop().create_future()
        await self._put(command_frame(command, self._tag), operation)
        code = await self._response
        if code:
            raise refusal(operation, code)

    async def _send(self, message: bytes) -> None:
        await self._put(encode_cobs(message), "write to the hub")

    def _take(self, data: bytes) -> None:
        """Take bytes of the hub, in the event loop's thread."""
        for message in self._framer.feed(data):
            self._handle(message)

    def _handle(self, message: bytes) -> None:
        """Handle one message; truncated ones are dropped."""
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
