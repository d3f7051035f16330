"""Bluetooth messages between hubs. A virtual hub sends, but receives nothing."""

from __future__ import annotations

from typing import Any

from brickhub.virtual.pybricks.context import Context, RunLoop, charged, get_exact_int

_LAST_CHANNEL = 255
_MAX_PAYLOAD_BYTES = 26
_NOTHING_HEARD_DBM = -128


class Radio:
    """``hub.ble`` and ``pybricks.messaging.BLERadio``; channels 0 to 255."""

    _loop: RunLoop

    def __init__(self, context: Context, broadcast_channel: Any = None, observe_channels: Any = ()) -> None:
        self._machine, self._loop = context.machine, context.loop
        if broadcast_channel is not None and not 0 <= get_exact_int(broadcast_channel) <= _LAST_CHANNEL:
            raise ValueError("Broadcast channel must be 0 to 255 or None")
        channels = [get_exact_int(observe_channels[index]) for index in range(len(observe_channels))]
        if not all(0 <= channel <= _LAST_CHANNEL for channel in channels):
            raise ValueError("observe channel must be 0 to 255")
        self._broadcast_channel = broadcast_channel
        self._observed = frozenset(channels)

    @charged
    def broadcast(self, data: Any) -> Any:
        if self._broadcast_channel is None:
            raise RuntimeError("no broadcast channel selected")
        if data is not None:
            values = data if isinstance(data, list | tuple) else [data]
            if sum(map(_encoded_bytes, values)) + (values is not data) > _MAX_PAYLOAD_BYTES:
                raise ValueError(f"payload limited to {_MAX_PAYLOAD_BYTES} bytes")
        return self._loop.done()

    @charged
    def observe(self, channel: Any) -> None:
        self._check(channel)

    @charged
    def signal_strength(self, channel: Any) -> int:
        self._check(channel)
        return _NOTHING_HEARD_DBM

    @charged
    def version(self) -> str:
        return "v1.0"

    def _check(self, channel: Any) -> None:
        if get_exact_int(channel) not in self._observed:
            raise ValueError("channel not configured")


def _encoded_bytes(value: Any) -> int:
    """Size of a value in an advertisement: type byte and value."""
    if isinstance(value, bool):
        return 1
    if isinstance(value, int):
        return 2 if -(2**7) <= value < 2**7 else 3 if -(2**15) <= value < 2**15 else 5
    if isinstance(value, float):
        return 5
    if isinstance(value, str):
        return 1 + len(value.encode())
    if isinstance(value, bytes | bytearray | memoryview):
        return 1 + len(value)
    raise TypeError("must be True, False, int, float, str or bytes")


def radio_class(context: Context) -> type[Radio]:
    """``BLERadio`` of Pybricks 4, separate from the hub."""

    class BLERadio(Radio):
        def __init__(self, broadcast_channel: Any = None, observe_channels: Any = ()) -> None:
            super().__init__(context, broadcast_channel, observe_channels)

    return BLERadio
