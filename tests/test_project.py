"""Project rules: versions, layers, README."""

from __future__ import annotations

import ast
import importlib
import pkgutil
import re
import shlex
import subprocess
import sys
import tomllib
from collections import Counter
from importlib import metadata
from pathlib import Path

import pytest
from packaging.specifiers import SpecifierSet

import bricksrl
from brickhub import HOUSES
from brickhub.cli import app

ROOT = Path(__file__).parent.parent
README = (ROOT / "README.md").read_text(encoding="utf-8")
CONTRIBUTING = (ROOT / "CONTRIBUTING.md").read_text(encoding="utf-8")
PROJECTS = {
    house: tomllib.loads(
        (ROOT / "packages" / house / "pyproject.toml").read_text(encoding="utf-8")
    )["project"]
    for house in HOUSES
}
SOURCES = {house: ROOT / "packages" / house / "src" / house for house in HOUSES}
LINES = {
    house: importlib.import_module(
        f"{house}.cli.{'app' if house == 'bricksrl' else 'command_table'}"
    ).LINE
    for house in HOUSES
}
"""The command of each house."""
PAGES = [
    *(ROOT / name for name in ("README.md", "CONTRIBUTING.md")),
    *sorted((ROOT / "docs").glob("*.md")),
    *(ROOT / "packages" / house / "README.md" for house in HOUSES),
]


def test_one_version_everywhere():
    newest = re.search(
        r"^## \[(\d+\.\d+\.\d+)\]",
        (ROOT / "CHANGELOG.md").read_text(encoding="utf-8"),
        re.MULTILINE,
    )
    assert newest is not None
    for place, house in enumerate(HOUSES):
        assert importlib.import_module(house).__version__ == metadata.version(house) == newest[1]
        required = [name for name in PROJECTS[house]["dependencies"] if name.startswith(HOUSES)]
        assert required == [f"{before}=={newest[1]}" for before in HOUSES[:place]]
    assert f"\nversion: {newest[1]}\n" in (ROOT / "CITATION.cff").read_text(encoding="utf-8")


def test_imports_go_one_way():
    command = Path(sys.executable).with_name("lint-imports")
    done = subprocess.run(
        [command, "--no-logo", "--no-cache"],
        cwd=ROOT,
        capture_output=True,
        text=True,
        timeout=120,
        check=False,
    )
    assert done.returncode == 0, done.stdout


def test_files_are_found_by_their_name():
    crowded = []
    for package in SOURCES.values():
        folders = {
            path.parent
            for path in package.rglob("*")
            if "__pycache__" not in path.parts and path.is_file()
        }
        crowded += [
            folder.name
            for folder in folders
            if sum(path.is_file() for path in folder.iterdir()) > 20
        ]
        modules = [
            path.relative_to(package)
            for path in package.rglob("*.py")
            if path.name != "__init__.py"
        ]
        # names of the other houses
        others = {"hub", "plans", "templates", "twin"} if package.name == "bricksrl" else set()
        names = Counter(path.name for path in modules if not others & {*path.parts})
        assert [name for name, count in names.items() if count > 1] == []
    assert sorted(crowded) == []


def test_published_tables_match_results():
    command = [sys.executable, "-m", "benchmarks", "tables", "--check"]
    done = subprocess.run(
        command, cwd=ROOT, capture_output=True, text=True, timeout=60, check=False
    )
    assert done.returncode == 0, done.stderr


def test_every_dependency_is_pinned():
    pinned = {_name(line) for line in _constraints()}
    for project in PROJECTS.values():
        extras = project["optional-dependencies"]
        # no test installs the others
        optional = [
            names
            for extra, names in extras.items()
            if extra not in {"encoders", "loggers", "notebook"}
        ]
        wanted = {
            _name(requirement)
            for names in (project["dependencies"], *optional)
            for requirement in names
        }
        assert wanted - set(HOUSES) <= pinned, project["name"]


def _name(requirement: str) -> str:
    return re.split(r"[<>=\[]", requirement)[0].lower().replace("_", "-")


def test_constraints_are_exact_and_free_of_local_builds():
    assert all(re.fullmatch(r"[\w.-]+==[\w.]+", line) for line in _constraints())


def test_public_names_exist():
    for name in bricksrl.__all__:
        assert getattr(bricksrl, name) is not None


def test_unknown_attribute_raises():
    with pytest.raises(AttributeError, match="no attribute 'mkae'"):
        bricksrl.mkae  # noqa: B018


IMPORT_ORDERS = (
    "import bricksrl, gymnasium",
    "import gymnasium, bricksrl",
    "import bricksrl.envs, gymnasium",
    "from bricksrl import make; import gymnasium",
    "import bricksrl; bricksrl.list_envs(); import gymnasium",
    "import bricksrl, importlib.util; importlib.util.find_spec('gymnasium'); import gymnasium",
)


def test_gymnasium_registration_is_order_free():
    """One process for all, each with new modules of ours and of Gymnasium: what these import costs
    most."""
    program = f"""
import sys
finders = sys.meta_path[:]
for order in {IMPORT_ORDERS!r}:
    sys.meta_path[:] = finders
    for name in [*sys.modules]:
        if name.partition(".")[0] in {(*HOUSES, "gymnasium")!r}:
            del sys.modules[name]
    named = {{}}
    exec(order, named)
    print(named["gymnasium"].spec("bricksrl/RunAway-v0").max_episode_steps)
"""
    command = [sys.executable, "-W", "error", "-c", program]
    done = subprocess.run(command, capture_output=True, text=True, timeout=60, check=False)
    assert (done.stdout, done.stderr) == ("20\n" * len(IMPORT_ORDERS), "")


def test_package_import_loads_no_torch():
    program = (
        "import bricksrl, sys; print(sorted({'gymnasium', 'numpy', 'torch', 'mujoco'} & "
        "set(sys.modules)))"
    )
    done = subprocess.run(
        [sys.executable, "-c", program], capture_output=True, text=True, timeout=60, check=True
    )
    assert done.stdout == "[]\n"


def test_pinned_versions_accept_the_oldest_python() -> None:
    # Debian 12 has Python 3.11.2; pip said of a version for 3.11.5 and later only that there is a
    # conflict.
    pinned = {_name(line) for line in _constraints()}
    younger = [
        found.name
        for found in metadata.distributions()
        if _name(found.name) in pinned and not _accepts(found, "3.11.0")
    ]
    assert younger == []


def _accepts(distribution: metadata.Distribution, python: str) -> bool:
    return SpecifierSet(distribution.metadata["Requires-Python"] or "").contains(python)


def _constraints() -> list[str]:
    lines = (ROOT / "constraints.txt").read_text(encoding="utf-8").splitlines()
    return [line for line in lines if line and not line.startswith("#")]


def _commands(tool: str, text: str = README) -> list[str]:
    return re.findall(rf"^ *({tool} [^#\n]*?) *(?:#.*)?$", text, re.MULTILINE)


@pytest.mark.parametrize("command", [command for house in HOUSES for command in _commands(house)])
def test_readme_commands_exist(command):
    house, *words = shlex.split(command)
    assert callable(app.parse(LINES[house], words).execute)


def test_readme_has_commands():
    assert len(_commands("bricksrl")) >= 5
    assert len(_commands("make")) >= 2
    assert all(_commands(house) for house in HOUSES)


@pytest.mark.parametrize("command", _commands("make") + _commands("make", CONTRIBUTING))
def test_make_targets_exist(command):
    done = subprocess.run(
        ["make", "--dry-run", *shlex.split(command)[1:]],
        cwd=ROOT,
        capture_output=True,
        text=True,
        check=False,
    )
    assert done.returncode == 0, done.stderr


def test_houses_are_installed_with_those_they_need():
    installs = [
        re.findall(r"--editable packages/(\w+)", line)
        for page in PAGES
        for line in page.read_text("utf-8").splitlines()
    ]
    assert list(HOUSES) in installs
    assert all(tuple(houses) == HOUSES[: len(houses)] for houses in installs)


def test_readme_links_exist():
    for target in re.findall(r"\]\((?!https?:)([^)]+)\)", README):
        assert (ROOT / target).exists(), target


GENERATED = ("reference/cli.md", "reference/environments.md")
"""Pages that `make docs` writes."""


@pytest.mark.parametrize("page", PAGES, ids=lambda page: f"{page.parent.name}-{page.stem}")
def test_docs_refer_to_existing_files(page):
    text = page.read_text(encoding="utf-8")
    for target in re.findall(r"\]\((?!https?:)([^)#]+)[^)]*\)", text):
        assert (page.parent / target).exists() or target in GENERATED, target
    rooms = {path.name for source in SOURCES.values() for path in source.iterdir() if path.is_dir()}
    folders = "|".join([*rooms, *HOUSES, "benchmarks", "examples", "tests", "docs", "packages"])
    places = (ROOT, *SOURCES.values(), *(source.parent for source in SOURCES.values()))
    for named in re.findall(rf"`((?:{folders})/[\w/]*(?:\.\w+)?)`", text):
        assert any((place / named).exists() for place in places), named
    for named in re.findall(rf"`((?:{'|'.join(HOUSES)})(?:\.\w+)+)`", text):
        assert pkgutil.resolve_name(named) is not None


def test_docstrings_of_modules_begin_with_their_subject():
    paths = sorted(path for source in SOURCES.values() for path in source.rglob("*.py"))
    assert len(paths) > 250
    for path in paths:
        begins = (
            ast.get_docstring(ast.parse(path.read_text(encoding="utf-8"))) or "Nothing"
        ).split()[0]
        assert begins not in {"How", "What", "When", "Where", "Whether", "Which", "Who", "Why"}, (
            path
        )


def test_index_lists_each_example() -> None:
    index = (ROOT / "docs" / "index.md").read_text(encoding="utf-8")
    examples = {path.name for path in (ROOT / "examples").glob("[0-9]*.py")}
    assert examples == set(re.findall(r"\(\.\./examples/([^)]*\.py)\)", index))
