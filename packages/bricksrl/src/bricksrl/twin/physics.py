"""Physics of virtual robots, of `bricktwin.twin.physics`."""

from __future__ import annotations

from bricktwin.twin.physics import *
