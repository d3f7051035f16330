"""``bricksrl settings``."""

from __future__ import annotations

import dataclasses
import json

import pytest

from bricksrl.agents import AGENTS, algorithm, preset
from bricksrl.cli import main
from bricksrl.cli.envs import field_docs


@pytest.mark.parametrize("agent", AGENTS)
def test_every_setting_has_help(agent):
    kind = algorithm(agent).settings
    meanings = field_docs(kind)
    assert [field.name for field in dataclasses.fields(kind) if not meanings.get(field.name)] == []


def test_settings_table(capsys, monkeypatch):
    monkeypatch.setenv("COLUMNS", "160")
    assert main(["settings", "td3"]) == 0
    lines = capsys.readouterr().out.splitlines()
    (hidden,) = (line for line in lines if line.startswith("hidden"))
    assert hidden.split()[1] == "256,256" and "Units of each hidden layer" in hidden
    (rate,) = (line for line in lines if line.startswith("learning_rate"))
    assert rate.split()[1] == "0.0005" and "Adam's step size." in rate, (
        "a default of its own, the help of its base"
    )


def test_json_is_accepted_by_train(capsys, tmp_path):
    from bricksrl.evaluation.settings_text import read_settings

    assert main(["settings", "sac", "--preset", "paper", "--json"]) == 0
    path = tmp_path / "settings.json"
    path.write_text(capsys.readouterr().out)
    assert read_settings(path, preset("default", "sac")) == preset("paper", "sac")
    assert "gamma" in json.loads(path.read_text())


def test_settings_in_an_environment(capsys):
    assert main(["settings", "sac", "--env", "Walker-v2", "--json"]) == 0
    assert json.loads(capsys.readouterr().out)["n_step"] == 3


def test_settings_of_user_file(capsys, tmp_path):
    path = tmp_path / "own.py"
    path.write_text(
        "from dataclasses import dataclass\n\n@dataclass(frozen=True)\nclass Mine:\n"
        "    speed: float = 2.5\n"
        '    """How fast\n    it goes."""\n\ndef build(env, settings: Mine, device): ...\n'
    )
    assert main(["settings", str(path)]) == 0
    assert "speed    2.5    How fast it goes." in capsys.readouterr().out


def test_unknown_agent_prints_one_line(fails):
    fails("settings", "sca", says="there is no agent 'sca'")
    fails("settings", "sac", "--preset", "papr", says="choose one of default, paper")
    fails("settings", "sac", "--env", "Walker-v", says="did you mean 'Walker-v2'?")
