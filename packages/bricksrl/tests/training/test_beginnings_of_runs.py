"""How a run begins: its environment, its learner, its folder and its metrics; without training."""

from __future__ import annotations

from contextlib import ExitStack, nullcontext
from pathlib import Path
from types import SimpleNamespace
from typing import Any

import pytest
from toys import Cart

from bricksrl.errors import DescriptionError, RunError
from bricksrl.training import Episode, Phase, RunFolder, TrainConfig, resume, train
from bricksrl.training import run as runs
from bricksrl.training.run_folder import Origin, file_name

# In the tests of a module it is replaced by one that draws a pixel.
draw_curve = RunFolder.draw_curve


@pytest.mark.parametrize(
    ("config", "copies", "device"),
    [
        (TrainConfig("WalkerSim-v0", num_envs=7, device="cuda"), 7, "cuda"),
        (TrainConfig("WalkerSim-v0", device="cuda"), 1, "cpu"),
        (TrainConfig("Walker-v0", num_envs=2, device="cuda"), 2, "cpu"),
        (TrainConfig("Walker-v0", device="cuda"), 1, "cpu"),
    ],
)
def test_only_copies_of_a_simulation_are_on_a_device(
    monkeypatch: pytest.MonkeyPatch, config: TrainConfig, copies: int, device: str
) -> None:
    asked: list[Any] = []
    monkeypatch.setattr(runs, "make", lambda *given, **named: asked.append((given, named)))
    place: Any = "by hand"
    runs._make_env(config, place)
    assert asked == [
        (
            (config.env, config.robot),
            {"copies": copies, "seed": config.seed, "device": device, "place": "by hand"},
        )
    ]


@pytest.mark.parametrize(
    ("options", "placed"), [({"robots": 2}, None), ({"hub": "ble:A,ble:B"}, "by hand")]
)
def test_virtual_robots_of_a_fleet_need_nobody_to_place_them(
    monkeypatch: pytest.MonkeyPatch, options: dict[str, Any], placed: str | None
) -> None:
    asked: list[Any] = []
    monkeypatch.setattr(runs, "make_fleet", lambda *given: asked.append(given))
    config = TrainConfig("RunAway-v0", **options)
    place: Any = "by hand"
    runs._make_env(config, place)
    assert asked == [(config, placed)]


@pytest.mark.parametrize(
    ("config", "updates_per_step", "is_beside"),
    [
        (TrainConfig("Walker-v0"), 1.0, False),
        (TrainConfig("Walker-v0", asynchronous=True), 1.0, True),
        (TrainConfig("Walker-v0", asynchronous=True), 0.0, False),
        (TrainConfig("Walker-v0", asynchronous=True, data="d", updates=40), 1.0, False),
    ],
)
def test_learner_is_beside_the_robot_where_it_would_keep_it_waiting(
    monkeypatch: pytest.MonkeyPatch, config: TrainConfig, updates_per_step: float, is_beside: bool
) -> None:
    done: list[Any] = []
    side = SimpleNamespace(wait_until_ready=lambda: done.append("ready"))
    monkeypatch.setattr(runs, "AsyncLearner", lambda *given: nullcontext(side))
    monkeypatch.setattr(runs, "InLoopLearner", lambda learner, state: ("in the loop", state))
    learner: Any = SimpleNamespace(
        updates_per_step=updates_per_step,
        load_state_dict=done.append,
        act_on=done.append,
    )
    env: Any = SimpleNamespace(device="the device")
    signals: Any = SimpleNamespace(at_once=nullcontext)
    state = {"agent": "the agent"}
    with ExitStack() as stack:
        found = runs._learning(stack, config, env, learner, state, signals)
    if is_beside:
        assert found is side and done == ["ready"]  # type: ignore[comparison-overlap]
    else:
        assert found == ("in the loop", state) and done == ["the agent", "the device"]


def test_fleet_takes_no_environment_and_no_driver(tmp_path: Path) -> None:
    config = TrainConfig("RunAway-v0", robots=2, run_dir=tmp_path / "run")
    driver: Any = print
    given: list[dict[str, Any]] = [{"env": Cart()}, {"driver": driver}]
    for options in given:
        with pytest.raises(RunError) as raised:
            train(config, **options)
        assert str(raised.value) == "a fleet takes no env and no driver; omit them"
    assert not (tmp_path / "run").exists()


def run_of(path: Path, config: TrainConfig) -> Path:
    path.mkdir(parents=True)
    RunFolder(path).write_config(config)
    return path


def test_run_is_resumed_for_as_many_episodes_or_more(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    asked: list[Any] = []
    monkeypatch.setattr(runs, "_run", lambda config, *given: asked.append((config, *given)))
    run = run_of(tmp_path / "run", TrainConfig("WalkerSim-v0", episodes=5))
    with pytest.raises(RunError) as raised:
        resume(run, episodes=4)
    assert str(raised.value) == (
        f"the run in {run} is meant to have 5 episodes; give that number or more, not 4"
    )
    for episodes in (None, 5, 9):
        resume(run, episodes=episodes)
    assert [config.episodes for config, *_ in asked] == [5, 5, 9]
    _, folder, *others = asked[0]
    assert folder.path == run and others == [None] * 5
    offline = TrainConfig("WalkerSim-v0", episodes=5, data="somewhere", updates=40)
    learned = run_of(tmp_path / "offline", offline)
    resume(learned, episodes=5)
    with pytest.raises(RunError) as raised:
        resume(learned, episodes=6)
    assert str(raised.value) == (
        f"the run in {learned} learned from data; `bricksrl train ENV --from RUN` goes on from it "
        "on a robot"
    )
    existing = TrainConfig("WalkerSim-v0", run_dir=run)
    with pytest.raises(RunError) as raised:
        train(existing)
    assert str(raised.value) == (f"{run} exists already; resume that run or choose another folder")


def test_own_copies_tell_their_returns_and_lengths() -> None:
    def copies(*keys: str) -> Any:
        spec = dict.fromkeys(keys)
        return SimpleNamespace(full_observation_spec=spec)

    runs._check_copies(copies("episode_reward", "step_count", "observation"))
    for lacking in (copies("episode_reward"), copies("step_count"), copies()):
        with pytest.raises(RunError) as raised:
            runs._check_copies(lacking)
        assert str(raised.value) == (
            "copies of your own need TorchRL's RewardSum and StepCounter; add them, or omit env "
            "and give num_envs"
        )


@pytest.mark.parametrize(
    ("name", "as_file"),
    [
        ("Walker-v0", "Walker-v0"),
        ("tasks/far.py:TASK", "far.py-TASK"),
        ("my task.py", "my-task.py"),
        ("package.module:NAME", "package.module-NAME"),
        (".hidden.", "hidden"),
    ],
)
def test_names_of_tasks_are_names_of_files(name: str, as_file: str) -> None:
    assert file_name(name) == as_file


EPISODES = [
    Episode(1, Phase.PREFILL, 10, 10, -1.5, None),
    Episode(
        2,
        Phase.TRAIN,
        30,
        20,
        2.25,
        True,
        {"error_mm": 3.5, "loss": 0.125},
        12.3456789,
        link_lost=True,
        updates_per_step=1.23456,
        evaluation=-4.0,
        robot="left",
    ),
    Episode(3, Phase.OFFLINE, 31, 1, 0.0, False, {"loss": 0.5}, 13.0),
]


def test_metrics_are_a_table_of_numbers(tmp_path: Path) -> None:
    folder = RunFolder(tmp_path)
    folder.write_episodes(EPISODES)
    header, *rows = folder.metrics_path.read_text(encoding="utf-8").splitlines()
    columns = header.split(",")
    table = [dict(zip(columns, row.split(","), strict=True)) for row in rows]
    assert table[0]["return"] == "-1.5" and table[0]["success"] == ""
    assert table[0]["error_mm"] == table[0]["evaluation"] == table[0]["updates_per_step"] == ""
    second = {
        "episode": "2",
        "phase": "train",
        "steps": "30",
        "length": "20",
        "return": "2.25",
        "success": "1",
        "error_mm": "3.5",
        "loss": "0.125",
        "seconds": "12.346",
        "link_lost": "1",
        "updates_per_step": "1.235",
        "evaluation": "-4.0",
        "robot": "left",
    }
    assert {name: table[1][name] for name in second} == second
    assert (table[2]["success"], table[2]["link_lost"]) == ("0", "0")
    read = folder.read_episodes()
    assert [one.success for one in read] == [None, True, False]
    assert [one.measures for one in read] == [{}, {"error_mm": 3.5, "loss": 0.125}, {"loss": 0.5}]
    assert read[0] == EPISODES[0]
    assert (read[1].seconds, read[1].updates_per_step) == (12.346, 1.235)
    assert (read[1].link_lost, read[1].evaluation, read[1].robot) == (True, -4.0, "left")


def test_episodes_are_appended_and_new_measures_get_a_column(tmp_path: Path) -> None:
    folder = RunFolder(tmp_path)
    folder.write_episodes([])
    for number, episode in enumerate(EPISODES, 1):
        folder.append(episode)
        assert len(folder.read_episodes()) == number
    assert [one.measures for one in folder.read_episodes()] == [
        {},
        {"error_mm": 3.5, "loss": 0.125},
        {"loss": 0.5},
    ]


def test_origin_of_a_run_is_that_of_its_first_robot(tmp_path: Path) -> None:
    config = TrainConfig(
        "RunAway-v0", "td3", seed=7, hub="ble:A,ble:B", name="Anna", asynchronous=False
    )
    folder = RunFolder(run_of(tmp_path / "run", config))
    assert folder.origin() == Origin("RunAway-v0", config.robot, "td3", 7, is_offline=False)
    assert folder.origin().options.hub == "ble:A"
    assert folder.trained_by() == "Anna"
    data = TrainConfig("RunAway-v0", data="somewhere", updates=40)
    assert RunFolder(run_of(tmp_path / "data", data)).origin().is_offline
    with pytest.raises(DescriptionError, match="run is 3; give"):
        RunFolder(3)  # type: ignore[arg-type]


def test_title_of_a_curve_names_the_run(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    drawn: list[Any] = []
    monkeypatch.setattr(
        "bricksrl.training.curve.draw_learning_curve", lambda *given: drawn.append(given)
    )
    folder = RunFolder(tmp_path)
    draw_curve(folder, TrainConfig("RunAway-v0", "td3", seed=7), EPISODES)
    draw_curve(folder, TrainConfig("WalkerSim-v0", options={"step_ms": 300}), [])
    first, second = drawn
    assert first[:3] == (folder.curve_path, EPISODES, "RunAway-v0 · td3 · seed 7")
    assert set(first[3]) == {"random", "by hand", "paper's SAC"}
    assert second[2:] == ("WalkerSim-v0 · sac · seed 0", {}), "of its options nothing is known"


def test_config_of_another_version_is_refused(tmp_path: Path) -> None:
    folder = RunFolder(run_of(tmp_path / "run", TrainConfig("RunAway-v0")))
    text = folder.config_path.read_text()
    assert text.endswith("}\n")
    folder.config_path.write_text(text.replace('"bricksrl_run": 1', '"bricksrl_run": 2'))
    with pytest.raises(RunError) as raised:
        folder.read_config()
    assert str(raised.value) == (
        f"{folder.config_path} is of another version of BricksRL; start a new run"
    )
