"""Commands, channels and interfaces, of `brickhub.hub.interface`."""

from __future__ import annotations

from brickhub.hub.interface import *
