"""Documentation: commands, snippets and notebooks run; the site builds without warnings."""

from __future__ import annotations

import json
import re
import shlex
import shutil
import subprocess
import sys
from collections.abc import Iterator
from pathlib import Path

import nbclient
import nbformat
import pytest

import brickhub.cli.command_table
import bricksrl.cli.app
import bricktwin.cli.command_table
from benchmarks.notebooks import digest
from brickhub.cli.app import parse
from brickhub.robot import Robot
from bricksrl.cli import main
from bricksrl.envs.registry import _BUILT_IN
from bricktwin.robots import EV3_DRIVER
from bricktwin.site.build import programs

ROOT = Path(__file__).parents[2]
DOCS = ROOT / "docs"
FOLLOWED = [
    ROOT / "README.md",
    *(DOCS / f"{name}.md" for name in ("start", "watch", "lesson", "own", "policies")),
]
"""Pages with executed commands."""
READ = [path for path in sorted(DOCS.glob("*.md")) if path not in FOLLOWED]
"""Pages with commands for the reader's robots and files, which are only parsed."""
READMES = sorted((ROOT / "packages").glob("*/README.md"))
LINES = {
    line.prog: line
    for line in (
        brickhub.cli.command_table.LINE,
        bricktwin.cli.command_table.LINE,
        bricksrl.cli.app.LINE,
    )
}
NOTEBOOKS = sorted((DOCS / "tutorials").glob("*.ipynb"))


def blocks(page: Path, language: str) -> list[str]:
    """Code blocks of a page."""
    text = page.read_text(encoding="utf-8")
    found = re.findall(rf"^ *```{language}\n(.*?)^ *```", text, re.MULTILINE | re.DOTALL)
    return [re.sub(r"^ {3}", "", block, flags=re.MULTILINE) for block in found]


def commands(page: Path, house: str = "bricksrl") -> list[list[str]]:
    """Arguments of all commands of a house on a page."""
    lines = [line for block in blocks(page, "bash") for line in block.splitlines()]
    lines += re.findall(rf"^ {{4}}({house} .*)$", page.read_text(encoding="utf-8"), re.MULTILINE)
    return [
        shlex.split(line.partition(" > ")[0], comments=True)[1:]
        for line in lines
        if line.startswith(f"{house} ")
    ]


def cheap(words: list[str]) -> list[str]:
    """The command with fewer episodes, updates and copies, and no video."""
    found = list(words)
    for flag, most in (("--episodes", None), ("--updates", 20), ("--num-envs", 4)):
        if flag in found:
            at = found.index(flag) + 1
            found[at] = str(min(int(found[at]), most) if most else 1 if int(found[at]) <= 20 else 2)
    if "--video" in found:
        del found[found.index("--video") : found.index("--video") + 2]
    if "--episodes" not in found and found[0] == "train":
        found += ["--episodes", "1"]
    if found[:1] == ["train-offline"]:
        found += ["--episodes", "2"]
    return found


def needs_a_robot(words: list[str]) -> bool:
    return any(word.startswith(("ble", "usb")) for word in words)


def needs_a_browser(words: list[str]) -> bool:
    return words[0] in ("page", "drive", "demo") or "--page" in words


@pytest.fixture
def clone(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Iterator[Path]:
    """A folder like a fresh clone."""
    shutil.copytree(
        ROOT / "examples", tmp_path / "examples", ignore=shutil.ignore_patterns("__pycache__")
    )
    monkeypatch.chdir(tmp_path)
    monkeypatch.setenv("MUJOCO_GL", "disable")
    monkeypatch.setattr("bricksrl.cli.train._EVALUATED_EPISODES", 1)
    monkeypatch.setattr("bricksrl.envs.registry._specs", dict(_BUILT_IN))
    return tmp_path


@pytest.mark.slow
@pytest.mark.timeout(1200)  # of a whole page, on a computer that does other things too
@pytest.mark.parametrize("page", FOLLOWED, ids=lambda page: page.stem)
def test_docs_pages_can_be_executed(
    page: Path, clone: Path, capfd: pytest.CaptureFixture[str]
) -> None:
    done = [
        words
        for words in commands(page)
        if not (needs_a_robot(words) or needs_a_browser(words) or words[0] == "doctor")
    ]
    for words in done:
        code = main(cheap(words))
        told = capfd.readouterr()
        assert code == 0 or (code == 124 and "--time-limit-s" in words), (words, told.err)
    for house, run in (("brickhub", brickhub.cli.main), ("bricktwin", bricktwin.cli.main)):
        for words in commands(page, house):
            assert run(cheap(words)) == 0, (words, capfd.readouterr().err)
    names: dict[str, object] = {}  # a block goes on where the one above it ended
    for block in blocks(page, "python"):
        exec(block.replace("episodes=15", "episodes=1"), names)  # noqa: S102
    assert done


@pytest.mark.parametrize(
    "page", [*FOLLOWED, *READ, *READMES], ids=lambda page: f"{page.parent.name}-{page.stem}"
)
def test_commands_exist(page: Path) -> None:
    for house, line in LINES.items():
        for words in commands(page, house):
            assert callable(parse(line, words).execute), words


@pytest.mark.parametrize("page", READ, ids=lambda page: page.stem)
def test_snippets_of_other_pages_are_python(page: Path) -> None:
    for block in blocks(page, "python"):
        compile(block, str(page), "exec")


@pytest.mark.parametrize("name", ["own_robot", "plans", "virtual_hub"])
def test_snippets_about_robots_run(name: str, clone: Path) -> None:
    (clone / "main.py").write_text("print('hello')\n", encoding="utf-8")
    names: dict[str, object] = {}
    for block in blocks(DOCS / f"{name}.md", "python"):
        exec(block, names)  # noqa: S102


def test_robots_of_the_page_on_ev3_are_mounted_as_ours() -> None:
    """A program of the page drives our robot ahead, and does not turn it on the spot."""
    program, description, *_ = blocks(DOCS / "ev3.md", "python")
    described: dict[str, Robot] = {}
    exec(description, described)  # noqa: S102  it is ours
    assert described["ROBOT"].motors == EV3_DRIVER.motors
    for motor in EV3_DRIVER.motors:
        assert f"{motor.name} = Motor(Port.{motor.port})\n" in program


def shortened(source: str) -> str:
    """The code of a cell with fewer episodes and updates."""
    return re.sub(r"\bupdates=\d+", "updates=20", re.sub(r"\bepisodes=\d+", "episodes=2", source))


@pytest.mark.slow
@pytest.mark.parametrize("path", NOTEBOOKS[1:], ids=lambda path: path.stem)
def test_notebooks_run(path: Path, tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.chdir(tmp_path)
    monkeypatch.setattr("bricksrl.envs.registry._specs", dict(_BUILT_IN))
    names: dict[str, object] = {"__name__": "notebook"}
    exec("import bricksrl", names)  # noqa: S102
    for cell in nbformat.read(path, 4).cells:
        if cell.cell_type == "code" and "install" not in cell.metadata.get("tags", []):
            exec(compile(shortened(cell.source), f"{path.name}:{cell.id}", "exec"), names)  # noqa: S102


@pytest.mark.slow
def test_first_notebook_runs_in_kernel(tmp_path: Path) -> None:
    notebook = nbformat.read(NOTEBOOKS[0], 4)
    for cell in notebook.cells:
        cell.source = shortened(cell.source)
        cell.pop("outputs", None)
    nbclient.NotebookClient(
        notebook,
        timeout=300,
        kernel_name="python3",
        resources={"metadata": {"path": str(tmp_path)}},
    ).execute()
    assert any(
        "image/png" in out.get("data", {})
        for cell in notebook.cells
        for out in cell.get("outputs", [])
    )


@pytest.mark.parametrize("path", NOTEBOOKS, ids=lambda path: path.stem)
def test_notebooks_hold_the_outputs_of_their_cells(path: Path) -> None:
    """As `python -m benchmarks notebooks` stores them."""
    notebook = nbformat.read(path, 4)
    assert notebook.metadata["executed"] == digest(notebook), (
        "execute it again: python -m benchmarks notebooks"
    )
    outputs = [out for cell in notebook.cells if cell.cell_type == "code" for out in cell.outputs]
    text = json.dumps(outputs)
    assert not any(out.output_type == "error" or out.get("name") == "stderr" for out in outputs)
    assert not re.search(r"/(home|root|tmp|work|Users)/", text), "a path of the machine"
    assert "video/mp4;base64" in text or path.name[0] == "6", (
        "the robot is seen; that of tutorial 6 lies on a bench"
    )
    assert path.stat().st_size < 400_000


def test_notebooks_are_for_pupils() -> None:
    assert [path.name[0] for path in NOTEBOOKS] == list("1234567")
    for path in NOTEBOOKS:
        cells = nbformat.read(path, 4).cells
        for source in (cell.source for cell in cells if cell.cell_type == "code"):
            assert "environ" not in source and "test" not in source, "nothing of the tests"
            told = re.match(
                r"# This takes about [\d.]+ (seconds|minutes) on one laptop core\.\n", source
            )
            assert bool(told) == bool(re.search(r"\b(train|learn)\(", source)), (
                "a cell that trains says how long"
            )


def test_environments_with_a_robot_have_a_picture() -> None:
    names = {env_id.lower().replace("-", "_") for env_id in _BUILT_IN if "Sim" not in env_id}
    assert names <= {path.stem for path in (DOCS / "images").glob("*.gif")}


def test_examples_that_pages_open_are_in_the_tab() -> None:
    names = {program["name"] for program in programs(DOCS / "hub_programs")}
    opened = []
    for page in DOCS.glob("*.md"):
        opened += re.findall(r"#example=([\w.]+)", page.read_text(encoding="utf-8"))
    assert opened
    assert set(opened) <= names


@pytest.mark.slow
def test_site_builds_without_warnings_or_broken_links(tmp_path: Path) -> None:
    copy = tmp_path / "docs"
    shutil.copytree(DOCS, copy, ignore=shutil.ignore_patterns("_build"))
    # which has the address of publication
    shutil.copy(DOCS.parent / "pyproject.toml", tmp_path)
    command = [
        sys.executable,
        "-m",
        "sphinx",
        "--fail-on-warning",
        "--keep-going",
        "-q",
        "-b",
        "html",
        str(copy),
        str(tmp_path / "site"),
    ]
    done = subprocess.run(command, capture_output=True, text=True, timeout=600, check=False)
    assert done.returncode == 0, done.stderr
    site = tmp_path / "site"
    pages = {
        page.relative_to(site).as_posix(): page.read_text(encoding="utf-8")
        for page in site.rglob("*.html")
    }
    assert {
        "index.html",
        "start.html",
        "teaching.html",
        "reference/cli.html",
        "reference/environments.html",
    } <= pages.keys()
    assert (
        "bricksrl compare" in pages["reference/cli.html"]
        and "RoboArmSim-v0" in pages["reference/environments.html"]
    )
    for name, text in pages.items():
        for target in re.findall(r'href="([^"#:?]+)[^":]*"', text):
            # What `make docs` puts beside it.
            if target.removeprefix("../") == "tab/index.html":
                continue
            assert (site / name).parent.joinpath(target).exists(), (name, target)
