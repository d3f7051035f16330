"""Objects of scenes, of `bricktwin.twin.objects`."""

from __future__ import annotations

from bricktwin.twin.objects import *
