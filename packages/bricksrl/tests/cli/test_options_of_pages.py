"""What the commands with a page, and recordings, make of their options."""

from __future__ import annotations

from collections.abc import Iterator
from contextlib import AbstractContextManager, contextmanager, nullcontext
from dataclasses import replace
from pathlib import Path
from types import SimpleNamespace
from typing import Any

import pytest
from test_options_of_trainings import write_run

from brickhub.cli.terminal import Interrupted
from brickhub.files import quoted
from bricksrl.cli import page, record
from bricksrl.cli.page import DriveRobot, Play, run_on_page
from bricksrl.cli.record import Record
from bricksrl.envs.options import EnvOptions
from bricksrl.errors import DataError, HubError, StoppedError, UnknownNameError
from bricksrl.page.server import PageOptions
from bricksrl.policies.policy import Player
from bricksrl.training import TrainConfig


class Env:
    """An environment that is only closed."""

    def __init__(self, name: str = "RunAway-v0") -> None:
        self.task = SimpleNamespace(id=name)
        self.is_open = True

    def close(self) -> None:
        self.is_open = False


@pytest.fixture
def made(monkeypatch: pytest.MonkeyPatch) -> list[Any]:
    """Environments that were made: their names, options and seeds, and themselves."""
    environments: list[Any] = []

    def make(env_id: str, options: EnvOptions, **named: Any) -> Env:
        env = Env(env_id)
        environments.append((env_id, options, named, env))
        return env

    monkeypatch.setattr(page, "make", make)
    monkeypatch.setattr(page, "placing", lambda: "by hand")
    monkeypatch.setattr(page, "load_learning", lambda: None)
    return environments


TRAINED = TrainConfig(
    "WalkerSim-v0",
    options={"step_ms": 300, "blocked_at_mm": 50.0},
    frame_stack=2,
    seed=3,
)


def test_run_is_played_in_its_environment(tmp_path: Path, made: list[Any]) -> None:
    """With the transforms and options of the training, but for what is given anew."""
    run = write_run(tmp_path / "run", TRAINED)
    flags = Play(str(run), seed=9, robot=EnvOptions(options={"step_ms": 500}))
    with page._environment(flags, str(run), run) as (env, env_id):
        assert env_id == "WalkerSim-v0" and env.is_open
    (name, options, named, env) = made[0]
    assert not env.is_open
    assert name == "WalkerSim-v0"
    assert options == EnvOptions(frame_stack=2, options={"step_ms": 500, "blocked_at_mm": 50.0})
    assert named == {"seed": 9, "place": "by hand"}
    with page._environment(DriveRobot("Park-v0", seed=4), "Park-v0", None) as (_, env_id):
        assert env_id == "Park-v0"
    assert made[1][:3] == ("Park-v0", EnvOptions(), {"seed": 4, "place": "by hand"})


@pytest.mark.parametrize(
    ("robot", "scene"),
    [
        (EnvOptions(), "sumo"),
        (EnvOptions(scene="fll"), "fll"),
        (EnvOptions(hub="ble"), None),
    ],
)
def test_virtual_robot_stays_in_the_world_of_its_training(
    tmp_path: Path, made: list[Any], robot: EnvOptions, scene: str | None
) -> None:
    run = write_run(tmp_path / "run", TrainConfig("RunAway-v0", scene="sumo"))
    with page._environment(Play(str(run), robot=robot), str(run), run):
        pass
    assert made[0][1] == replace(robot, scene=scene)


class Shown:
    """What is shown on a page and played in the terminal, without either."""

    def __init__(self, monkeypatch: pytest.MonkeyPatch) -> None:
        self.pages: list[Any] = []
        self.terminals: list[Any] = []
        self.players: list[Any] = []
        monkeypatch.setattr(page, "_on_page", self.on_page)
        monkeypatch.setattr(page, "_in_terminal", lambda *given: self.terminals.append(given[1:]))
        monkeypatch.setattr(page, "_players", self.players_of)

    def on_page(self, address: PageOptions, _env: Any, env_id: str, *_: Any, **named: Any) -> None:
        self.pages.append((address, env_id, named))

    def players_of(self, *given: Any) -> dict[str, Any]:
        run, _, *others = given
        self.players.append((run, *others))
        return {"random": lambda: "random actions", "last": lambda: "the last one"}


def test_run_is_played_in_the_terminal_or_on_a_page(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, made: list[Any]
) -> None:
    shown = Shown(monkeypatch)
    run = write_run(tmp_path / "run", TRAINED)
    Play(str(run), episodes=2, seed=9).execute()
    Play(str(run), policy="random", page=True, episodes=4).execute()
    Play("WalkerSim-v0", seed=9).execute()
    seed = page.evaluation_seed(3, 9)
    assert shown.terminals == [("the last one", 2, seed), ("the last one", None, 9)]
    assert shown.pages == [
        (PageOptions(), "WalkerSim-v0", {"subtitle": str(run), "episodes": 4}),
    ]
    assert shown.players == [
        (run, "WalkerSim-v0", None, 9),
        (run, "WalkerSim-v0", "random", 1000),
        (None, "WalkerSim-v0", None, 9),
    ]


def test_environment_without_arrays_has_a_page_without_a_subtitle(
    monkeypatch: pytest.MonkeyPatch, made: list[Any]
) -> None:
    shown = Shown(monkeypatch)
    Play("WalkerSim-v0", page=True).execute()
    assert shown.pages == [(PageOptions(), "WalkerSim-v0", {"subtitle": "", "episodes": None})]


def test_real_robot_is_played_with_torch(monkeypatch: pytest.MonkeyPatch, made: list[Any]) -> None:
    Shown(monkeypatch)
    Play("RunAway-v0", page=True, robot=EnvOptions(hub="ble")).execute()
    assert "arrays" not in made[0][2]


@pytest.mark.parametrize(("name", "may_be_a_run"), [("RunAwya-v0", True), ("Tag-v0", False)])
def test_unknown_environment_may_be_meant_as_a_run(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, name: str, may_be_a_run: bool
) -> None:
    """An arena is known, and none of the environments that are played."""
    monkeypatch.chdir(tmp_path)
    with pytest.raises(UnknownNameError) as raised:
        page._look_for_env(name, Path(name))
    assert ("; or the folder of a run: " in str(raised.value)) is may_be_a_run
    page._look_for_env("RunAway-v0", Path("RunAway-v0"))


def test_played_episodes_are_told_one_by_one(
    monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    asked: list[Any] = []
    attached: list[Any] = []

    def play_episodes(env: Any, act: Any, episodes: int, seed: int, *, reset_policy: Any) -> Any:
        asked.append((act, episodes, seed, reset_policy))
        yield SimpleNamespace(return_=1.23456, length=1)
        yield SimpleNamespace(return_=-2.0, length=20)
        if seed == 8:
            raise StoppedError("stopped by hand")

    stop = SimpleNamespace(attach=attached.append)
    monkeypatch.setattr(page, "EmergencyStop", lambda *_: nullcontext(stop))
    monkeypatch.setattr("bricksrl.envs.rollout.play_episodes", play_episodes)
    player = Player(act=print, reset=repr)
    env: Any = Env()
    page._in_terminal(env, player, 2, 7)
    assert attached == [env]
    assert asked == [(print, 2, 7, repr)]
    lines = ["episode 1  return 1.235  1 step", "episode 2  return -2  20 steps"]
    assert capsys.readouterr().out.splitlines() == lines
    with pytest.raises(Interrupted):
        page._in_terminal(env, player, None, 8)
    assert asked[1][1] == page.sys.maxsize, "until somebody ends it"


class LivePage(AbstractContextManager[Any]):
    """A page that is not served, and what it was made of."""

    pages: list[Any]
    url = "http://127.0.0.1:1/"

    def __init__(self, *given: Any, **named: Any) -> None:
        LivePage.pages.append((given, named))

    def __exit__(self, *_: object) -> None:
        """Nothing was opened."""


@pytest.fixture
def pages(monkeypatch: pytest.MonkeyPatch) -> list[Any]:
    LivePage.pages = []
    monkeypatch.setattr("bricksrl.page.live.LivePage", LivePage)
    monkeypatch.setattr(page, "announce", LivePage.pages.append)
    return LivePage.pages


def test_page_of_a_run_is_announced(pages: list[Any]) -> None:
    with run_on_page(None, "WalkerSim-v0", EnvOptions()) as live:
        assert live is None
    assert pages == []
    address = PageOptions(page_port=9000)
    options = EnvOptions(options={"step_ms": 300})
    with run_on_page(address, "WalkerSim-v0", options, on_stop=repr, can_drive=False) as live:
        assert isinstance(live, LivePage)
    (given, named), url = pages
    assert given == ("WalkerSim-v0",) and url == "http://127.0.0.1:1/"
    assert named.pop("task").id == "WalkerSim-v0"
    assert named == {"can_drive": False, "on_stop": repr, "options": address}


def test_page_of_a_player_begins_as_it_was_asked_to(
    monkeypatch: pytest.MonkeyPatch, pages: list[Any]
) -> None:
    played: list[Any] = []

    def play_until_stopped(env: Any, live: Any, play: Any) -> None:
        played.append(play("the stop"))

    monkeypatch.setattr(page, "play_until_stopped", play_until_stopped)
    env = Env()

    def play(*given: Any, **named: Any) -> Any:
        assert given[0] is env and isinstance(given[1], LivePage)
        return given[2], named

    policies = {"random": 1, "last": 2}
    address = PageOptions()
    page._on_page(address, env, "RunAway-v0", play, policies)
    page._on_page(
        address,
        env,
        "RunAway-v0",
        play,
        policies,
        subtitle="by hand",
        in_charge=True,
        episodes=4,
    )
    usual = {"task": env.task, "policies": ("random", "last"), "speed": "1x", "options": address}
    assert pages == [
        (("RunAway-v0", ""), usual | {"in_charge": False}),
        (("RunAway-v0", "by hand"), usual | {"in_charge": True}),
    ]
    assert played == [
        (policies, {"episodes": None, "stop": "the stop"}),
        (policies, {"episodes": 4, "stop": "the stop"}),
    ]


class Recording:
    """A recording of one episode, and what it was asked for."""

    def __init__(self, monkeypatch: pytest.MonkeyPatch) -> None:
        self.asked: list[Any] = []
        self.made: list[Any] = []
        self.stops: list[Any] = []
        self.drivers: list[Any] = []
        self.error: BaseException | None = None
        self.human: Any = None
        self.reconnect = SimpleNamespace(patience_s=1.0)
        monkeypatch.setattr(record, "load_learning", lambda: None)
        monkeypatch.setattr(record, "make", self.make)
        monkeypatch.setattr(record, "describe", lambda env, options: options)
        monkeypatch.setattr(record, "driving", self.driving)
        monkeypatch.setattr(record, "EmergencyStop", self.emergency_stop)
        monkeypatch.setattr(record, "Recorder", lambda *_: nullcontext(SimpleNamespace(rows=())))
        monkeypatch.setattr(record.Record, "_player", lambda *_: Player(act=print, reset=repr))
        monkeypatch.setattr("bricksrl.data.collect.collect", self.collect)
        interface = SimpleNamespace(reconnect=self.reconnect)
        monkeypatch.setattr("bricksrl.envs.env_interface.interface_of", lambda env: interface)
        filmed: Any = lambda *_: nullcontext()  # noqa: E731
        monkeypatch.setattr("bricksrl.evaluation.film.filmed_env", filmed)

    def make(self, env_id: str, options: EnvOptions, **named: Any) -> Env:
        self.made.append((env_id, options, named["seed"], named["watched_button"]))
        return Env(env_id)

    @contextmanager
    def driving(self, *given: Any, in_charge: bool, on_discard: Any) -> Iterator[Any]:
        self.drivers.append((given[0], in_charge))
        yield self.human

    def emergency_stop(self, *_: Any, keys: Any, on_discard: Any) -> Any:
        self.stops.append(keys)
        stop = SimpleNamespace(attach=lambda env: None, quiet=nullcontext)
        return nullcontext(stop)

    def collect(self, env: Any, act: Any, recorder: Any, episodes: int, **named: Any) -> None:
        on_lost = named.pop("on_lost")
        on_episode = named.pop("on_episode")
        del named["discard"]
        self.asked.append((act, episodes, named))
        on_lost(1, HubError("the link broke"))
        row = SimpleNamespace(interventions=0, return_=1.23456, length=20, episode=0)
        on_episode(row)
        on_episode(SimpleNamespace(**vars(row) | {"interventions": 7, "length": 1}))
        if self.error is not None:
            raise self.error


@pytest.fixture
def recording(monkeypatch: pytest.MonkeyPatch) -> Recording:
    return Recording(monkeypatch)


def test_recording_is_told_line_by_line(
    recording: Recording, capsys: pytest.CaptureFixture[str]
) -> None:
    Record("RunAway-v0", Path("data"), seed=4, robot=EnvOptions(hub="ble")).execute()
    named = {"name": "random", "seed": 4, "hub": "ble", "driver": None, "reset_policy": repr}
    assert recording.asked == [(print, 10, named)]
    assert recording.made == [("RunAway-v0", EnvOptions(hub="ble"), 4, None)]
    assert (recording.stops, recording.drivers) == ([None], [(None, False)])
    assert recording.reconnect.patience_s == 300.0, "as in a training"
    captured = capsys.readouterr()
    assert captured.out.splitlines() == [
        "episode 1/10  return 1.235  20 steps",
        "episode 2/10  return 1.235  1 step  7 steps by hand",
        "dataset         data, seed 4",
        "look at it      bricksrl data info data",
    ]
    assert captured.err == (
        "the link broke; 1 step of this episode are kept as broken off, and another one is "
        "recorded\n"
    )


@pytest.mark.parametrize(
    ("options", "device", "in_charge", "keys"),
    [
        ({"policy": "keyboard"}, "keyboard", True, False),
        ({"policy": "gamepad"}, "gamepad", True, None),
        ({"take_over": "keyboard"}, "keyboard", False, False),
    ],
)
def test_human_is_recorded_in_real_time(
    recording: Recording,
    options: dict[str, Any],
    device: str,
    in_charge: bool,
    keys: bool | None,
) -> None:
    recording.human = "a human"
    Record("RunAway-v0", Path("data"), episodes=3, **options).execute()
    assert recording.made[0][1] == EnvOptions(realtime=True)
    assert (recording.stops, recording.drivers) == ([keys], [(device, in_charge)])
    _, episodes, named = recording.asked[0]
    assert (episodes, named["driver"]) == (3, "a human")


@pytest.mark.parametrize("error", [KeyboardInterrupt(), StoppedError("stopped by hand")])
def test_interrupted_recording_says_what_it_has(recording: Recording, error: BaseException) -> None:
    recording.error = error
    with pytest.raises(Interrupted, match="^saved 2 whole episodes in data$"):
        Record("RunAway-v0", Path("data")).execute()


def test_policy_of_a_run_is_recorded_behind_its_transforms(
    recording: Recording, tmp_path: Path
) -> None:
    run = write_run(tmp_path / "run", TRAINED)
    Record("WalkerSim-v0", Path("data"), policy=str(run)).execute()
    assert recording.made[0][1] == EnvOptions(frame_stack=2)


@pytest.mark.parametrize(
    ("policy", "explore", "is_shared", "acts"),
    [
        ("random", False, False, ("random", 4)),
        ("keyboard", False, False, "rests"),
        ("controller", False, False, "rests"),
        ("a run", False, False, "exploits the run"),
        ("a run", True, False, "explores the run"),
        ("a run", False, True, "exploits the shared one"),
    ],
)
def test_recording_is_of_the_policy_that_was_named(
    monkeypatch: pytest.MonkeyPatch, policy: str, explore: bool, is_shared: bool, acts: Any
) -> None:
    def learner(name: str) -> Any:
        return SimpleNamespace(
            explore=f"explores {name}", exploit=f"exploits {name}", reset_policy="forgets"
        )

    trained = SimpleNamespace(learner=learner("the run"))
    random_player = lambda env, seed: ("random", seed)  # noqa: E731
    monkeypatch.setattr("bricksrl.policies.policy.random_player", random_player)
    monkeypatch.setattr("bricksrl.page.play.resting_player", lambda env: "rests")
    monkeypatch.setattr("bricksrl.policies.sharing.is_policy", lambda path: is_shared)
    shared = lambda path, env: learner("the shared one")  # noqa: E731
    monkeypatch.setattr("bricksrl.policies.sharing.load_shared", shared)
    monkeypatch.setattr("bricksrl.training.learners.load_learner", lambda path, env: trained)
    command = Record("RunAway-v0", Path("data"), policy=policy, seed=4, explore=explore)
    env: Any = None
    player: Any = command._player(env)
    if policy == "a run":
        assert (player.act, player.reset) == (acts, "forgets")
    else:
        assert player == acts


@pytest.mark.parametrize(
    ("rows", "faults", "says"),
    [
        (0, ["never looked at; restore it"], None),
        (1, [], "my data has 1 episode already, which are kept; this adds to them\n"),
        (7, [], "my data has 7 episodes already, which are kept; this adds to them\n"),
        (7, ["a row is lost; restore it"], None),
    ],
)
def test_dataset_that_is_extended_is_named(
    monkeypatch: pytest.MonkeyPatch,
    capsys: pytest.CaptureFixture[str],
    rows: int,
    faults: list[str],
    says: str | None,
) -> None:
    found = [SimpleNamespace(detail=fault) for fault in faults]
    monkeypatch.setattr(record, "check", lambda path: found)
    recorder: Any = SimpleNamespace(rows=[None] * rows)
    command = Record("RunAway-v0", Path("my data"))
    if rows and faults:
        with pytest.raises(DataError) as raised:
            command._check_dataset(recorder)
        assert str(raised.value) == (
            f"my data is damaged (a row is lost); `bricksrl data repair {quoted('my data')} --out "
            "NEW` saves what is whole"
        )
    else:
        command._check_dataset(recorder)
    assert capsys.readouterr().err == (says or "")


def test_players_of_an_environment_are_those_of_its_arrays(
    monkeypatch: pytest.MonkeyPatch, tmp_path: Path
) -> None:
    of_arrays = {"random": "first", "best": "second"}
    asked: list[Any] = []

    def arrays(*given: Any) -> Any:
        asked.append(given)
        return of_arrays

    monkeypatch.setattr(page, "array_policies", arrays)
    monkeypatch.setattr("bricksrl.policies.policy.array_player", lambda make: ("plays", make))
    named = lambda run, env, seed: {"first": 1, "last": (run, env, seed)}  # noqa: E731
    monkeypatch.setattr("bricksrl.policies.policy.named_policies", named)
    env: Any = Env()
    players = page._players(None, env, "RunAway-v0", "random", 5)
    assert list(players) == ["best", "random"]
    assert players["random"]() == ("plays", "first")  # type: ignore[comparison-overlap]
    assert asked == [("RunAway-v0", env.task, 5)]
    of_run = page._players(tmp_path, env, "RunAway-v0", "first", 5)
    assert of_run == {"last": (tmp_path, env, 5), "first": 1} and list(of_run)[-1] == "first"
