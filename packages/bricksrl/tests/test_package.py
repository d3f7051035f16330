"""The package as a whole."""

from __future__ import annotations

import subprocess
import sys

import bricksrl


def test_import_is_light() -> None:
    program = (
        "import sys, bricksrl; bricksrl.list_envs(); print([m for m in ('torch', 'torchrl', "
        "'mujoco') if m in sys.modules])"
    )
    done = subprocess.run(
        [sys.executable, "-c", program], capture_output=True, text=True, check=True, timeout=60
    )
    assert done.stdout.strip() == "[]"


def test_public_names_exist() -> None:
    assert all(hasattr(bricksrl, name) for name in bricksrl.__all__)
