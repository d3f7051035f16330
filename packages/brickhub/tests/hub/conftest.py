"""Fixtures of Bluetooth tests."""

from __future__ import annotations

from ble_fixtures import world  # noqa: F401  a fixture
