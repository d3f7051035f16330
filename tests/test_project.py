"""Project rules: versions, layers, README."""

from __future__ import annotations

import ast
import re
import shlex
import subprocess
import sys
import tomllib
from collections import Counter
from importlib import metadata
from pathlib import Path

import pytest

import bricksrl
from brickhub.cli.app import parse

ROOT = Path(__file__).parent.parent
README = (ROOT / "README.md").read_text(encoding="utf-8")
PROJECT = tomllib.loads((ROOT / "pyproject.toml").read_text(encoding="utf-8"))


def test_one_version_everywhere():
    newest = re.search(r"^## \[(\d+\.\d+\.\d+)\]", (ROOT / "CHANGELOG.md").read_text(encoding="utf-8"), re.MULTILINE)
    assert newest is not None
    assert bricksrl.__version__ == metadata.version("bricksrl") == newest[1]


def test_imports_go_one_way():
    command = Path(sys.executable).with_name("lint-imports")
    done = subprocess.run(
        [command, "--no-logo", "--no-cache"], cwd=ROOT, capture_output=True, text=True, timeout=120, check=False
    )
    assert done.returncode == 0, done.stdout


def test_files_are_short_and_found_by_their_name():
    package = ROOT / "src" / "bricksrl"
    modules = [path for path in package.rglob("*.py") if path.name != "__init__.py"]
    assert [path for path in modules if len(path.read_text(encoding="utf-8").splitlines()) > 400] == []
    folders = {path.parent for path in package.rglob("*") if "__pycache__" not in path.parts and path.is_file()}
    crowded = [folder.name for folder in folders if sum(path.is_file() for path in folder.iterdir()) > 20]
    assert sorted(crowded) == ["cli", "pybricks"]
    names = Counter((path.relative_to(package).parts[0], path.name) for path in modules)
    assert [name for name, count in names.items() if count > 1] == []


def test_published_tables_match_results():
    command = [sys.executable, "-m", "benchmarks", "tables", "--check"]
    done = subprocess.run(command, cwd=ROOT, capture_output=True, text=True, timeout=60, check=False)
    assert done.returncode == 0, done.stderr


def test_every_dependency_is_pinned():
    pinned = {line.split("==")[0].lower().replace("_", "-") for line in _constraints()}
    extras = PROJECT["project"]["optional-dependencies"]
    installed = {name: extras[name] for name in ("dev", "vision", "data", "tune", "docs", "benchmarks")}
    wanted = [*PROJECT["project"]["dependencies"], *(one for extra in installed.values() for one in extra)]
    names = {re.split(r"[<>=\[]", requirement)[0].lower().replace("_", "-") for requirement in wanted}
    assert names - {"bricksrl"} <= pinned


def test_constraints_are_exact_and_free_of_local_builds():
    assert all(re.fullmatch(r"[\w.-]+==[\w.]+", line) for line in _constraints())


def test_public_names_exist():
    for name in bricksrl.__all__:
        assert getattr(bricksrl, name) is not None


def test_unknown_attribute_raises():
    with pytest.raises(AttributeError, match="no attribute 'mkae'"):
        bricksrl.mkae  # noqa: B018


@pytest.mark.parametrize(
    "program",
    [
        "import bricksrl, gymnasium",
        "import gymnasium, bricksrl",
        "import bricksrl.envs, gymnasium",
        "from bricksrl import make; import gymnasium",
        "import bricksrl; bricksrl.list_envs(); import gymnasium",
        "import bricksrl, importlib.util; importlib.util.find_spec('gymnasium'); import gymnasium",
    ],
)
def test_gymnasium_registration_is_order_free(program):
    program += "; print(gymnasium.spec('bricksrl/RunAway-v0').max_episode_steps)"
    command = [sys.executable, "-W", "error", "-c", program]
    done = subprocess.run(command, capture_output=True, text=True, timeout=60, check=False)
    assert (done.stdout, done.stderr) == ("20\n", "")


def test_package_import_loads_no_torch():
    program = "import bricksrl, sys; print(sorted({'gymnasium', 'numpy', 'torch', 'mujoco'} & set(sys.modules)))"
    done = subprocess.run([sys.executable, "-c", program], capture_output=True, text=True, timeout=60, check=True)
    assert done.stdout == "[]\n"


def _constraints() -> list[str]:
    lines = (ROOT / "constraints.txt").read_text(encoding="utf-8").splitlines()
    return [line for line in lines if line and not line.startswith("#")]


def _commands(tool: str) -> list[str]:
    return re.findall(rf"^ *({tool} [^#\n]*?) *(?:#.*)?$", README, re.MULTILINE)


@pytest.mark.parametrize("command", _commands("bricksrl"))
def test_readme_commands_exist(command):
    assert callable(parse(shlex.split(command)[1:]).execute)


def test_readme_has_commands():
    assert len(_commands("bricksrl")) >= 5
    assert len(_commands("make")) >= 2


@pytest.mark.parametrize("command", _commands("make"))
def test_readme_make_targets_exist(command):
    done = subprocess.run(["make", "--dry-run", *shlex.split(command)[1:]], cwd=ROOT, capture_output=True, text=True, check=False)
    assert done.returncode == 0, done.stderr


def test_readme_links_exist():
    for target in re.findall(r"\]\((?!https?:)([^)]+)\)", README):
        assert (ROOT / target).exists(), target


GENERATED = ("reference/cli.md", "reference/environments.md")
"""Pages that `make docs` writes."""


@pytest.mark.parametrize("page", [ROOT / "CONTRIBUTING.md", *sorted((ROOT / "docs").glob("*.md"))], ids=lambda page: page.stem)
def test_docs_refer_to_existing_files(page):
    text = page.read_text(encoding="utf-8")
    for target in re.findall(r"\]\((?!https?:)([^)#]+)[^)]*\)", text):
        assert (page.parent / target).exists() or target in GENERATED, target
    folders = "|".join(path.name for path in (ROOT / "src/bricksrl").iterdir() if path.is_dir())
    for named in re.findall(rf"`((?:benchmarks|examples|tests|docs|{folders})/[\w/]*(?:\.\w+)?)`", text):
        assert (ROOT / named).exists() or (ROOT / "src/bricksrl" / named).exists(), named


def test_docstrings_of_modules_begin_with_their_subject():
    for path in sorted((ROOT / "src").rglob("*.py")):
        begins = (ast.get_docstring(ast.parse(path.read_text(encoding="utf-8"))) or "Nothing").split()[0]
        assert begins not in {"How", "What", "When", "Where", "Whether", "Which", "Who", "Why"}, path
