"""Readings of a link, and the HELLO and BYE frames of the hub program."""

from __future__ import annotations

from dataclasses import dataclass

from brickhub.errors import HubProtocolError
from brickhub.hub.hub_errors import SilentHubError
from brickhub.hub.protocol import PROTOCOL_VERSION, ByeReason, ControlFrame, Frame, Up, parse_hello


@dataclass(frozen=True)
class Reading:
    """One answer of the hub.

    Attributes:
        values: ``[n_channels]``, in channel order and units, rounded to float32.
        hub_time_ms: the hub's clock when it read its sensors, since its program started; it does not wrap.
        round_trip_s: time from the first sending of the command to the first answer.
        age_s: age of the sensor values when the reading was returned; see ``clock.py``.
    """

    values: tuple[float, ...]
    hub_time_ms: int
    round_trip_s: float
    age_s: float = 0.0


def bye_error(bye: ControlFrame) -> SilentHubError:
    """Error for a BYE frame."""
    is_silence = bye.payload[0] == ByeReason.SILENCE
    why = "it had not heard from this computer for too long" if is_silence else "it was told to"
    return SilentHubError(f"the program on the hub ended because {why}; call open() to start it again")


def is_hello(frame: Frame) -> bool:
    """True for a HELLO frame."""
    return isinstance(frame, ControlFrame) and frame.kind == Up.HELLO


def check_hello(hello: ControlFrame, expected_hash: int) -> None:
    """Raise HubProtocolError unless the HELLO has the expected program hash and our protocol version."""
    version, program_hash = parse_hello(hello.payload)
    if version != PROTOCOL_VERSION:
        raise HubProtocolError(
            f"the hub speaks protocol {version}, this computer {PROTOCOL_VERSION}; install one version of brickhub"
        )
    if program_hash != expected_hash:
        raise HubProtocolError(
            f"another program runs on the hub (hash {program_hash:08x}, not {expected_hash:08x}); stop it and open again"
        )
