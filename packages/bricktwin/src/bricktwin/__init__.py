"""bricktwin: bodies with physics, and building plans, for Pybricks robots."""

import time

LOADED_NS = time.time_ns()
"""Time at which this process began to load the package."""
__version__ = "0.1.0"
