"""Connection events of a virtual link: when what is sent arrives, and what never does."""

import random

from brickhub.hub.link.profiles import BURST_LOSS, PAUSE_MS, LinkProfile

PLACEMENT_MS = 1000
"""Duration of placing a robot: longer than the hub's watchdog."""


class Radio:
    """Connection events of one link. The same seed and calls give the same times.

    All that the hub has to send travels in the next event, so that nothing overtakes anything else.
    """

    def __init__(self, seed: int) -> None:
        self._rng = random.Random(seed)
        # The hub last heard the computer at this time.
        self._heard_ms = 0.0
        # The hub sends next in this event, and what it sends then arrives at the second time.
        self._event_ms = 0.0
        self._arrival_ms = 0.0
        # Packets are lost, now or last, between these times.
        self._burst_start_ms = 0.0
        self._burst_end_ms = 0.0

    def to_hub_ms(
        self,
        now_ms: float,
        link: LinkProfile,
    ) -> float:
        """Arrival of a command that the computer sends now."""
        # After a pause the computer's radio has to wake up first.
        if now_ms - self._heard_ms >= PAUSE_MS:
            now_ms += self._rng.uniform(0.0, link.wake_ms)
        ready_ms = now_ms + self._drawn_ms(link.jitter_ms)
        self._heard_ms = self._next_event_ms(ready_ms, link)
        return self._heard_ms

    def to_computer_ms(
        self,
        now_ms: float,
        link: LinkProfile,
    ) -> float:
        """Arrival of what the hub sends now: output of the program, or the acknowledgement of a
        command."""
        # Everything sent before an event travels in it, with one delay for all.
        if self._event_ms <= now_ms:
            self._event_ms = self._next_event_ms(now_ms, link)
            arrival_ms = self._event_ms + self._drawn_ms(link.jitter_ms)
            # Nothing overtakes what was sent earlier.
            self._arrival_ms = max(self._arrival_ms, arrival_ms)
        return self._arrival_ms

    def loses_notification(self, link: LinkProfile) -> bool:
        """Whether the hub's next notification never arrives."""
        # A link without losses draws no number, because each draw would change all later times.
        if link.lost_notifications <= 0.0:
            return False
        return self._rng.random() < link.lost_notifications

    def _next_event_ms(
        self,
        now_ms: float,
        link: LinkProfile,
    ) -> float:
        """Time of the next event in which no packet is lost."""
        # A cable has no connection events.
        if not link.interval_ms:
            return now_ms
        event_ms = (now_ms // link.interval_ms + 1) * link.interval_ms
        while link.loss and self._is_lost(event_ms, link):
            event_ms += link.interval_ms
        return event_ms

    def _is_lost(
        self,
        event_ms: float,
        link: LinkProfile,
    ) -> bool:
        # Losses come in bursts. The quiet between them is so long that, on average, as many packets
        # are lost as the link says.
        while self._burst_end_ms <= event_ms:
            quiet_ms = link.burst_ms * (BURST_LOSS / link.loss - 1.0)
            self._burst_start_ms = self._burst_end_ms + self._drawn_ms(quiet_ms)
            self._burst_end_ms = self._burst_start_ms + self._drawn_ms(link.burst_ms)
        is_in_burst = event_ms >= self._burst_start_ms
        return is_in_burst and self._rng.random() < BURST_LOSS

    def _drawn_ms(self, mean_ms: float) -> float:
        """An exponentially distributed duration."""
        return self._rng.expovariate(1.0 / mean_ms) if mean_ms else 0.0
