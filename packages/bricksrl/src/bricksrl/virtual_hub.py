"""Virtual hub, of `brickhub.virtual`."""

from brickhub.virtual import BenchBody, Body, VirtualHub, run_file

__all__ = ["BenchBody", "Body", "VirtualHub", "run_file"]
