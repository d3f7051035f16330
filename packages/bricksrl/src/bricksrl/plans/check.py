"""Checks of building plans, of `bricktwin.plans.check`."""

from bricktwin.plans.check import *
