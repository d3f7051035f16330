"""Exceptions, all derived from one. Each message is one line: what happened, and what to do."""

import difflib
import enum
from collections.abc import Iterable, Iterator
from contextlib import contextmanager
from typing import ClassVar


class BricksError(Exception):
    """Root of all errors that BricksRL raises on purpose."""


class DescriptionError(BricksError, ValueError):
    """A robot or an interface is described that cannot be built."""


class UnknownOptionError(DescriptionError, TypeError):
    """An option that an environment does not have; also a ``TypeError``, as expected by libraries
    that try options out."""


class PlanError(BricksError):
    """A building plan that cannot be read or followed."""


class UnknownNameError(BricksError, LookupError):
    """A name of an environment, agent, robot or option that is not registered."""


class ProgramError(BricksError):
    """A hub program that cannot run on the hub: language, size or compilation."""


class HubError(BricksError):
    """The link to a hub failed."""


class HubTimeoutError(HubError, TimeoutError):
    """The hub did not answer in time."""


class HubProtocolError(HubError):
    """The hub's answer is not of our protocol."""


class HubProgramError(HubError):
    """The program on the hub raised; the message holds the hub's own text."""


class Reason(enum.Enum):
    """Reason why a hub cannot be reached, for programs that react to it."""

    NO_ADAPTER = "this computer has no Bluetooth"
    SWITCHED_OFF = "Bluetooth is switched off"
    NO_SERVICE = "the system's service does not run"
    DENIED = "this program may not use Bluetooth or the port"
    NOT_FOUND = "no such hub is in reach"
    SEVERAL = "several such hubs are in reach"
    TAKEN = "another program keeps the link to the hub"
    UNKNOWN = "the message says what is known"

    @property
    def is_lasting(self) -> bool:
        """Whether the error lasts until a person acts."""
        return self not in (Reason.NOT_FOUND, Reason.UNKNOWN)


class MediumUnavailableError(HubError):
    """This computer cannot reach hubs this way: ``reason`` says why."""

    def __init__(
        self,
        message: str,
        reason: Reason = Reason.UNKNOWN,
    ) -> None:
        super().__init__(message)
        self.reason = reason


class BluetoothUnavailableError(MediumUnavailableError):
    """This computer has no Bluetooth, or does not let us use it."""


class UsbUnavailableError(MediumUnavailableError):
    """This computer does not let us use its serial ports."""


class HubNotFoundError(HubError):
    """No hub, or not the requested one, is in reach."""

    reason: ClassVar[Reason] = Reason.NOT_FOUND


class HubDisconnectedError(HubError):
    """The link to the hub broke."""


class HubBusyError(HubError):
    """The hub could not take a command because a program runs, or because the program's input
    buffer is full."""


class HubRefusedError(HubError):
    """The hub refused a command."""


class ProgramStoppedError(HubError):
    """The program on the hub ended, or was stopped, for example with the hub's button."""


class SilentHubError(ProgramStoppedError):
    """The program on the hub ended with a BYE frame, for example after silence of this computer."""


class AmbiguousHubError(HubNotFoundError):
    """Several such hubs are in reach."""

    reason: ClassVar[Reason] = Reason.SEVERAL


class HubTakenError(HubNotFoundError):
    """Another program keeps the link to the hub."""

    reason: ClassVar[Reason] = Reason.TAKEN


class StoppedError(BricksError):
    """A human stopped the robot. Not a fault of the link, which is therefore not repaired."""


class TwinError(BricksError):
    """A virtual robot or its scene cannot be built, or cannot do what is requested."""


class SceneError(TwinError):
    """A function of a user's scene raised; not an error of the program on the hub that called
    it."""


class RenderingUnavailableError(TwinError):
    """No OpenGL library works on this computer."""


class WriteError(BricksError, OSError):
    """A file or folder that cannot be written where the user wants it; raised by
    `brickhub.files`."""

    # OSError would put an errno before the message.
    def __str__(self) -> str:
        return str(self.args[0])


@contextmanager
def installed(
    package: str,
    error: type[BricksError],
    words: str,
) -> Iterator[None]:
    """Raise ``error`` if the package, which is imported in this context, is not installed;
    ``words``: what pip installs."""
    try:
        yield
    except ImportError as failure:
        raise error(f"{package} is not installed; run `pip install {words}`") from failure


def message_of(
    error: BaseException,
    characters: int = 200,
    *,
    typed: bool = False,
) -> str:
    """Message of a library's or user's error in one line, at most of so many characters; with its
    type if it has none, or ``typed``: the type of an error in somebody's code says more than its
    message."""
    message = " ".join(str(error).split())
    message = message[:characters]
    name = type(error).__name__
    if message and not typed:
        return message
    return f"{name}: {message}".removesuffix(": ")


def hint(name: str, known: Iterable[str]) -> str:
    """``" (did you mean 'x'?)"``, with the known name that is most like ``name`` in any case, or
    ``""``."""
    by_lower = {candidate.lower(): candidate for candidate in known}
    close = difflib.get_close_matches(name.lower(), by_lower, n=1)
    if not close:
        return ""
    return f" (did you mean '{by_lower[close[0]]}'?)"


def counted(number: int, noun: str) -> str:
    """``"1 episode"`` or ``"2 episodes"``."""
    ending = "" if number == 1 else "s"
    return f"{number} {noun}{ending}"


def an(name: str) -> str:
    """A name with its article: ``"a prime"``, ``"an ev3"``."""
    # Of what we have names for, NXT alone is spelt letter by letter.
    sounds_like_a_vowel = name[0].lower() in "aeiou" or name.lower().startswith("nxt")
    return f"an {name}" if sounds_like_a_vowel else f"a {name}"


def percent(share: float | None) -> str:
    """``"57 %"`` for 0.57; an empty string for ``None``."""
    if share is None:
        return ""
    return f"{100 * share:.0f} %"
