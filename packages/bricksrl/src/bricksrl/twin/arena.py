"""Arenas, of `bricktwin.twin.arena`."""

from __future__ import annotations

from bricktwin.twin.arena import *
