"""The page beside the worker, as the hub sees it."""

from typing import Protocol


class Page(Protocol):
    """What goes to the page of a tab, and comes from it while a program runs."""

    def frame(self) -> None:
        """Keep the poses of the robot's bodies as they are now, beside the frame that is made."""

    def post(self, events: str, rows: bytes) -> None:
        """Send what has happened: a JSON list of events, and the rows of ``Recorder``."""

    def take(self) -> str:
        """What has come since the last call: a JSON list of messages, empty for none."""

    def may_go_on(self, time_ms: int) -> bool:
        """Whether the page has reached a simulated time; waits a little until it has, or a message
        comes."""
