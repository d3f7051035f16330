"""brickhub: Pybricks robots and hubs, real and virtual."""

import time

LOADED_NS = time.time_ns()
"""Time at which this process began to load the package."""
__version__ = "0.1.0"
HOUSES = ("brickhub", "bricktwin", "bricksrl")
"""Packages of this project; each imports only those before it."""
