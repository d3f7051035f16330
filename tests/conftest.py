"""Settings of the tests."""

from __future__ import annotations

import hermetic  # noqa: F401  before anything else is imported
from quick_files import quick_files  # noqa: F401  a fixture
