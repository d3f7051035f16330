"""Targets of commands: our robots, building plans, users' files."""

from __future__ import annotations
