"""Random faults during a training on one hub.

For more, set ``BRICKSRL_FAULTS`` or run ``python -m benchmarks link_faults --faults 1000``.
"""

from __future__ import annotations

import os
from pathlib import Path

import pytest
from fault_course import RECOVERY_BOUND_S, run_course

from brickhub.hub.program import generate
from brickhub.hub.program.generate import WATCHDOG_MS

pytestmark = pytest.mark.realtime

FAULTS = int(os.environ.get("BRICKSRL_FAULTS", "6"))


@pytest.fixture
def short_second_stage(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(generate, "END_MS", 500)


@pytest.mark.slow
def test_training_survives_faults(tmp_path: Path, short_second_stage: None) -> None:
    report = run_course(tmp_path, FAULTS, seed=5)
    assert report.faults.total() == FAULTS and len(report.phases) > 1
    assert report.transitions >= 3 * FAULTS
    assert report.longest_recovery_s < RECOVERY_BOUND_S
    assert 0 < report.longest_silent_drive_ms <= WATCHDOG_MS
