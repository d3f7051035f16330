"""States and transitions of a link, as one table for the code, its tests and the documentation."""

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


_ANY = frozenset(LinkState)
_OPEN = frozenset({LinkState.READY, LinkState.ARMED})
_CLOSED = frozenset({LinkState.DISCONNECTED, LinkState.FAULT})
_WATCHDOG = (
    "stops its motors after 0.4 s of silence; ends its program (at once during a step, else "
    "10 s later) and advertises"
)
_AT_ONCE = "stops its motors at once"


@dataclass(frozen=True)
class Transition:
    """Event that changes the state of a link, and its effect.

    Attributes:
        event: what happens.
        host: reaction of this computer.
        hub: reaction of the hub.
        errors: errors that the call raises, the usual one first; empty for none.
        before: states in which it can occur.
        after: next state.
    """

    event: str
    host: str
    hub: str = _WATCHDOG
    errors: tuple[type[BricksError], ...] = ()
    before: frozenset[LinkState] = _ANY
    after: LinkState = LinkState.FAULT


class Cause(enum.Enum):
    """All events that change the state of a link."""

    OPENED = Transition(
        "the program said hello",
        "downloads the program if it is missing, starts it, compares its hash",
        "moves nothing",
        before=_CLOSED,
        after=LinkState.READY,
    )
    ACTED = Transition(
        "a command is sent",
        "waits for the answer, sends again if none comes",
        "executes it once",
        before=_OPEN,
        after=LinkState.ARMED,
    )
    RESTED = Transition(
        "a pause begins",
        "reads from time to time, to keep the program alive",
        "stops its motors",
        before=_OPEN,
        after=LinkState.READY,
    )
    STOPPED = Transition(
        "`stop`, `close`, or the end of this program",
        "stops the program",
        _AT_ONCE,
        after=LinkState.DISCONNECTED,
    )
    HALTED = Transition(
        "emergency stop",
        "stops the program; everything raises until `release`",
        _AT_ONCE,
        (StoppedError,),
    )
    NO_ANSWER = Transition(
        "no answer in time, or a write without acknowledgement",
        "gives up; `open` connects again if necessary",
        errors=(HubTimeoutError,),
    )
    LINK_LOST = Transition(
        "the link is lost: out of reach, switched off, unplugged, rebooted",
        "`open` searches for the same hub, with growing pauses, for 20 s",
        errors=(HubDisconnectedError,),
    )
    BUSY = Transition(
        "the hub stays busy", "has retried for 2 s; `open` starts again", errors=(HubBusyError,)
    )
    REFUSED = Transition(
        "the hub refuses a command, or sends an unknown answer",
        "`open` downloads the program again",
        errors=(HubRefusedError, HubProtocolError),
    )
    RAISED = Transition(
        "the program raised",
        "reports the hub's text and the line; `open` starts the program again",
        _AT_ONCE,
        (HubProgramError,),
    )
    ENDED = Transition(
        "the program was stopped on the hub, by its button",
        "`open` starts the program again",
        _AT_ONCE,
        (ProgramStoppedError,),
    )
    SILENCE = Transition(
        "the program ended because it had not heard from this computer, for 0.4 s during a step "
        "or 10 s more between steps",
        "`read` starts the program again; `act` does not",
        "has stopped its motors and advertises",
        (SilentHubError,),
        before=_OPEN,
    )
    NOT_FOUND = Transition(
        "the hub is not found, or this computer has no Bluetooth or serial port",
        "says what to do",
        errors=(HubNotFoundError, MediumUnavailableError),
    )
    UNKNOWN = Transition(
        "anything else that the transport reports", "`open` starts again", errors=(HubError,)
    )


# Each error has one cause, so that an error alone says what happened.
_CAUSES = {error: cause for cause in Cause for error in cause.value.errors}


def cause_of(error: BricksError) -> Cause:
    """Cause of an error: that of its type, or of the nearest type that it is derived from."""
    # The most special type comes first, then its bases.
    for kind in type(error).__mro__:
        if kind in _CAUSES:
            return _CAUSES[kind]
    return Cause.UNKNOWN


def after(state: LinkState, cause: Cause) -> LinkState:
    """Next state. Raises ValueError if the cause cannot occur in this state, which is a bug of
    ours."""
    if state not in cause.value.before:
        raise ValueError(f"'{cause.value.event}' cannot come while the link is {state.value}")
    return cause.value.after


def markdown() -> str:
    """Table of transitions in Markdown, for the documentation."""
    lines = [
        "| what happens | in state | then | the call raises | this computer | the hub |",
        "|---|---|---|---|---|---|",
    ]
    for cause in Cause:
        row = cause.value
        before = "any"
        if row.before != _ANY:
            before = ", ".join(state.value for state in LinkState if state in row.before)
        error = f"`{row.errors[0].__name__}`" if row.errors else "-"
        lines.append(
            f"| {row.event} | {before} | {row.after.value} | {error} | {row.host} | {row.hub} |"
        )
    return "\n".join(lines) + "\n"
