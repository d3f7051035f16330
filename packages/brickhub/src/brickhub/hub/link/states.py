"""States and transitions of a link, as one table for the code, its tests and the documentation."""

from __future__ import annotations

import enum
from dataclasses import dataclass

from brickhub.errors import (
    BricksError,
    HubBusyError,
    HubDisconnectedError,
    HubError,
    HubNotFoundError,
    HubProgramError,
    HubProtocolError,
    HubRefusedError,
    HubTimeoutError,
    MediumUnavailableError,
    ProgramStoppedError,
    SilentHubError,
    StoppedError,
)


class LinkState(enum.Enum):
    """State of a link."""

    DISCONNECTED = "disconnected"
    """No program of ours runs on the hub: call ``open``."""
    READY = "ready"
    """The program is running and has not moved anything yet."""
    ARMED = "armed"
    """Motors may be moving; the hub stops them when the host falls silent."""
    FAULT = "fault"
    """An exchange failed: call ``open`` to start over."""


class Cause(enum.Enum):
    """Event that changes the state of a link."""

    OPENED = "the program said hello"
    ACTED = "a command is sent"
    RESTED = "a pause begins"
    STOPPED = "`stop`, `close`, or the end of this program"
    HALTED = "emergency stop"
    NO_ANSWER = "no answer in time, or a write without acknowledgement"
    LINK_LOST = "the link is lost: out of reach, switched off, unplugged, rebooted"
    BUSY = "the hub stays busy"
    REFUSED = "the hub refuses a command, or sends an unknown answer"
    RAISED = "the program raised"
    ENDED = "the program was stopped on the hub, by its button"
    SILENCE = "the program ended because it had not heard from this computer, for 0.4 s during a step or 10 s more between steps"
    NOT_FOUND = "the hub is not found, or this computer has no Bluetooth or serial port"
    UNKNOWN = "anything else that the transport reports"


_ANY = frozenset(LinkState)
_OPEN = frozenset({LinkState.READY, LinkState.ARMED})
_CLOSED = frozenset({LinkState.DISCONNECTED, LinkState.FAULT})


@dataclass(frozen=True)
class Transition:
    """Effect of one cause.

    Attributes:
        before: states in which the cause can occur.
        after: next state.
        errors: errors that the call raises, the usual one first; empty for none.
        host: reaction of this computer.
        hub: reaction of the hub.
    """

    before: frozenset[LinkState]
    after: LinkState
    errors: tuple[type[BricksError], ...]
    host: str
    hub: str


_WATCHDOG = "stops its motors after 0.4 s of silence; ends its program (at once during a step, else 10 s later) and advertises"

TABLE: dict[Cause, Transition] = {
    Cause.OPENED: Transition(
        _CLOSED,
        LinkState.READY,
        (),
        "downloads the program if it is missing, starts it, compares its hash",
        "moves nothing",
    ),
    Cause.ACTED: Transition(_OPEN, LinkState.ARMED, (), "waits for the answer, sends again if none comes", "executes it once"),
    Cause.RESTED: Transition(
        _OPEN, LinkState.READY, (), "reads from time to time, to keep the program alive", "stops its motors"
    ),
    Cause.STOPPED: Transition(_ANY, LinkState.DISCONNECTED, (), "stops the program", "stops its motors at once"),
    Cause.HALTED: Transition(
        _ANY, LinkState.FAULT, (StoppedError,), "stops the program; everything raises until `release`", "stops its motors at once"
    ),
    Cause.NO_ANSWER: Transition(
        _ANY, LinkState.FAULT, (HubTimeoutError,), "gives up; `open` connects again if necessary", _WATCHDOG
    ),
    Cause.LINK_LOST: Transition(
        _ANY,
        LinkState.FAULT,
        (HubDisconnectedError,),
        "`open` searches for the same hub, with growing pauses, for 20 s",
        _WATCHDOG,
    ),
    Cause.BUSY: Transition(_ANY, LinkState.FAULT, (HubBusyError,), "has retried for 2 s; `open` starts again", _WATCHDOG),
    Cause.REFUSED: Transition(
        _ANY, LinkState.FAULT, (HubRefusedError, HubProtocolError), "`open` downloads the program again", _WATCHDOG
    ),
    Cause.RAISED: Transition(
        _ANY,
        LinkState.FAULT,
        (HubProgramError,),
        "reports the hub's text and the line; `open` starts the program again",
        "stops its motors at once",
    ),
    Cause.ENDED: Transition(
        _ANY, LinkState.FAULT, (ProgramStoppedError,), "`open` starts the program again", "stops its motors at once"
    ),
    Cause.SILENCE: Transition(
        _OPEN,
        LinkState.FAULT,
        (SilentHubError,),
        "`read` starts the program again; `act` does not",
        "has stopped its motors and advertises",
    ),
    Cause.NOT_FOUND: Transition(_ANY, LinkState.FAULT, (HubNotFoundError, MediumUnavailableError), "says what to do", _WATCHDOG),
    Cause.UNKNOWN: Transition(_ANY, LinkState.FAULT, (HubError,), "`open` starts again", _WATCHDOG),
}

_CAUSES = {error: cause for cause, transition in TABLE.items() for error in transition.errors}


def cause_of(error: BricksError) -> Cause:
    """Cause of an error: that of its type, or of the nearest type that it is derived from."""
    return next((_CAUSES[kind] for kind in type(error).__mro__ if kind in _CAUSES), Cause.UNKNOWN)


def after(state: LinkState, cause: Cause) -> LinkState:
    """Next state. Raises ValueError if the cause cannot occur in this state, which is a bug of ours."""
    transition = TABLE[cause]
    if state not in transition.before:
        raise ValueError(f"'{cause.value}' cannot come while the link is {state.value}")
    return transition.after


def markdown() -> str:
    """Table of transitions in Markdown, for the documentation."""
    lines = ["| what happens | in state | then | the call raises | this computer | the hub |", "|---|---|---|---|---|---|"]
    for cause, row in TABLE.items():
        before = "any" if row.before == _ANY else ", ".join(state.value for state in LinkState if state in row.before)
        error = f"`{row.errors[0].__name__}`" if row.errors else "-"
        lines.append(f"| {cause.value} | {before} | {row.after.value} | {error} | {row.host} | {row.hub} |")
    return "\n".join(lines) + "\n"
