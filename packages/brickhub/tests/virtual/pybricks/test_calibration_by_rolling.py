"""The firmware's calibration of the IMU, on a hub that somebody rolls over: what it takes for a
good roll, and what it refuses."""

from __future__ import annotations

import io
from pathlib import Path

import pytest

from brickhub.robot import HubKind, Robot
from brickhub.virtual.bench_body import BenchBody
from brickhub.virtual.panel import Panel
from brickhub.virtual.run import Operation, run_file

ROLLED_MS = 1500
"""Time at which the hub is rolled onto its next side."""
LIES_MS = 2000
"""Time from which it lies there."""


class Rolled(BenchBody):
    """A hub that is rolled about its long axis onto its right side, so that its left side is up.

    Args:
        scale: what its gyroscope measures of a turn.
        lifted_deg: pitch during the roll.
        moved_deg: by which it turns about its axis while it lies there, within a second.
    """

    def __init__(self, scale: float, lifted_deg: float, moved_deg: float) -> None:
        super().__init__(Robot("hub", HubKind.PRIME))
        self.scale = scale
        self.lifted_deg = lifted_deg
        self.moved_deg = moved_deg

    @property
    def share(self) -> float:
        """Share of the roll that is done."""
        done = (self._time_ms - ROLLED_MS) / (LIES_MS - ROLLED_MS)
        return min(max(done, 0.0), 1.0)

    def tilt_deg(self) -> tuple[float, float]:
        is_rolling = 0.0 < self.share < 1.0
        return (self.lifted_deg if is_rolling else 0.0), 90.0 * self.share

    def angular_velocity_deg_s(self) -> tuple[float, float, float]:
        return (180.0 if 0.0 < self.share < 1.0 else 0.0), 0.0, 0.0

    def rotation_deg(self) -> tuple[float, float, float]:
        # The calibration begins when the hub has been at rest for a second.
        moving_s = (self._time_ms - LIES_MS - 1200) / 1000
        moved_deg = self.moved_deg * min(max(moving_s, 0.0), 0.5) / 0.5
        return 90.0 * self.scale * self.share + moved_deg, 0.0, 0.0


def calibrate(
    folder: Path, *, scale: float = 1.0, lifted_deg: float = 0.0, moved_deg: float = 0.0
) -> tuple[str, str, list[tuple[int, int]]]:
    """What the calibration prints and says in the end, and the sounds that are heard (ms, Hz)."""
    path = folder / "main.py"
    path.write_text("import _imu_calibrate\n")
    out, err = io.BytesIO(), io.StringIO()
    sounds: list[tuple[int, int]] = []

    def watch(panel: Panel) -> None:
        def changed(panel: Panel) -> None:
            if panel.sound_hz and (not sounds or sounds[-1][1] != panel.sound_hz):
                sounds.append((panel.clock_ms(), panel.sound_hz))

        panel.on_change = changed

    body = Rolled(scale, lifted_deg, moved_deg)
    operation = Operation(watch=watch)
    run_file(path, body, stdout=out, stderr=err, time_limit_s=5.0, operation=operation)
    return out.getvalue().decode(), err.getvalue(), sounds


def test_a_good_roll_is_measured_for_a_second(tmp_path: Path) -> None:
    printed, said, sounds = calibrate(tmp_path)
    assert printed.count("Roll it towards you, without lifting the hub up!") == 2
    assert printed.count("Calibrating...") == 1
    assert said == "The program was stopped at the time limit of 5 s.\n"
    (begins_ms, ready), (measures_ms, low), (done_ms, high) = sounds
    assert (ready, low, high) == (500, 1000, 500)
    assert begins_ms < ROLLED_MS
    assert LIES_MS + 900 <= measures_ms <= LIES_MS + 1200
    assert done_ms - measures_ms == pytest.approx(100 + 10 + 1000, abs=30)


@pytest.mark.parametrize(
    ("scale", "fits"),
    [(79.5 / 90, False), (80.5 / 90, True), (99.5 / 90, True), (100.5 / 90, False)],
)
def test_a_roll_has_80_to_100_degrees(tmp_path: Path, scale: float, fits: bool) -> None:
    printed, said, _ = calibrate(tmp_path, scale=scale)
    assert ("Calibrating..." in printed) is fits
    assert ("RuntimeError: Not 90 deg!" in said) is not fits


@pytest.mark.parametrize(
    ("pitch_deg", "fits"), [(3.5, True), (-3.5, True), (4.5, False), (-4.5, False)]
)
def test_a_hub_that_is_lifted_is_noticed(tmp_path: Path, pitch_deg: float, fits: bool) -> None:
    """By 4 degrees, whose sine is 0.07."""
    printed, said, _ = calibrate(tmp_path, lifted_deg=pitch_deg)
    assert ("Calibrating..." in printed) is fits
    assert ("RuntimeError: Lifted it!" in said) is not fits


@pytest.mark.parametrize(
    ("moved_deg", "fits"), [(0.9, True), (-0.9, True), (1.1, False), (-1.1, False)]
)
def test_a_hub_that_moves_while_it_is_measured_is_noticed(
    tmp_path: Path, moved_deg: float, fits: bool
) -> None:
    printed, said, sounds = calibrate(tmp_path, moved_deg=moved_deg)
    assert "Calibrating..." in printed
    assert ("RuntimeError: Moved it!" in said) is not fits
    assert len(sounds) == (3 if fits else 2)
