"""A killed recording loses at most the current episode; `benchmarks/record_kill.py` tests more
often."""

from __future__ import annotations

import os
import random
import signal
import subprocess
import sys
from pathlib import Path
from types import SimpleNamespace

import pytest
from forked import ForkServer, Scratch

from benchmarks import record_kill
from benchmarks.record_kill import killed_after, opened
from bricksrl.data import load
from bricksrl.data.integrity import check, recover


@pytest.mark.skipif(
    sys.platform == "win32", reason=f"there is no signal {int(signal.SIGINT)} like SIGKILL"
)
def test_killed_recorder_loses_no_committed_episode(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, processes: ForkServer | Scratch
) -> None:
    script = f"import runpy; runpy.run_path({record_kill.__file__!r}, run_name='__main__')"

    def popen(command: list[str], *, stdout: int, text: bool) -> subprocess.Popen[str]:
        streams = (None, stdout, None)
        return processes.start(command[2:], streams, environment=dict(os.environ), script=script)

    forked = SimpleNamespace(Popen=popen, PIPE=subprocess.PIPE)
    monkeypatch.setattr(record_kill, "subprocess", forked)
    rng = random.Random(1)
    for _ in range(6):
        committed = killed_after(
            tmp_path / "set", "blind", rng.randrange(3), rng.uniform(0.0, 0.15)
        )
        found = opened(tmp_path / "set", committed)
        assert found["lost"] == 0 and 0 <= found["beyond"] <= 1 and found["pyarrow"], (
            committed,
            found,
        )
    before = len(load(tmp_path / "set").rows)
    recover(tmp_path / "set")
    assert before <= len(load(tmp_path / "set").rows) <= before + 1
    assert check(tmp_path / "set") == []
