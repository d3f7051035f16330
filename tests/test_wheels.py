"""Wheels of the three distributions, collected and installed as docs/start.md says, into empty
environments."""

from __future__ import annotations

import os
import shlex
import shutil
import subprocess
import sys
import sysconfig
import venv
import zipfile
from pathlib import Path

import pytest

ROOT = Path(__file__).parents[1]
HOUSES = ("brickhub", "bricktwin", "bricksrl")
pytestmark = [pytest.mark.slow, pytest.mark.timeout(1800)]

IMPORT_ALL = """
import importlib, pkgutil, sys
package = importlib.import_module(sys.argv[1])
names = [name for _, name, _ in pkgutil.walk_packages(package.__path__, f"{package.__name__}.")]
HUBS_OWN = "onboard", "frozen"  # MicroPython, which only a hub runs
NEEDS_MORE = "__main__", "pytest_plugin", "lego_transport"  # a command, and what needs an extra
for name in names:
    if not any(part in name for part in HUBS_OWN) and not name.endswith(NEEDS_MORE):
        importlib.import_module(name)
absent = [name for name in sys.argv[2:] if name in sys.modules]
print(len(names), *absent)
"""
PROGRAM = """
from pybricks.parameters import Port
from pybricks.pupdevices import Motor
for port in (Port.A, Port.B, Port.C, Port.D):
    Motor(port).run_time(300, 1000, wait=port == Port.D)
print("done")
"""


class Environment:
    """An empty environment, and what is installed into it."""

    def __init__(self, folder: Path, wheels: Path) -> None:
        self._folder, self._wheels = folder, wheels
        venv.create(folder, with_pip=True)
        self._bin = folder / ("Scripts" if os.name == "nt" else "bin")

    def install(self, *arguments: str) -> None:
        """Install with pip; wheels of ours come from the local folder."""
        constraints = (
            "--constraint",
            str(ROOT / "constraints.txt"),
            "--find-links",
            str(self._wheels),
        )
        self.run(
            "python",
            "-m",
            "pip",
            "install",
            "--quiet",
            "--disable-pip-version-check",
            *constraints,
            *arguments,
        )

    def run(
        self, program: str, *arguments: str, folder: Path = ROOT.parent, **variables: str
    ) -> str:
        """Output of a program of the environment, which must end well."""
        environment = {
            name: value for name, value in os.environ.items() if name != "PYTHONPATH"
        } | variables
        done = subprocess.run(
            [str(self._bin / program), *arguments],
            cwd=folder,
            env=environment,
            capture_output=True,
            text=True,
            check=False,
        )
        assert done.returncode == 0, (arguments, done.stdout[-2000:], done.stderr[-2000:])
        return done.stdout

    def size_mb(self) -> float:
        """Size of all packages with byte code, without pip."""
        site = Path(
            self.run(
                "python", "-c", "import sysconfig; print(sysconfig.get_path('purelib'))"
            ).strip()
        )
        self.run("python", "-m", "compileall", "-q", str(site))
        files = (
            path
            for path in site.rglob("*")
            if path.is_file()
            and not path.relative_to(site).parts[0].startswith(("pip", "setuptools"))
        )
        return sum(path.stat().st_size for path in files) / 1e6


def documented(command: str) -> list[str]:
    """Arguments of the command of docs/start.md for a class without internet that begins so;
    packages of others are left out."""
    lines = (ROOT / "docs" / "start.md").read_text(encoding="utf-8").splitlines()
    return [
        *shlex.split(next(line for line in lines if line.startswith(command)))[1:],
        "--no-deps",
        "--quiet",
    ]


@pytest.fixture(scope="module")
def wheels(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """The folder `bundle` in a copy of the repository, so that no build is left in the tree."""
    clone = tmp_path_factory.mktemp("clone")
    ignored = shutil.ignore_patterns("build", "*.egg-info", "__pycache__")
    for house in HOUSES:
        shutil.copytree(ROOT / "packages" / house, clone / "packages" / house, ignore=ignored)
    shutil.copy(ROOT / "constraints.txt", clone)
    subprocess.run([sys.executable, *documented("python -m pip wheel")], cwd=clone, check=True)
    folder = clone / "bundle"
    assert sorted(path.name.partition("-")[0] for path in folder.glob("*.whl")) == sorted(HOUSES)
    return folder


def test_a_class_installs_without_a_network(wheels: Path, tmp_path: Path) -> None:
    environment = Environment(tmp_path / "env", wheels)
    environment.run(
        "python",
        *documented("python -m pip install --no-index"),
        "brickhub",
        "bricktwin",
        folder=wheels.parent,
    )
    told = environment.run("bricksrl", "--version", PYTHONPATH=sysconfig.get_path("purelib"))
    assert told.startswith("bricksrl")


def test_wheels_hold_their_files(wheels: Path) -> None:
    for house in HOUSES:
        names = zipfile.ZipFile(next(wheels.glob(f"{house}-*.whl"))).namelist()
        source = ROOT / "packages" / house / "src"
        wanted = [
            path
            for path in (source / house).rglob("*")
            if path.is_file() and "__pycache__" not in path.parts
        ]
        assert {path.relative_to(source).as_posix() for path in wanted} <= set(names)


def test_brickhub_alone(wheels: Path, tmp_path: Path) -> None:
    """Small, without NumPy, MuJoCo and torch; all its modules and its whole suite."""
    environment = Environment(tmp_path / "env", wheels)
    environment.install("brickhub")
    assert environment.size_mb() <= 30.0
    count, *loaded = environment.run(
        "python", "-c", IMPORT_ALL, "brickhub", "numpy", "mujoco", "torch"
    ).split()
    assert int(count) > 90 and loaded == []
    (tmp_path / "main.py").write_text(PROGRAM)
    assert environment.run("brickhub", "run", "main.py", folder=tmp_path) == "done\n"
    environment.install("brickhub[test]")
    pytest_arguments = (
        "-m",
        "pytest",
        "-q",
        "--numprocesses",
        "2",
        "-p",
        "no:cacheprovider",
        "packages/brickhub/tests",
    )
    told = environment.run(
        "python", *pytest_arguments, "-m", "not slow and not realtime", folder=ROOT
    )
    assert "failed" not in told and int(told.split(" passed")[0].split()[-1]) > 1800
    environment.run(
        "python",
        "-c",
        "import importlib.util as u; assert not any(map(u.find_spec, ('numpy', 'mujoco', "
        "'torch', 'bricktwin')))",
    )


def test_bricktwin_without_torch(wheels: Path, tmp_path: Path) -> None:
    """A stranger's program drives the Walker and a robot from a plan, and is filmed."""
    environment = Environment(tmp_path / "env", wheels)
    environment.install("bricktwin")
    assert environment.size_mb() <= 700.0
    count, *loaded = environment.run("python", "-c", IMPORT_ALL, "bricktwin", "torch").split()
    assert int(count) > 50 and loaded == []
    (tmp_path / "main.py").write_text(PROGRAM)
    (tmp_path / "drive.py").write_text(
        "from pybricks.parameters import Port\nfrom pybricks.pupdevices import Motor\n"
        "Motor(Port.A).run_time(300, 1000)\nprint('done')\n"
    )
    plan = str(ROOT / "examples" / "13_front_steered.ldr")
    assert (
        environment.run(
            "bricktwin",
            "run",
            "main.py",
            "--robot",
            "walker",
            "--video",
            "walk.mp4",
            folder=tmp_path,
        )
        == "done\n"
    )
    assert (
        environment.run(
            "bricktwin", "run", "drive.py", "--robot", plan, "--video", "drive.mp4", folder=tmp_path
        )
        == "done\n"
    )
    assert all((tmp_path / name).stat().st_size > 10_000 for name in ("walk.mp4", "drive.mp4"))


def test_bricksrl_learns_from_its_wheel(wheels: Path, tmp_path: Path) -> None:
    """The packages that it needs are those of this environment, as they take gigabytes."""
    environment = Environment(tmp_path / "env", wheels)
    environment.install("--no-deps", *HOUSES)
    others = sysconfig.get_path("purelib")
    told = environment.run(
        "bricksrl",
        "train",
        "WalkerSim-v0",
        "--episodes",
        "2",
        "--run",
        "run",
        folder=tmp_path,
        PYTHONPATH=others,
    )
    assert "episode" in told and (tmp_path / "run" / "config.json").exists()
    program = (
        "import brickhub, bricktwin, bricksrl; print(*(module.__file__ for module in "
        "(brickhub, bricktwin, bricksrl)))"
    )
    files = environment.run("python", "-c", program, PYTHONPATH=others).split()
    assert all(str(tmp_path) in file for file in files)
