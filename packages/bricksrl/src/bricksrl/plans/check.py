"""Checks of building plans, of `bricktwin.plans.check`."""

from __future__ import annotations

from bricktwin.plans.check import *
