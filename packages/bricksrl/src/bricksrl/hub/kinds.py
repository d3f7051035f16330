"""Kinds of commands and channels, of `brickhub.hub.interface`."""

from __future__ import annotations

from brickhub.hub.interface import *
