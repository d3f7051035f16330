"""Fixtures of plan tests."""

from __future__ import annotations

from collections.abc import Callable

import pytest
from plan_lines import findings_of, plan_of

from brickhub.finding import Finding


@pytest.fixture
def findings() -> Callable[..., list[Finding]]:
    """Findings about a plan."""
    return lambda *lines: findings_of(plan_of(*lines))
