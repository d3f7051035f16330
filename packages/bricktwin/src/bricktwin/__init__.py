"""bricktwin: bodies with physics, and building plans, for Pybricks robots."""

from __future__ import annotations

__version__ = "0.1.0"
