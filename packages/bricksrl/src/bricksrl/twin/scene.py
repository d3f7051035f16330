"""Scenes, of `bricktwin.twin.scene`."""

from __future__ import annotations

from bricktwin.twin.scene import *
