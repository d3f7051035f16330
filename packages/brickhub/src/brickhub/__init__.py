"""brickhub: Pybricks robots and hubs, real and virtual."""

from __future__ import annotations

__version__ = "0.1.0"
HOUSES = ("brickhub", "bricktwin", "bricksrl")
"""Packages of this project; each imports only those before it."""
