"""Child processes whose parent is gone."""

from __future__ import annotations

import subprocess
import sys

CHILD = """
import time
from bricksrl import child_process
child_process.ORPHAN_S = 0.3
child_process.parent_channel(lambda message: None)(  # which does not care
    "ready"
)
while True:
    try:
        time.sleep(60)
    except BaseException:
        pass
"""


def test_busy_child_ends_after_its_parent() -> None:
    with subprocess.Popen(
        [sys.executable, "-c", CHILD], stdin=subprocess.PIPE, stdout=subprocess.PIPE
    ) as child:
        try:
            assert child.stdin is not None and child.stdout is not None and child.stdout.read(2)
            assert child.poll() is None
            child.stdin.close()
            child.wait(30.0)
        finally:
            child.kill()
