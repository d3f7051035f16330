"""Robots and their descriptions, of `brickhub.robot` and `bricktwin.robots`."""

from __future__ import annotations

from brickhub.robot import *
from bricktwin.robots import *
