"""The package as a whole."""

from __future__ import annotations

import subprocess
import sys

import bricksrl
from bricksrl.errors import counted


def test_import_is_light() -> None:
    program = "import sys, bricksrl; bricksrl.list_envs(); print([m for m in ('torch', 'torchrl', 'mujoco') if m in sys.modules])"
    done = subprocess.run([sys.executable, "-c", program], capture_output=True, text=True, check=True, timeout=60)
    assert done.stdout.strip() == "[]"


def test_public_names_exist() -> None:
    assert all(hasattr(bricksrl, name) for name in bricksrl.__all__)


def test_numbers_agree_with_their_noun() -> None:
    assert (counted(1, "episode"), counted(2, "episode")) == ("1 episode", "2 episodes")
