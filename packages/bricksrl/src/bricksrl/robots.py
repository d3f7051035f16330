"""Robots and their descriptions, of `brickhub.robot` and `bricktwin.robots`."""

from brickhub.robot import *
from bricktwin.robots import *
