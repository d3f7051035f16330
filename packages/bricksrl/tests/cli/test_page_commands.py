"""Commands with a page."""

from __future__ import annotations

import itertools
import json
import re
from contextlib import AbstractContextManager, closing, contextmanager
from types import SimpleNamespace

import pytest

from brickhub.cli.terminal import Interrupted
from bricksrl import make
from bricksrl.cli import main, page
from bricksrl.cli.app import parse
from bricksrl.cli.page import Demo, DriveRobot, Play, _in_terminal, announce, has_screen
from bricksrl.errors import DescriptionError, StoppedError
from bricksrl.policies.policy import Player


def test_record_on_page(tmp_path, capfd):
    out = tmp_path / "data"
    assert main(["record", "RunAway-v0", "--episodes", "2", "--out", str(out), "--page"]) == 0
    told = capfd.readouterr()
    assert re.search(
        r"^live page: http://127\.0\.0\.1:\d+/\?token=\S{20,}$", told.err, re.MULTILINE
    )
    assert told.out.count("episode ") == 2


@pytest.mark.realtime
def test_play_on_page(capfd):
    assert main(["play", "RunAway-v0", "--episodes", "1", "--page"]) == 0
    told = capfd.readouterr()
    assert (
        told.out.startswith("1 episode, mean return") and "live page: http://127.0.0.1:" in told.err
    )


def test_play_in_terminal_plays_an_episode_again_whose_link_was_lost(capfd):
    env, steps = make("RunAway-v0", seed=0), itertools.count()

    def act(state):
        if next(steps) == 5:
            env.twin.in_reach = lambda: False
        return state.set("action", env.action_spec.zero())

    with closing(env):
        _in_terminal(env, Player(act), 2, 0)
    assert re.findall(r"return \S+  (\d+) steps", capfd.readouterr().out) == ["20", "20"], (
        "no half an episode"
    )


def test_play_in_terminal_plays_what_is_evaluated(tmp_path, capfd):
    run = str(tmp_path / "run")
    assert main(["train", "RunAway-v0", "--episodes", "1", "--no-film", "--run", run]) == 0
    capfd.readouterr()
    assert main(["evaluate", run, "--episodes", "5", "--json"]) == 0
    returns = json.loads(capfd.readouterr().out)["returns"]
    assert len(set(returns)) > 1
    assert main(["play", run, "--episodes", "5"]) == 0
    played = re.findall(
        r"^episode \d  return (\S+)  \d+ steps?$", capfd.readouterr().out, re.MULTILINE
    )
    assert played == [f"{value:.4g}" for value in returns]


def test_random_actions_are_those_of_the_seed(capfd):
    def play(seed):
        assert main(["play", "Walker-v0", "--episodes", "1", "--seed", seed]) == 0
        return capfd.readouterr().out

    assert play("3") == play("3") != play("4")


def test_program_on_page(tmp_path, capfd):
    program = tmp_path / "main.py"
    program.write_text("from pybricks.tools import wait\nwait(100)\nprint('done')\n")
    assert main(["hub", "run", str(program), "--page"]) == 0
    told = capfd.readouterr()
    assert told.out == "done\n" and "live page: http://" in told.err


def test_several_programs_on_page(tmp_path, capfd):
    program = tmp_path / "main.py"
    program.write_text("from pybricks.tools import wait\nwait(100)\nprint('done')\n")
    several = ["hub", "run", str(program), str(program), "--page"]
    assert main([*several, "--robot", "two-wheeler", "--robot", "scout"]) == 0
    told = capfd.readouterr()
    assert told.out == "main 1: done\nmain 2: done\n" and "live page: http://" in told.err
    assert main(several) == 2
    assert "name a robot for each program, or omit --page" in capfd.readouterr().err
    assert main([*several[:-1], "--page-port", "9000"]) == 2
    assert "--page-port has no effect without --page" in capfd.readouterr().err


@pytest.mark.parametrize(
    ("arguments", "says"),
    [
        (
            ("play", "runs/nothing"),
            "there is no run in runs/nothing; name a folder with a config.json, or an environment",
        ),
        (
            ("record", "RunAway-v0", "--out", "x", "--policy", "keybord"),
            "in keybord (did you mean 'keyboard'?); name",
        ),
        (("team", "--play", "runs/nothing"), "there is no team in runs/nothing; name a folder"),
        (("team", "tag-v0"), "there is no arena 'tag-v0' (did you mean 'Tag-v0'?); choose"),
        (
            ("play", "RunAway-v0", "--hub", "virtul"),
            "there is no hub 'virtul' (did you mean 'virtual'?); choose",
        ),
        (
            ("data", "repair", "runs/nothing"),
            "in runs/nothing; choose a folder with a meta/bricksrl.json",
        ),
        (("camera", "calibrate", "--camera", "99"), "camera 99 shows nothing; plug it in"),
        (("play", "RunAway-v0", "--policy", "last"), "choose random, scripted, best"),
        (("play", "RunAway-v0", "--page", "--page-port", "70000"), "is not a port"),
        (("drive", "RunAway-v0", "--page-host", "256.0.0.1"), "name another host"),
        (("hub", "run", __file__, "--page", "--hub", "ble"), "leave out --hub, or --page"),
        (
            ("hub", "run", __file__, "--page-port", "9000"),
            "--page-port has no effect without --page; omit it",
        ),
        (("record", "RunAway-v0", "--out", "x", "--video", "x.gif"), "end it in .mp4"),
        (
            ("play", "RunAway-v0", "--page-host", "::1"),
            "--page-host has no effect without --page; omit it",
        ),
        (("play", "RunAway-v0", "--page", "--episodes", "0"), "episodes is 0; give 1 or more"),
        (
            ("record", "RunAway-v0", "--out", "x", "--page-port", "1"),
            "--page-port has no effect without --page; omit it",
        ),
        (
            ("record", "RunAway-v0", "--out", "x", "--explore"),
            "--explore has no effect with the policy 'random'",
        ),
        (
            (
                "record",
                "RunAway-v0",
                "--out",
                "x",
                "--policy",
                "gamepad",
                "--take-over",
                "keyboard",
            ),
            "omit --take-over",
        ),
        (
            ("team", "Tag-v0", "--page", "--frames", "9"),
            "--frames has no effect with --page; omit it",
        ),
        (
            ("team", "Tag-v0", "--page-port", "9000"),
            "--page-port has no effect without --page; omit it",
        ),
        (("page", "--page-host", "256.0.0.1"), "name another host"),
    ],
)
def test_errors_print_one_line(fails, tmp_path, monkeypatch, arguments, says):
    monkeypatch.chdir(tmp_path)
    fails(*arguments, says=says)
    assert not list(tmp_path.iterdir())


def test_page_is_local_by_default():
    for words in (
        ["drive", "Spinning-v0"],
        ["play", "runs/spin", "--page"],
        ["train", "Walker-v1", "--page"],
        ["page"],
        ["team", "Tag-v0", "--page"],
    ):
        options = parse(words).live_page
        assert (options.page_host, options.page_port) == ("127.0.0.1", None)
    assert isinstance(parse(["drive", "Spinning-v0"]), DriveRobot) and isinstance(
        parse(["play", "runs/spin"]), Play
    )


def test_phone_in_the_network_gets_a_qr_code(capfd):
    pytest.importorskip("segno")
    announce("http://127.0.0.1:8090/?token=x")
    assert capfd.readouterr().err.count("\n") == 1
    announce("http://192.168.1.20:8090/?token=x")
    assert len(set(map(len, capfd.readouterr().err.splitlines()[2:]))) == 1


def test_no_browser_without_display(monkeypatch):
    monkeypatch.setattr("sys.stderr", None)
    assert not has_screen()


@pytest.mark.parametrize(
    ("platform", "is_terminal", "variables", "has"),
    [
        ("linux", True, {"DISPLAY": ":0"}, True),
        ("linux", True, {"WAYLAND_DISPLAY": "wayland-0"}, True),
        ("linux", True, {}, False),
        ("linux", False, {"DISPLAY": ":0"}, False),
        ("linux", True, {"DISPLAY": ":0", "SSH_CONNECTION": "10.0.0.1 22"}, False),
        ("darwin", True, {}, True),
        ("win32", True, {}, True),
        ("darwin", True, {"SSH_CONNECTION": "10.0.0.1 22"}, False),
        ("win32", False, {}, False),
    ],
)
def test_a_browser_is_seen_where_somebody_sits(monkeypatch, platform, is_terminal, variables, has):
    for name in ("DISPLAY", "WAYLAND_DISPLAY", "SSH_CONNECTION"):
        monkeypatch.delenv(name, raising=False)
    for name, value in variables.items():
        monkeypatch.setenv(name, value)
    screen = SimpleNamespace(isatty=lambda: is_terminal)
    system = SimpleNamespace(platform=platform, stderr=screen)
    monkeypatch.setattr("bricksrl.cli.page.sys", system)
    assert has_screen() is has


class Shown:
    """What commands show on a page, and which environments they make for it."""

    def __init__(self, monkeypatch) -> None:
        self.shown, self.made = [], []
        self.env = SimpleNamespace(task=None, close=lambda: None)
        monkeypatch.setattr(page, "_on_page", lambda *given, **named: self.shown.append(named))
        monkeypatch.setattr(page, "make", self.make)
        monkeypatch.setattr(page, "placing", lambda: "by hand")
        monkeypatch.setattr(page, "array_policies", lambda *_: {"random": 1, "best": 2})

    def make(self, env_id, *_options, **named):
        self.made.append((env_id, named))
        return self.env


def test_commands_show_a_robot_as_they_were_asked_to(monkeypatch):
    stage = Shown(monkeypatch)
    monkeypatch.setattr(page, "has_arrays", lambda *_: True)
    DriveRobot("RunAway-v0", seed=3).execute()
    Play("RunAway-v0", seed=5, page=True, episodes=2).execute()
    Demo("Walker-v1", seed=7, episodes=4).execute()
    assert stage.made == [
        ("RunAway-v0", {"seed": 3, "place": "by hand", "arrays": True}),
        ("RunAway-v0", {"seed": 5, "arrays": True}),
        ("Walker-v1", {"seed": 7, "arrays": True}),
    ]
    assert stage.shown == [
        {"subtitle": "driven by hand", "in_charge": True},
        {"episodes": 2},
        {"subtitle": "comes with BricksRL", "episodes": 4},
    ]


def test_a_robot_is_driven_from_the_page_unless_a_device_is_in_charge(monkeypatch):
    stage = Shown(monkeypatch)
    monkeypatch.setattr(page, "has_arrays", lambda *_: False)
    asked = []

    @contextmanager
    def driving(device, env_id, _task, *, in_charge):
        asked.append((device, env_id, in_charge))
        yield device

    monkeypatch.setattr(page, "driving", driving)
    for device in (None, "gamepad"):
        DriveRobot("RunAway-v0", seed=3, device=device).execute()
    assert asked == [(None, "RunAway-v0", True), ("gamepad", "RunAway-v0", True)]
    assert [named["in_charge"] for named in stage.shown] == [True, False]
    with pytest.raises(DescriptionError, match="has no robot to show; `bricksrl demo` shows"):
        Demo("WalkerSim-v0").execute()


@pytest.mark.parametrize(
    ("named", "order"),
    [
        (None, ["random", "first", "last"]),
        ("last", ["random", "first", "last"]),
        ("random", ["first", "last", "random"]),
        ("first", ["random", "last", "first"]),
    ],
)
def test_a_page_begins_with_the_policy_that_was_named(named, order):
    policies = {"random": 1, "first": 2, "last": 3}
    found = page._beginning_with(named, policies, "runs/x")
    assert list(found) == order and found == policies
    with pytest.raises(DescriptionError, match="runs/x has no policy 'best'; choose random, first"):
        page._beginning_with("best", policies, "runs/x")


class ServedPage(AbstractContextManager):
    url = "http://127.0.0.1:1/"

    def __exit__(self, *_):
        pass


def test_what_was_played_is_summed_up_and_a_stop_is_no_end_of_it(capfd):
    env = make("WalkerSim-v0")
    live = ServedPage()
    for returns, line in (([1.0, 2.0], "2 episodes, mean return 1.5"), ([-3.0], "1 episode, mean")):
        page.play_until_stopped(env, live, lambda _stop, returns=returns: returns)
        assert capfd.readouterr().out.startswith(line)

    def stop(_stop):
        raise StoppedError("by hand")

    with pytest.raises(Interrupted):
        page.play_until_stopped(env, live, stop)
    assert not capfd.readouterr().out
