"""Messages between hubs: ``hub.ble``, and ``BLERadio`` of ``pybricks.messaging``.

Names, sizes and errors: ``pb_type_ble_radio.c`` of Pybricks 4. A hub that is alone in its room
hears nothing.
"""

from typing import Any

from brickhub.virtual import error_numbers
from brickhub.virtual.air import Message, Value
from brickhub.virtual.micropython.floats import to_single
from brickhub.virtual.micropython.streams import as_bytes
from brickhub.virtual.pybricks.arguments import get_exact_int, os_error
from brickhub.virtual.pybricks.context import Native

_LAST_CHANNEL = 255
_MOST_CHANNELS = 255
"""Channels that can be observed."""
_MAX_PAYLOAD_BYTES = 26
"""Room in an advertisement of 31 bytes."""
_CHANGE_MS = 2
"""Time in which the radio takes another message; an assumption: the firmware looks for it once a
millisecond, and then asks the Bluetooth chip."""


class Radio(Native):
    """``hub.ble`` and ``pybricks.messaging.BLERadio``; channels 0 to 255."""

    def __init__(
        self,
        broadcast_channel: Any = None,
        observe_channels: Any = (),
    ) -> None:
        if broadcast_channel is not None:
            channel = get_exact_int(broadcast_channel)
            if not 0 <= channel <= _LAST_CHANNEL:
                raise ValueError("Broadcast channel must be 0 to 255 or None")
        if len(observe_channels) > _MOST_CHANNELS:
            raise ValueError("Too many observe channels")
        # Values are read by index, because anything that has a length and items will do.
        channels = []
        for index in range(len(observe_channels)):
            channels.append(get_exact_int(observe_channels[index]))
        if not all(0 <= channel <= _LAST_CHANNEL for channel in channels):
            raise ValueError("observe channel must be 0 to 255")
        self._broadcast_channel = broadcast_channel
        self._antenna = self._machine.antenna
        self._antenna.observe(channels)

    def broadcast(self, data: Any) -> Any:
        if self._broadcast_channel is None:
            raise RuntimeError("no broadcast channel selected")
        message = None if data is None else _encoded(data)
        # Outside of tasks the radio takes what the program says at once, like most calls; when the
        # others hear it is the air's part.
        now_ms = self._machine.time_ms
        antenna = self._antenna
        is_in_task = self._context.is_active
        if is_in_task and now_ms < antenna.busy_until_ms:
            raise os_error(error_numbers.EBUSY)
        new = None if message is None else (self._broadcast_channel, message)
        # Their texts are compared, as 1, 1.0 and True are equal, but not in the air.
        if repr(new) == repr(antenna.current):
            return self._context.done()
        antenna.broadcast(now_ms, self._broadcast_channel, message)
        if not is_in_task:
            return None
        antenna.busy_until_ms = now_ms + _CHANGE_MS
        return self._context.wait_until(antenna.busy_until_ms)

    def observe(self, channel: Any) -> Message | None:
        return self._observed(channel)[0]

    def signal_strength(self, channel: Any) -> int:
        return self._observed(channel)[1]

    def version(self) -> str:
        return "v1.0"

    def _observed(self, channel: Any) -> tuple[Message | None, int]:
        # The firmware keeps the number in a byte, so that 258 is channel 2.
        channel = get_exact_int(channel) & _LAST_CHANNEL
        if channel not in self._antenna.heard:
            raise ValueError("channel not configured")
        return self._antenna.observed(self._machine.time_ms, channel)


class BLERadio(Radio):
    """Radio of Pybricks 4, separate from the hub."""


def _encoded(data: Any) -> Message:
    """A message as it arrives. Raises ValueError if it is too long, TypeError if it has a value of
    another kind."""
    if isinstance(data, list | tuple):
        sizes_and_values = [_value(item) for item in data]
        size = sum(size for size, _ in sizes_and_values)
        message: Message = tuple(value for _, value in sizes_and_values)
    else:
        size, message = _value(data)
        # A byte marks a single value, so that the receiver makes no tuple of it.
        size += 1
    if size > _MAX_PAYLOAD_BYTES:
        raise ValueError(f"payload limited to {_MAX_PAYLOAD_BYTES} bytes")
    return message


def _value(value: Any) -> tuple[int, Value]:
    """Size of a value in an advertisement, with its byte of type, and the value as it arrives."""
    match value:
        # True and False are two types without a value. They come before int, because Python's bool
        # is a kind of int.
        case bool():
            return 1, value
        case int():
            return 1 + _int_bytes(value), value
        case float():
            return 5, to_single(value)
        case str():
            return 1 + len(as_bytes(value)), value
        case bytes() | bytearray() | memoryview():
            data = bytes(as_bytes(value))
            return 1 + len(data), data
    raise TypeError("must be True, False, int, float, str or bytes")


def _int_bytes(value: int) -> int:
    for size in (1, 2):
        limit = 1 << (8 * size - 1)
        if -limit <= value < limit:
            return size
    return 4
