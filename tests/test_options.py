"""Options of the tests themselves: what is skipped, starts that are off, CPU times."""

from __future__ import annotations

import ast
import json
import os
import subprocess
import sys
from pathlib import Path
from types import ModuleType

import cpu_times
import numpy as np
import pytest
import shaking
import skipped
import torch

from bricktwin.robots import TWO_WHEELER
from bricktwin.twin.mujoco_body import MujocoBody
from bricktwin.twin.physics import Physics
from bricktwin.twin.scene import OPEN_FLOOR
from bricktwin.twin.settling import settle

ROOT = Path(__file__).parent.parent


def reasons(source: str) -> list[str]:
    """Reasons for which a file skips tests, as far as they are written there."""
    found = []
    for node in ast.walk(ast.parse(source)):
        name = ast.unparse(node.func).rpartition(".")[2] if isinstance(node, ast.Call) else ""
        if name not in ("skip", "skipif", "importorskip"):
            continue
        words = {keyword.arg: keyword.value for keyword in node.keywords}
        if name == "importorskip":
            found.append(
                ast.unparse(words["reason"])
                if "reason" in words
                else f"could not import {ast.unparse(node.args[0])}"
            )
        elif isinstance(said := words.get("reason", node.args[0]), ast.Constant | ast.JoinedStr):
            found.append(ast.unparse(said))
    return found


def test_every_reason_is_listed_with_what_brings_it():
    files = [
        path
        for folder in ("packages", "tests", "plugins")
        for path in (ROOT / folder).rglob("tests/**/*.py")
    ]
    texts = [text for path in files if "skip" in (text := path.read_text(encoding="utf-8"))]
    said = [reason for text in texts for reason in reasons(text)]
    assert len(said) > 30
    assert [reason for reason in said if skipped.lack_of(reason) is skipped._UNKNOWN] == []


def test_what_is_skipped_is_told_with_the_command_that_brings_it():
    tests = {
        f"packages/a/tests/test_page.py::test_{n}": "no Chromium is on this computer"
        for n in range(5)
    }
    lines = skipped.told(
        {**tests, "test_plugin.py": "could not import 'lerobot': No module", "a::b": "it rains"}
    )
    assert lines == [
        (
            "5 skipped without Chromium; to have them: apt install chromium (elsewhere: "
            ".venv/bin/playwright install chromium)"
        ),
        "    test_page.py::test_0, test_page.py::test_1, test_page.py::test_2 and 2 more",
        (
            "1 skipped without something that nobody has listed; to have them: add it to LACKS in "
            "tests/plugins/skipped.py"
        ),
        "    a::b: it rains",
        "1 skipped without LeRobot; to have them: nothing: it wants an older torch than BricksRL",
        "    test_plugin.py",
    ]


@pytest.mark.parametrize(("ci", "code"), [("true", 1), ("", 0)])
def test_in_ci_only_what_cannot_be_had_is_skipped(ci, code, tmp_path, monkeypatch, capsys):
    """Of two processes of tests; one skips a test, one a file."""
    (tmp_path / "test_one.py").write_text(
        "import pytest\ndef test_it(): pytest.skip('no Chromium is here')\ndef test_too(): pass\n"
    )
    (tmp_path / "test_two.py").write_text("import pytest\npytest.importorskip('lerobot')\n")
    monkeypatch.setenv("CI", ci)
    paths = os.pathsep.join(
        [str(ROOT / "tests" / "plugins"), *os.environ.get("PYTHONPATH", "").split(os.pathsep)]
    )
    command = [
        sys.executable,
        "-m",
        "pytest",
        "-q",
        "-p",
        "skipped",
        "-c",
        os.devnull,
        "--rootdir",
        ".",
        "--skips",
        "skips",
    ]
    more = [
        "-p",
        "no:cacheprovider",
        "-p",
        "no:hypothesispytest",
        *(["--numprocesses", "1"] if ci else []),
    ]
    environment = {**os.environ, "PYTHONPATH": paths}
    done = subprocess.run(
        [*command, *more, "."],
        cwd=tmp_path,
        env=environment,
        capture_output=True,
        text=True,
        timeout=120,
        check=False,
    )
    assert done.returncode == code, done.stdout + done.stderr
    assert (
        "1 skipped without Chromium" in done.stdout and "1 skipped without LeRobot" in done.stdout
    )
    assert ("must not be skipped" in done.stdout) == bool(ci)
    assert skipped.main([str(tmp_path / "skips")]) == code
    assert "1 skipped without Chromium" in capsys.readouterr().out
    (tmp_path / "skips" / "other.json").write_text(
        json.dumps({"test_page.py": "no Chromium is here"})
    )
    skipped.main([str(tmp_path / "skips")])
    assert "2 skipped without Chromium" in capsys.readouterr().out, "all runs are summed up"


def test_first_weights_are_a_little_off_and_nothing_else_is_drawn(monkeypatch):
    monkeypatch.setattr(shaking, "_SEED", 3)
    init = ModuleType("init")
    # these tests may be shaken themselves
    before = getattr(torch.nn.init.uniform_, "__wrapped__", torch.nn.init.uniform_)
    init.uniform_ = before
    shaking._shake_weights(init)
    weights, off = (torch.nn.Parameter(torch.empty(8, 8)) for _ in range(2))
    torch.manual_seed(0)
    before(weights)
    state = torch.get_rng_state()
    torch.manual_seed(0)
    init.uniform_(off)
    assert torch.get_rng_state().equal(state)
    assert 1e-8 < float((weights - off).detach().abs().max()) < 2e-7
    torch.manual_seed(0)
    assert init.uniform_(torch.empty(8, 8)).equal(weights), "only parameters"


def test_bodies_start_a_little_off(monkeypatch):
    monkeypatch.setattr(shaking, "_SEED", 3)
    body = MujocoBody(TWO_WHEELER, OPEN_FLOOR, Physics(), 0)
    module = ModuleType("bodies")
    module.settle = getattr(settle, "__wrapped__", settle)
    shaking._shake_bodies(module)
    before = body.data.qpos.copy()
    module.settle(body.engine, [body])
    first = body.data.qpos - before
    assert 0 < np.abs(first[:2]).max() < 1.1e-9


def test_cpu_time_of_a_process_and_what_it_started():
    spin = "import time\nwhile time.process_time() < 0.3: pass\nprint('spun', flush=True)\n"
    before_s = cpu_times.children_s(os.getpid())
    with subprocess.Popen(
        [sys.executable, "-c", f"{spin}input()"],
        stdin=subprocess.PIPE,
        stdout=subprocess.PIPE,
        text=True,
    ) as child:
        assert child.stdout.readline() == "spun\n"
        living_s = cpu_times.children_s(os.getpid()) - before_s
        child.communicate("\n")
    ended_s = cpu_times.children_s(os.getpid()) - before_s
    if sys.platform == "linux":
        assert living_s > 0.25
    assert ended_s >= 0.25
