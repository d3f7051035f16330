"""`bricksrl learn`: what it says of a drawing, and what it leaves behind."""

from __future__ import annotations

import json
import re
from pathlib import Path
from types import SimpleNamespace

import pytest

from bricksrl.cli import learn_command, main, train
from bricksrl.envs.abilities import walking
from bricksrl.errors import DescriptionError, RunError
from bricksrl.policies import hub_export
from bricksrl.training import RunFolder
from bricktwin.robots import plans

PLANS = Path(plans.__path__[0])
EXAMPLES = Path(__file__).parents[4] / "examples"
SIX_LEGS = EXAMPLES / "15_six_legs.ldr"


def test_look_says_what_each_device_is_and_what_can_be_learned(bricksrl):
    done = bricksrl("learn", str(PLANS / "ev3_driver.ldr"), "--look")
    assert done.returncode == 0
    lines = done.stdout.splitlines()
    assert lines[0].startswith("ev3_driver: EV3 brick")
    assert any(line.startswith("  port B  left") and "wheel of 56 mm" in line for line in lines)
    assert any(line.startswith("  port 3  light") and "looks down" in line for line in lines)
    can = lines[lines.index("It can learn") : lines.index("It cannot learn")]
    assert any(line.split()[0] == "line" for line in can[1:])
    assert "  walk    walk forward: it drives on wheels" in lines


def test_learning_ends_with_a_report_and_the_hubs_program(monkeypatch, capfd, tmp_path):
    # One short episode of each kind is enough to see what is written.
    monkeypatch.setattr(walking, "_STEPS", 20)
    monkeypatch.setattr(train, "_EVALUATED_EPISODES", 1)
    monkeypatch.setattr(hub_export, "EPISODES", 1)
    run = tmp_path / "six"
    words = ["--episodes", "1", "--no-film", "--scene", "sumo", "--run", str(run)]
    code = main(["learn", str(SIX_LEGS), *words])
    said = capfd.readouterr()
    assert not code, said.err
    folder = RunFolder(run)
    assert folder.read_config().agent == "gait"
    assert folder.read_config().scene == "sumo"
    assert (run / "report.html").exists()
    program = (run / "on_the_hub.py").read_text(encoding="utf-8")
    assert "def turn_legs" in program
    assert f"--robot {SIX_LEGS}:walk" in said.out


@pytest.mark.parametrize(
    ("words", "page", "film", "episodes", "seed"),
    [
        ((), False, True, None, 0),
        (("--page", "--no-film", "--episodes", "3", "--seed", "5"), True, False, 3, 5),
    ],
)
def test_training_is_given_the_options(monkeypatch, tmp_path, words, page, film, episodes, seed):
    begun = []

    def execute(self: train.Train) -> None:
        begun.append(self)

    monkeypatch.setattr(train.Train, "execute", execute)
    monkeypatch.setattr(learn_command, "_say_if_nothing_was_learned", lambda _folder: None)
    monkeypatch.setattr(learn_command, "_export", lambda _folder, _reference: None)
    plan = f"{PLANS / 'ev3_driver.ldr'}:line"
    assert main(["learn", plan, "--run", str(tmp_path / "run"), *words]) == 0
    (training,) = begun
    assert training.env == plan
    assert (training.page, training.film) == (page, film)
    assert (training.episodes, training.seed) == (episodes, seed)
    assert training.run == tmp_path / "run"


def test_json_has_what_the_lines_have(bricksrl):
    done = bricksrl("learn", str(PLANS / "walker.ldr"), "--look", "--json")
    found = json.loads(done.stdout)
    assert [ability["name"] for ability in found["abilities"] if not ability["reason"]] == ["walk"]
    assert {motor["name"] for motor in found["motors"]} == {
        "left_front",
        "right_front",
        "left_back",
        "right_back",
    }


def test_what_is_no_plan_or_no_goal_is_refused(fails):
    fails("learn", "RunAway-v0", says="RunAway-v0 is no building plan")
    fails("learn", "nowhere.ldr", says="there is no file nowhere.ldr")
    fails("learn", str(SIX_LEGS), "--json", says="--json has no effect without --look")


def test_goal_that_a_robot_cannot_learn_is_refused(bricksrl):
    done = bricksrl("learn", f"{PLANS / 'walker.ldr'}:park")
    assert done.returncode == 2
    assert done.stderr.splitlines()[-1].startswith("error: walker cannot learn to park in a bay")


def test_robot_that_tips_over_is_told_why_before_it_learns(bricksrl, tmp_path):
    lines = (PLANS / "two_wheeler.ldr").read_text(encoding="utf-8").splitlines()
    without_caster = [line for line in lines if not line.endswith(" 39370c01.dat")]
    assert len(without_caster) < len(lines)
    path = tmp_path / "tipping.ldr"
    path.write_text("\n".join(without_caster) + "\n", encoding="utf-8")
    done = bricksrl("learn", str(path), "--look", "--json")
    (note,) = json.loads(done.stdout)["notes"]
    assert re.search(r"tips over backwards by \d+ degrees: its centre of mass, \d+ mm high", note)


def test_wheels_that_do_not_reach_the_floor_are_told(bricksrl, tmp_path):
    # With smaller wheels it stands on its caster and its color sensor.
    text = (EXAMPLES / "drawings" / "rover.ldr").read_text(encoding="utf-8")
    path = tmp_path / "small.ldr"
    path.write_text(text.replace(" 49295p02.dat", " 39367p02.dat"), encoding="utf-8")
    done = bricksrl("learn", str(path), "--look", "--json")
    (note,) = json.loads(done.stdout)["notes"]
    assert "its driven wheels do not touch the floor" in note


@pytest.mark.parametrize(
    ("over_link", "alone", "is_far_worse"),
    [
        (100.0, 200.0, False),
        (100.0, 90.0, False),
        (100.0, 50.0, True),
        (-100.0, -110.0, False),
        (-100.0, -150.0, True),
        (0.0, 0.0, False),
        (0.0, -1.0, True),
    ],
)
def test_a_program_that_does_far_worse_by_itself_is_said_to(
    monkeypatch, capfd, tmp_path, over_link, alone, is_far_worse
):
    made = SimpleNamespace(policy_return=over_link, hub_return=alone)
    asked = []

    def export(folder: Path, out: Path) -> SimpleNamespace:
        asked.append((folder, out))
        return made

    monkeypatch.setattr(hub_export, "export_program", export)
    learn_command._export(tmp_path, "rover.ldr:stop")
    out = tmp_path / "on_the_hub.py"
    assert asked == [(tmp_path, out)]
    said = capfd.readouterr()
    assert f"{alone:g} on the virtual hub by itself, {over_link:g} over the link" in said.out
    assert f"bricksrl hub run {out} --robot rover.ldr:stop" in said.out
    assert ("By itself it does far worse" in said.out + said.err) is is_far_worse


def test_why_there_is_no_program_for_the_hub_is_said(monkeypatch, capfd, tmp_path):
    def refuse(*_: Path) -> None:
        raise RunError("it has a camera")

    monkeypatch.setattr(hub_export, "export_program", refuse)
    learn_command._export(tmp_path, "rover.ldr:stop")
    said = capfd.readouterr()
    assert "There is no program for the hub: it has a camera." in said.out + said.err
    assert "run it" not in said.out


@pytest.mark.parametrize(
    ("evaluation", "says_so"),
    [
        ({"success_rate": 0.0}, True),
        ({"success_rate": 0.1}, False),
        ({"success_rate": None}, False),
        (None, False),
    ],
)
def test_who_has_not_learned_it_is_told_to_train_twice_as_long(
    monkeypatch, capfd, tmp_path, evaluation, says_so
):
    run = SimpleNamespace(read_episodes=lambda: [0] * 7, own_evaluation={7: evaluation}.get)
    monkeypatch.setattr(learn_command, "RunFolder", lambda _folder: run)
    learn_command._say_if_nothing_was_learned(tmp_path)
    written = capfd.readouterr()
    said = written.out + written.err
    assert ("It has not learned this" in said) is says_so
    assert (f"`bricksrl resume {tmp_path} --episodes 14`" in said) is says_so


def test_a_goal_is_asked_for_only_where_there_are_several(monkeypatch):
    def offered(*names: str) -> list[SimpleNamespace]:
        cannot = SimpleNamespace(ability=SimpleNamespace(name="walk"), task=None)
        can = [SimpleNamespace(ability=SimpleNamespace(name=name), task=1) for name in names]
        return [cannot, *can]

    asked = []
    monkeypatch.setattr(learn_command, "choose", lambda *about: asked.append(about) or "spin")
    assert learn_command._chosen("rover.ldr", offered("stop")) == "stop" and not asked
    assert learn_command._chosen("rover.ldr", offered("stop", "spin")) == "spin"
    assert asked == [("What is it to learn?", ["stop", "spin"], "stop")]
    with pytest.raises(
        DescriptionError, match=r"the robot of rover.ldr can learn nothing as it is"
    ):
        learn_command._chosen("rover.ldr", offered())


def test_what_a_drawing_shows_is_said_line_by_line(monkeypatch, capfd):
    def device(name: str, port: str, part: str, **more: str) -> SimpleNamespace:
        facts = SimpleNamespace(port=port, part=part, looks=more.get("looks"))
        return SimpleNamespace(name=name, facts=facts, moves=more.get("moves"))

    def offer(name: str, task: object, *, reason: str = "", remark: str = "") -> SimpleNamespace:
        ability = SimpleNamespace(name=name, sentence=f"to {name}")
        return SimpleNamespace(ability=ability, task=task, reason=reason, remark=remark)

    drawn = SimpleNamespace(
        robot=SimpleNamespace(name="rover"),
        hub=SimpleNamespace(part="Prime hub"),
        motors=[device("left", "A", "Motor", moves="turns a wheel")],
        sensors=[device("eyes", "E", "Sensor", looks="ahead"), device("light", "F", "Sensor")],
    )
    monkeypatch.setattr(learn_command, "_notes", lambda _drawn: ["It tips over."])
    can = [offer("spin", 1), offer("line", 1, remark="hard")]
    learn_command._say(drawn, [*can, offer("walk", None, reason="it has wheels")])
    said = capfd.readouterr()
    assert said.out.splitlines() == [
        "rover: Prime hub, 1 motor, 2 sensors",
        "  port A  left          Motor: turns a wheel",
        "  port E  eyes          Sensor: looks ahead",
        "  port F  light         Sensor: looks askew",
        "It can learn",
        "  spin    to spin",
        "  line    to line (hard)",
        "It cannot learn",
        "  walk    to walk: it has wheels",
    ]
    assert "It tips over." in said.err
    learn_command._say(drawn, can)
    assert "It cannot learn" not in capfd.readouterr().out
    learn_command._say(drawn, [])
    assert "It can learn" not in capfd.readouterr().out
