"""The states of a link, what it gives, and how the program at its other end says hello and good-bye."""

from __future__ import annotations

import enum
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from bricksrl.errors import HubError, HubProtocolError, StoppedError
from bricksrl.hub.protocol import PROTOCOL_VERSION, ByeReason, ControlFrame, Frame, Up, parse_hello


class LinkState(enum.Enum):
    """What the link may be used for."""

    DISCONNECTED = "disconnected"
    """Nothing of ours runs on the hub: call ``open``."""
    READY = "ready"
    """The program answers and has moved nothing yet."""
    ARMED = "armed"
    """Motors may be moving; the hub stops them when the host falls silent."""
    FAULT = "fault"
    """An exchange failed: call ``open`` to start over."""


@dataclass(frozen=True)
class Reading:
    """One answer of the hub.

    Attributes:
        values: float32 ``[n_channels]``, in channel order and units.
        hub_time_ms: the hub's clock, since its program started; it does not wrap.
        round_trip_s: from the first sending of the command to the answer.
    """

    values: NDArray[np.float32]
    hub_time_ms: int
    round_trip_s: float


class ProgramEndedError(HubError):
    """The program on the hub said good-bye."""


def program_ended(bye: ControlFrame) -> ProgramEndedError:
    """The error for a BYE frame."""
    is_silence = bye.payload[0] == ByeReason.SILENCE
    why = "it had not heard from this computer for too long" if is_silence else "it was told to"
    return ProgramEndedError(f"the program on the hub ended because {why}; call open() to start it again")


def is_hello(frame: Frame) -> bool:
    """Whether a program presents itself."""
    return isinstance(frame, ControlFrame) and frame.kind == Up.HELLO


def check_hello(hello: ControlFrame, expected_hash: int) -> None:
    """Raises HubProtocolError unless the program that says hello is the expected one and speaks our protocol."""
    version, program_hash = parse_hello(hello.payload)
    if version != PROTOCOL_VERSION:
        raise HubProtocolError(
            f"the hub speaks protocol {version}, this computer {PROTOCOL_VERSION}; install one version of bricksrl"
        )
    if program_hash != expected_hash:
        raise HubProtocolError(
            f"another program runs on the hub (hash {program_hash:08x}, not {expected_hash:08x}); stop it and open again"
        )


def stopped() -> StoppedError:
    """The error for whoever wants to move a robot that a human stopped."""
    return StoppedError("the robot was stopped by hand; release it when it may move again")
