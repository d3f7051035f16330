"""Kinds of commands and channels, of `brickhub.hub.kinds`."""

from __future__ import annotations

from brickhub.hub.kinds import *
