"""Code of strangers: nothing that a run, a policy, a dataset or settings from elsewhere name is
executed without trust."""

from __future__ import annotations

import contextlib
import dataclasses
import json
import shutil
import sys
from collections.abc import Iterator
from pathlib import Path
from typing import Any

import pytest
from hypothesis import HealthCheck, given, settings
from hypothesis import strategies as st

from bricksrl.agents import AGENTS, preset
from bricksrl.cli import main
from bricksrl.envs.make import make
from bricksrl.envs.registry import BUILT_IN
from bricksrl.errors import BricksError, RunError, UnknownNameError
from bricksrl.page.start import StartPage
from bricksrl.policies.sharing import export_policy
from bricksrl.training import RunFolder, TrainConfig, train
from bricksrl.training import trust as trusting
from bricksrl.training.config import code_in
from bricksrl.training.learners import make_learner_for, stand_in
from bricksrl.training.trust import trust

CANARY = "stranger_canary"
FORMS = (
    CANARY,
    f"{CANARY}.inner",
    f"{CANARY}:NAME",
    f"{CANARY}.inner:NAME",
    f"{CANARY}.py",
    f"{CANARY}.py:NAME",
    f"./{CANARY}.py",
    f"{CANARY.upper()}.PY",
    f"{CANARY}.py\n",
    f" {CANARY}",
    f"{CANARY} ",
    f":{CANARY}",
    f"sac:{CANARY}",
)


@pytest.fixture(scope="module")
def honest(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """A run and, beside it, its policy as it is shared."""
    folder = tmp_path_factory.mktemp("honest")
    small = dataclasses.replace(preset("default", "sac"), hidden=(8,), batch_size=4)
    train(TrainConfig("RunAway-v0", episodes=1, run_dir=folder / "run", settings=small))
    export_policy(folder / "run", folder / "policy")
    return folder


@pytest.fixture
def stranger(honest: Path, tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Iterator[Path]:
    """A run and a policy from elsewhere, in the present folder, beside a module and a package that
    must not be imported."""
    for name in ("run", "policy"):
        shutil.copytree(honest / name, tmp_path / "runs" / name)
    mark = tmp_path / "executed"
    for file in (f"{CANARY}.py", f"{CANARY}_package/__init__.py"):
        (tmp_path / file).parent.mkdir(exist_ok=True)
        (tmp_path / file).write_text(
            f"open({str(mark)!r}, 'w').close()\nNAME = transform = build = make_network = None\n"
        )
    monkeypatch.setenv("XDG_CONFIG_HOME", str(tmp_path / "home"))  # nobody has trusted anything
    monkeypatch.chdir(tmp_path)
    monkeypatch.syspath_prepend(tmp_path)
    yield tmp_path / "runs"
    assert not mark.exists(), "the stranger's code was executed"
    assert not [name for name in sys.modules if CANARY in name]


def changed(folder: Path, **values: Any) -> None:
    """Write other values into the config of a run or a policy; ``settings`` and ``options`` are
    added to."""
    for path in folder.glob("*/*.json"):
        content = json.loads(path.read_text())
        if "config" in content:
            config = content["config"]
            for name in ("settings", "options"):
                if isinstance(values.get(name), dict):
                    values[name] = {**config[name], **values[name]}
            path.write_text(json.dumps({**content, "config": {**config, **values}}))


def test_what_comes_with_bricksrl_needs_no_trust() -> None:
    for env in BUILT_IN:
        assert code_in(TrainConfig(env).to_dict()) == ()
    for agent in AGENTS:
        assert code_in(TrainConfig("Walker-v1", agent).to_dict()) == ()
    assert code_in({"settings": {"structure": "linear"}, "agent": "gait"}) == ()
    config = TrainConfig(
        "Spinning-v0",
        options={"robot": "cart"},
        link="mac",
        log="wandb",
        base="runs/a",
        start="runs/b",
    )
    assert code_in(config.to_dict()) == ()
    # of a pupil, on another computer
    for name in ("Anna", "Ben and Carla", "anna.py", "group:Anna"):
        assert code_in(TrainConfig("RunAway-v0", name=name).to_dict()) == ()


@pytest.mark.parametrize("form", FORMS)
@pytest.mark.parametrize(
    "values",
    [
        {"env": "X"},
        {"agent": "X"},
        {"transform": "X"},
        {"transform": ["X"]},
        {"settings": {"network": "X"}},
        {"settings": {"hidden": ["X"]}},
        {"settings": {"angles": "X"}},
        {"settings": "X"},
        {"settings": {"of_later": {"nested": ["X"]}}},
        {"agent": "gait", "settings": {"structure": "X"}},
        {"options": {"task": "X"}},
        {"options": ["X"]},
        {"physics": "X"},
        {"physics": {"battery_v": "X"}},
        {"log": "X"},
        {"of_later": "X"},
        {"of_later": {"X": 1}},
        {"frame_skip": "X"},
    ],
)
def test_whatever_may_name_code_needs_trust(values: dict[str, Any], form: str) -> None:
    config = {
        **TrainConfig("Walker-v1").to_dict(),
        **json.loads(json.dumps(values).replace('"X"', json.dumps(form))),
    }
    # which is looked up only
    assert form in code_in(config) or (values == {"env": "X"} and form == CANARY)


def test_a_name_that_is_none_of_ours_is_code() -> None:
    assert code_in({"env": "Walker v99", "agent": "sac"}) == ("Walker v99",)
    assert code_in({"env": "Walker-v1", "agent": "SAC"}) == ("SAC",)
    assert code_in("evil") == ("evil",)
    with pytest.raises(UnknownNameError, match=f"'{CANARY}' names no Python file; give FILE.py"):
        make("RunAway-v0", transform=CANARY)


@pytest.mark.parametrize(
    "values",
    [
        {"env": f"{CANARY}:NAME"},
        {"env": f"{CANARY}_package.inner"},
        {"agent": f"{CANARY}_package"},
        {"transform": CANARY},
        {"transform": f"{CANARY}_package"},
        {"settings": {"network": f"{CANARY}:NAME"}},
        {"of_later": {"plugin": CANARY}},
    ],
    ids=str,
)
def test_no_command_executes_code_of_a_stranger(
    stranger: Path, values: dict[str, Any], capfd: pytest.CaptureFixture[str]
) -> None:
    changed(stranger, **values)
    own = ["train", "RunAway-v0", "--episodes", "1", "--no-film", "--run", "own"]
    for words in (
        ["evaluate", "runs/run", "--episodes", "1"],
        ["compare", "runs/run"],
        ["plot", "runs/run", "--out", "plot.png"],
        ["export", "runs/run", "--out", "run.pt2"],
        ["export", "runs/policy", "--out", "policy.pt2"],
        ["resume", "runs/run"],
        ["train", "--resume", "runs/run"],
        ["play", "runs/run", "--episodes", "1"],
        ["play", "runs/policy", "--episodes", "1"],
        ["record", "RunAway-v0", "--policy", "runs/run", "--episodes", "1", "--out", "set"],
        ["record", "RunAway-v0", "--policy", "runs/policy", "--episodes", "1", "--out", "set"],
        [*own, "--from", "runs/run"],
        [*own, "--base", "runs/run"],
        [*own, "--demonstrations", "runs/run"],
        ["data", "push", "runs/run", "me/policy", "--policy"],
    ):
        assert main(words) == 2, words
        said = capfd.readouterr().err
        assert (
            said.count("\n") == 1
            and "made elsewhere or changed" in said
            and "`bricksrl trust " in said
        ), (words, said)
    assert StartPage(stranger.parent)._runs() == []
    for words in (["data", "info", "runs/run"], ["data", "check", "runs/run"]):
        assert main(words) == 0, words  # numbers need no trust
    assert trust(stranger / "run") == trust(stranger / "policy") != ()


def test_an_environment_that_is_only_named_is_not_looked_for_among_modules(stranger: Path) -> None:
    changed(stranger, env=CANARY)
    assert main(["evaluate", "runs/run", "--episodes", "1"]) == main(["resume", "runs/run"]) == 2
    assert (
        main(["record", "RunAway-v0", "--policy", "runs/run", "--out", "set"])
        == main(["play", "runs/policy"])
        == 2
    )


TEXTS = st.sampled_from(FORMS) | st.sampled_from([f"{CANARY}_package", f"{CANARY}_package:NAME"])
VALUES = (
    TEXTS
    | st.lists(TEXTS, min_size=1, max_size=2)
    | st.dictionaries(st.sampled_from(("a", CANARY)), TEXTS, min_size=1)
)
FIELDS = [field.name for field in dataclasses.fields(TrainConfig) if field.name != "run_dir"]
SETTINGS = [field.name for field in dataclasses.fields(preset("default", "sac"))]
PLACES = st.sampled_from(
    [
        *((name,) for name in [*FIELDS, "of_later"]),
        *(("settings", name) for name in [*SETTINGS, "later"]),
        ("options", "robot"),
    ]
)


def _is_text(field: str, value: Any) -> bool:
    """Whether it is an address, a folder or an id, which are never loaded."""
    if field == "env":
        return value in (CANARY, f"{CANARY}_package")
    return isinstance(value, str) and field in (
        "start",
        "base",
        "demonstrations",
        "data",
        "hub",
        "link",
        "device",
    )


@settings(max_examples=40, suppress_health_check=[HealthCheck.function_scoped_fixture])
@given(changes=st.dictionaries(PLACES, VALUES, min_size=1, max_size=2))
def test_no_config_executes_code_of_a_stranger(
    stranger: Path, changes: dict[tuple[str, ...], Any]
) -> None:
    path = stranger / "run" / "config.json"
    content = json.loads(path.read_text())
    whole = json.loads(json.dumps(content))
    for place, value in changes.items():
        table = whole["config"]
        if len(place) == 2 and isinstance(table[place[0]], dict):
            table = table[place[0]]
        table[place[-1]] = value
    path.write_text(json.dumps(whole))
    if all(_is_text(place[0], value) for place, value in changes.items()):
        assert code_in(whole["config"]) == ()
        with contextlib.suppress(BricksError):
            read = RunFolder(stranger / "run").read_config()
            make(read.env, read.robot).close()
            make_learner_for(read, stand_in(read))
    else:
        with pytest.raises(RunError, match="would run code"):
            RunFolder(stranger / "run").read_config()
    path.write_text(json.dumps(content))


def test_settings_of_a_stranger_need_trust(
    stranger: Path, capfd: pytest.CaptureFixture[str]
) -> None:
    Path("best.json").write_text(
        json.dumps({"settings": {"network": CANARY}, "provenance": {"found_by": "bricksrl tune"}})
    )
    assert main(["train", "RunAway-v0", "--settings", "best.json", "--run", "own"]) == 2
    assert "`bricksrl trust best.json`" in capfd.readouterr().err
    assert trust(Path("best.json")) == (CANARY,)


def test_options_in_a_dataset_are_of_its_task(stranger: Path) -> None:
    from bricksrl.data import load
    from bricksrl.data.formats import _minari_environment
    from bricksrl.data.schema import digest_of

    path = stranger / "run" / "data" / "meta" / "bricksrl.json"
    values = json.loads(path.read_text())
    values["options"] = {
        "transform": f"{CANARY}:NAME",
        "env_id": f"{CANARY}:NAME",
        "ends_at_wall": False,
    }
    # A stranger's file has a right digest too.
    del values["sha256"]
    path.write_text(json.dumps({**values, "sha256": digest_of(values)}))
    found = _minari_environment(load(stranger / "run"))["env"]
    assert found.kwargs == {"env_id": "RunAway-v0", "ends_at_wall": False}


@pytest.mark.skipif(sys.platform == "win32", reason="rights of POSIX")
def test_folder_that_others_can_write_to_says_nothing_of_trust(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(trusting.tempfile, "gettempdir", lambda: str(tmp_path))
    *_, private = trusting._folders()
    assert private.parent == tmp_path and private.stat().st_mode & 0o777 == 0o700
    for mode in (0o770, 0o707, 0o720):
        private.chmod(mode)
        assert private not in trusting._folders()
    private.chmod(0o700)
    assert private in trusting._folders()
    with monkeypatch.context() as patched:
        owner = private.stat().st_uid
        mine = private.with_name(f"bricksrl-trusted-{owner + 1}")
        mine.mkdir(mode=0o700)
        patched.setattr(trusting.os, "getuid", lambda: owner + 1)
        assert mine not in trusting._folders(), "somebody else has made it"
    private.rmdir()
    private.symlink_to(tmp_path / "elsewhere")
    assert private not in trusting._folders()
