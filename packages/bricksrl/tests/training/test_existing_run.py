"""Whether a folder has a run or a policy, said without reading it."""

from __future__ import annotations

from pathlib import Path

import pytest

from bricksrl.errors import RunError
from bricksrl.training.existing_run import CONFIG, POLICY, existing_policy, existing_run


def test_run_and_policy_are_known_by_their_files(tmp_path: Path) -> None:
    run, policy, nothing = (tmp_path / name for name in ("run", "policy", "nothing"))
    for folder, file in ((run, CONFIG), (policy, POLICY)):
        folder.mkdir()
        (folder / file).touch()
    nothing.mkdir()
    existing_run(run)
    existing_policy(run)
    existing_policy(str(policy))
    for look, folder in (
        (existing_run, policy),
        (existing_run, nothing),
        (existing_policy, nothing),
        (existing_policy, tmp_path / "none"),
    ):
        with pytest.raises(RunError, match=f"there is no run in {folder}; choose"):
            look(folder)
