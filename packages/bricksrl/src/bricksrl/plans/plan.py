"""Building plans, of `bricktwin.plans.plan`."""

from bricktwin.plans.plan import *
