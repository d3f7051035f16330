"""Radio of a virtual hub: the times at which messages arrive, by the profile of its link."""

from __future__ import annotations

import random

from brickhub.hub.link.profiles import BURST_LOSS, PAUSE_MS, LinkProfile


class Radio:
    """Connection events of one link. The same seed and calls give the same times.

    All that the hub has to send travels in the next event, so that nothing overtakes anything else.
    """

    def __init__(self, seed: int) -> None:
        self._rng = random.Random(seed)
        self._heard_ms = self._event_ms = self._arrival_ms = self._burst_start_ms = self._burst_end_ms = 0.0

    def to_hub_ms(self, now_ms: float, link: LinkProfile) -> float:
        """Arrival of a command that the computer sends now."""
        if now_ms - self._heard_ms >= PAUSE_MS:
            now_ms += self._rng.uniform(0.0, link.wake_ms)
        self._heard_ms = self._next_event_ms(now_ms + self._drawn_ms(link.jitter_ms), link)
        return self._heard_ms

    def to_computer_ms(self, now_ms: float, link: LinkProfile) -> float:
        """Arrival of what the hub sends now: output of the program, or the acknowledgement of a command."""
        if self._event_ms <= now_ms:
            self._event_ms = self._next_event_ms(now_ms, link)
            self._arrival_ms = max(self._arrival_ms, self._event_ms + self._drawn_ms(link.jitter_ms))
        return self._arrival_ms

    def loses_notification(self, link: LinkProfile) -> bool:
        """Whether the hub's next notification never arrives."""
        return link.lost_notifications > 0.0 and self._rng.random() < link.lost_notifications

    def _next_event_ms(self, now_ms: float, link: LinkProfile) -> float:
        """Time of the next event in which no packet is lost."""
        if not link.interval_ms:
            return now_ms
        event_ms = (now_ms // link.interval_ms + 1) * link.interval_ms
        while link.loss and self._is_lost(event_ms, link):
            event_ms += link.interval_ms
        return event_ms

    def _is_lost(self, event_ms: float, link: LinkProfile) -> bool:
        while self._burst_end_ms <= event_ms:
            quiet_ms = link.burst_ms * (BURST_LOSS / link.loss - 1.0)
            self._burst_start_ms = self._burst_end_ms + self._drawn_ms(quiet_ms)
            self._burst_end_ms = self._burst_start_ms + self._drawn_ms(link.burst_ms)
        return event_ms >= self._burst_start_ms and self._rng.random() < BURST_LOSS

    def _drawn_ms(self, mean_ms: float) -> float:
        """An exponentially distributed duration."""
        return self._rng.expovariate(1.0 / mean_ms) if mean_ms else 0.0
