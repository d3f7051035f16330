"""Scripts that end without closing what they opened."""

from __future__ import annotations

import os
from pathlib import Path

import pytest
from forked import ForkServer

ENV = "import bricksrl\nenv = bricksrl.make('RunAway-v0', seed=0)\nenv.rollout(3)\n"
SCRIPTS = {
    "env": ENV,
    "real time": ENV.replace("seed=0", "realtime=True"),
    "cycle": f"{ENV}env.policy = lambda tensordict: env.rand_action(tensordict)\n",
    "arena": (
        "from bricksrl.envs.arenas import make_arena\nenv = make_arena('Tag-v0', seed=0)\n"
        "env.rollout(3)\n"
    ),
    "gymnasium": (
        "import bricksrl, gymnasium\nenv = gymnasium.make('bricksrl/Spinning-v0')\n"
        "env.reset(seed=0)\n"
    ),
}


@pytest.mark.parametrize("script", SCRIPTS.values(), ids=SCRIPTS)
def test_script_ends_without_a_message(script: str, forked: ForkServer, tmp_path: Path) -> None:
    done = forked.run((), tmp_path, os.environ, 100, script=script)
    assert (done.returncode, done.stdout, done.stderr) == (0, "", "")
