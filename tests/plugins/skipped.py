"""What was skipped, why, and the one command that brings it.

Each run of pytest says it at its end, and writes it into a folder with ``--skips FOLDER``; ``make
test``, which consists of several, sums it up by ``python tests/plugins/skipped.py FOLDER``. Where
the environment has ``CI=true``, only what cannot be had may be skipped; anything else fails the
run.
"""

from __future__ import annotations

import json
import os
import re
import sys
from collections.abc import Iterable, Mapping
from dataclasses import dataclass
from pathlib import Path

import pytest

_PIP = ".venv/bin/python -m pip install --constraint constraints.txt"


@dataclass(frozen=True)
class Lack:
    """What a computer lacks.

    Attributes:
        reason: regular expression, found in the reasons of tests that need it.
        name: what it is.
        brings: the one command that brings it, or why there is none.
        may_be: whether its tests may be skipped in CI.
    """

    reason: str
    name: str
    brings: str
    may_be: bool = False


LACKS = (
    Lack("no Node.js", "Node.js", "apt install nodejs"),
    Lack(
        "no Chromium",
        "Chromium",
        "apt install chromium (elsewhere: .venv/bin/playwright install chromium)",
    ),
    Lack("driver of Playwright", "a library of Playwright's driver", "apt install libatomic1"),
    Lack(
        "is not on this computer",
        "Firefox or WebKitGTK",
        "apt install firefox-esr webkit2gtk-driver xvfb",
    ),
    Lack("could not import 'legoeducation", "LEGO's package for its kits", f"{_PIP} legoeducation"),
    Lack("could not import 'stable_baselines3", "Stable-Baselines3", f"{_PIP} stable_baselines3"),
    Lack(
        "could not import 'lerobot",
        "LeRobot",
        "nothing: it wants an older torch than BricksRL",
        may_be=True,
    ),
    Lack("OpenGL|nothing can be drawn", "OpenGL", "apt install libegl1 libgl1-mesa-dri"),
    Lack(
        "could not import|is not installed",
        "a package of the extra 'dev'",
        f"{_PIP} --editable 'packages/bricksrl[dev]'",
    ),
    Lack("BRICKSRL_NETWORK", "the network", "set BRICKSRL_NETWORK=1", may_be=True),
    Lack("LEGO_EDUCATION", "LEGO's examples", "set LEGO_EDUCATION to a clone of them", may_be=True),
    Lack("LDraw library", "an LDraw library", "set LDRAWDIR to one (www.ldraw.org)", may_be=True),
    Lack("IPv6", "IPv6", "nothing: it is a thing of the network of this computer", may_be=True),
    Lack(
        "POSIX|numbers of Linux|Windows|pseudo-terminal|names are bytes|in /proc|file's size|"
        "SIGKILL|process groups|stand in for the firmware",
        "another operating system",
        "nothing: it is tested there",
        may_be=True,
    ),
)
_UNKNOWN = Lack(
    "", "something that nobody has listed", "add it to LACKS in tests/plugins/skipped.py"
)
_SHOWN = 3
"""Tests that are named of each kind."""

Skips = dict[str, str]
"""Reasons, by test."""


def lack_of(reason: str) -> Lack:
    """What a test lacked that was skipped for this reason."""
    return next((lack for lack in LACKS if re.search(lack.reason, reason)), _UNKNOWN)


def is_ci(environment: Mapping[str, str] = os.environ) -> bool:
    """Whether nothing may be skipped that can be had."""
    return environment.get("CI", "").lower() in ("1", "true")


def told(skips: Skips) -> list[str]:
    """Lines about what was skipped; none if nothing was."""
    tests: dict[Lack, list[str]] = {}
    for test, reason in sorted(skips.items()):
        tests.setdefault(lack_of(reason), []).append(test)
    lines = []
    for lack, names in sorted(tests.items(), key=lambda item: (item[0].may_be, -len(item[1]))):
        lines.append(f"{len(names)} skipped without {lack.name}; to have them: {lack.brings}")
        if lack is _UNKNOWN:
            lines += [f"    {name}: {skips[name]}" for name in names]
        else:
            rest = f" and {len(names) - _SHOWN} more" if len(names) > _SHOWN else ""
            lines.append(
                f"    {', '.join(name.rpartition('/')[2] for name in names[:_SHOWN])}{rest}"
            )
    return lines


def forbidden(skips: Skips) -> Skips:
    """Those that must not be skipped in CI."""
    return {test: reason for test, reason in skips.items() if not lack_of(reason).may_be}


class Collected:
    """Plugin of pytest that collects what is skipped, also of xdist's workers, whose reports come
    to the controller."""

    def __init__(self, config: pytest.Config) -> None:
        self._folder: Path | None = config.getoption("skips")
        self._is_worker = hasattr(config, "workerinput")
        self._skips: Skips = {}

    def _note(self, report: pytest.TestReport | pytest.CollectReport) -> None:
        # An expected failure has the outcome "skipped" too.
        if report.skipped and not hasattr(report, "wasxfail"):
            where = report.longrepr
            reason = where[2] if isinstance(where, tuple) else str(where)
            self._skips[report.nodeid] = reason.removeprefix("Skipped: ")

    def pytest_runtest_logreport(self, report: pytest.TestReport) -> None:
        """Note a test."""
        self._note(report)

    def pytest_collectreport(self, report: pytest.CollectReport) -> None:
        """Note a file of tests."""
        self._note(report)

    @pytest.hookimpl(trylast=True)
    def pytest_sessionfinish(self, session: pytest.Session) -> None:
        """Write the file, and fail what must not be."""
        if self._is_worker:
            return
        if self._folder is not None:
            self._folder.mkdir(parents=True, exist_ok=True)
            (self._folder / f"{os.getpid()}.json").write_text(
                json.dumps(self._skips, indent=2), encoding="utf-8"
            )
        if (
            is_ci()
            and forbidden(self._skips)
            and session.exitstatus in (pytest.ExitCode.OK, pytest.ExitCode.NO_TESTS_COLLECTED)
        ):
            session.exitstatus = pytest.ExitCode.TESTS_FAILED

    def pytest_terminal_summary(self, terminalreporter: pytest.TerminalReporter) -> None:
        """Say it."""
        for line in told(self._skips):
            terminalreporter.write_line(line)
        if is_ci() and forbidden(self._skips):
            terminalreporter.write_line(
                f"failed: with CI=true, {len(forbidden(self._skips))} of these must not be skipped",
                red=True,
            )


def pytest_addoption(parser: pytest.Parser) -> None:
    """Add the option."""
    group = parser.getgroup("bricks")
    group.addoption(
        "--skips",
        type=Path,
        metavar="FOLDER",
        help="write what was skipped into a file of this folder",
    )


def pytest_configure(config: pytest.Config) -> None:
    """Collect."""
    config.pluginmanager.register(Collected(config))


def main(arguments: Iterable[str]) -> int:
    """Say what all runs have skipped that wrote into a folder; the exit code says whether that may
    be."""
    skips: Skips = {}
    for folder in arguments:
        for path in sorted(Path(folder).glob("*.json")):
            skips |= json.loads(path.read_text(encoding="utf-8"))
    print("\n".join(told(skips) or ["Nothing was skipped."]))  # noqa: T201
    return 1 if is_ci() and forbidden(skips) else 0


if __name__ == "__main__":
    sys.exit(main(sys.argv[1:]))
