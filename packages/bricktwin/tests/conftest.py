"""Settings of the tests."""

from __future__ import annotations

import hermetic  # noqa: F401  before anything else is imported
from ble_fixtures import world  # noqa: F401  a fixture
