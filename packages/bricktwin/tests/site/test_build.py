"""The folder of a site: what it is made of, and what it does not replace."""

from __future__ import annotations

import json
import re
import sys
import zipfile
from pathlib import Path

import pytest

from bricktwin.site import build, compiled, packages
from bricktwin.site.packages import Package, SiteError
from bricktwin.site.tab.plain_values import plain
from bricktwin.twin.scene import Scene

ROOT = Path(__file__).parents[4]


def test_other_files_are_not_replaced(tmp_path: Path) -> None:
    (tmp_path / "homework.txt").write_text("mine")
    with pytest.raises(SiteError, match="has other files; name a new folder"):
        build.build_site(tmp_path)
    assert (tmp_path / "homework.txt").read_text() == "mine"


def test_a_fresh_site_takes_the_place_of_the_old_one(tmp_path: Path) -> None:
    old, fresh = tmp_path / "old", tmp_path / "fresh"
    for folder, name in ((old, "before"), (fresh, "after")):
        (folder / name).mkdir(parents=True)
        for file in ("both.txt", f"{name}.txt", f"{name}/deep.txt"):
            (folder / file).write_text(name)
    for out in (old, tmp_path / "new" / "site"):
        build._replace(out, fresh)
        files = sorted(path.relative_to(out).as_posix() for path in out.rglob("*"))
        assert files == ["after", "after.txt", "after/deep.txt", "both.txt"]
        assert (out / "both.txt").read_text() == "after"


def test_a_build_is_named_by_what_is_in_the_site(tmp_path: Path) -> None:
    builds = []
    for content in ("one", "one", "two"):
        (tmp_path / "page.html").write_text(content)
        (tmp_path / "img").mkdir(exist_ok=True)
        (tmp_path / "img" / "dot.svg").write_text("<svg/>")
        build._finish(tmp_path)
        listed = json.loads((tmp_path / build.LIST).read_text())
        assert listed["files"] == {"img/dot.svg": 6, "page.html": 3}
        assert listed["build"] in (tmp_path / build._SERVICE_WORKER).read_text()
        builds.append(listed["build"])
        for made in (build.LIST, build._SERVICE_WORKER):
            (tmp_path / made).unlink()
    assert builds[0] == builds[1] != builds[2]


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
    examples = build.programs(None)
    partners = {program["name"]: program["partner"] for program in examples}
    for program in examples:
        assert program["title"] != program["name"]
        assert re.fullmatch(r"[a-z_]+\.py", program["name"])
        # Of two hubs' programs each names the other.
        partner = program["partner"]
        assert not partner or partners[partner] == program["name"]


def test_policies_are_offered(tmp_path: Path) -> None:
    (tmp_path / "walk.py").write_text("# A gait\n# Robot: walker\n")
    assert build.programs(tmp_path)[-1] == {
        "title": "A gait",
        "name": "walk.py",
        "source": "# A gait\n# Robot: walker\n",
        "robot": "walker",
        "world": "",
        "partner": "",
        "files": {},
    }


def test_a_policy_brings_its_world(tmp_path: Path) -> None:
    (tmp_path / "away.py").write_text("# A network\n# Robot: two-wheeler away\n")
    scene = Scene(wall_distance_mm=(200.0, 300.0))
    (tmp_path / "away.json").write_text(json.dumps(plain(scene)))
    offered = build.programs(tmp_path)
    assert build._named_worlds(offered, tmp_path) == {"two-wheeler": {"away": scene}}
    (tmp_path / "away.json").write_text("[1, 2]")
    with pytest.raises(SiteError, match=r"away.json is not the world of a policy"):
        build._named_worlds(offered, tmp_path)


def test_modules_that_are_left_out_are_whole_names() -> None:
    kept = ("traceback.py", "html/entities.py", "encodings/utf_8.py", "importlib/readers.py")
    assert not [name for name in kept if compiled._NEVER_ASKED.match(name)]
    left_out = ("trace.py", "http/client.py", "encodings/big5.py", "email/message.py")
    assert all(compiled._NEVER_ASKED.match(name) for name in left_out)


def test_a_compiler_that_fails_is_told(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    (tmp_path / "pyodide").mkdir()
    with zipfile.ZipFile(tmp_path / "pyodide" / compiled.LIBRARY, "w") as archive:
        archive.writestr("io.py", "")
    monkeypatch.setattr(compiled, "node", lambda: sys.executable)
    work = tmp_path / "work"
    work.mkdir()
    with pytest.raises(SiteError, match="modules for the tab cannot be compiled: .*Error"):
        compiled.write_archives(tmp_path / "pyodide", b"", work, tmp_path / "made")


@pytest.mark.slow
def test_the_whole_site_transfers_at_most_12_mb(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    """With all robots and worlds; a phone downloads it once."""
    monkeypatch.setenv("XDG_CACHE_HOME", str(ROOT / "build" / "site-cache"))
    try:
        files = build.build_site(tmp_path / "site")
    except SiteError as error:
        pytest.skip(str(error))
    assert sum(path.stat().st_size for path in files) < 12e6
