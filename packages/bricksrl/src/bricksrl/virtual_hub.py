"""Virtual hub, of `brickhub.virtual`."""

from __future__ import annotations

from brickhub.virtual import BenchBody, Body, VirtualHub, run_file

__all__ = ["BenchBody", "Body", "VirtualHub", "run_file"]
