"""Kinematics of building plans, of `bricktwin.plans.mechanism.kinematics`."""

from __future__ import annotations

from bricktwin.plans.mechanism.kinematics import *
