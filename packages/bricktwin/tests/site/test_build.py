"""The folder of a site: what it is made of, and what it does not replace."""

from __future__ import annotations

import re
from pathlib import Path

import pytest

from bricktwin.site import build, packages
from bricktwin.site.packages import Package, SiteError


def test_other_files_are_not_replaced(tmp_path: Path) -> None:
    (tmp_path / "homework.txt").write_text("mine")
    with pytest.raises(SiteError, match="has other files; name a new folder"):
        build.build_site(tmp_path)
    assert (tmp_path / "homework.txt").read_text() == "mine"


def test_npm_is_missing(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setenv("PATH", str(tmp_path))
    monkeypatch.setenv("XDG_CACHE_HOME", str(tmp_path / "cache"))
    with pytest.raises(SiteError, match="npm is not on this computer.*install Node.js"):
        build.build_site(tmp_path / "site")
    assert not (tmp_path / "site").exists()


def test_another_archive_is_refused(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    """A registry that answers with something else."""
    wrong = Package("crelt", "1.0.7", "AAAA")
    monkeypatch.setattr(packages, "PACKAGES", (wrong,))
    monkeypatch.setattr(
        packages, "_fetch", lambda _packages, cache: (cache / wrong.archive).write_bytes(b"other")
    )
    monkeypatch.setenv("XDG_CACHE_HOME", str(tmp_path))
    with pytest.raises(SiteError, match=r"crelt 1.0.7 has another hash"):
        packages.unpack_packages(tmp_path)
    assert not (tmp_path / "node_modules").exists()


def test_examples_have_a_title_and_run_on_the_bench() -> None:
    for program in build.programs(None):
        assert program["title"] != program["name"]
        assert re.fullmatch(r"[a-z_]+\.py", program["name"])


def test_policies_are_offered(tmp_path: Path) -> None:
    (tmp_path / "walk.py").write_text("# A gait\n# Robot: walker\n")
    assert build.programs(tmp_path)[-1] == {
        "title": "A gait",
        "name": "walk.py",
        "source": "# A gait\n# Robot: walker\n",
        "robot": "walker",
        "world": "",
    }
