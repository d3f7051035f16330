"""Kinematics of building plans, of `bricktwin.plans.mechanism.kinematics`."""

from bricktwin.plans.mechanism.kinematics import *
