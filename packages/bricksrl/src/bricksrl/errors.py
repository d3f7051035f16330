"""Exceptions of learning, and those of hubs and twins, all derived from `BricksError`."""

from brickhub.errors import *
from brickhub.errors import BricksError, HubError


class CameraError(BricksError):
    """A real camera that shows nothing, or cannot be read on this computer."""


class SensorError(HubError):
    """A sensor on the computer that failed or is silent; a step then ends as one with a lost
    link."""


class EncoderError(BricksError):
    """An image encoder whose weights are not on this computer."""


class RunError(BricksError):
    """A run folder that is missing, unreadable, or in the way."""


class UntrustedError(RunError):
    """A run, a policy or settings from elsewhere that would run code which the user has not
    allowed."""


class CheckpointError(RunError):
    """A checkpoint that is corrupt or of another kind."""


class DataError(BricksError):
    """A dataset that is missing, damaged, of another kind, or in the way."""


class LearnerError(BricksError):
    """The process that learns beside a robot failed or died."""


class DivergedError(BricksError):
    """An agent whose weights are no longer finite."""


class PageError(BricksError):
    """The live page cannot be served, or cannot show something."""
