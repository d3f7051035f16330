"""Building plans, of `bricktwin.plans.plan`."""

from __future__ import annotations

from bricktwin.plans.plan import *
