"""Several seeds of one command: which runs they are, how many run at a time, and what a failure
says; without training."""

from __future__ import annotations

import json
import sys
import threading
from collections.abc import Callable
from pathlib import Path
from types import SimpleNamespace
from typing import Any

import pytest
from test_comparison import write_run

from bricksrl.errors import DescriptionError, RunError
from bricksrl.evaluation import multi_seed
from bricksrl.evaluation.multi_seed import (
    Reporter,
    map_on_cluster,
    parse_on,
    train_and_evaluate,
    train_seeds,
)
from bricksrl.training import Episode, Phase, RunFolder, TrainConfig


class Trained:
    """Runs that were asked for, which get returns by their seed, or fail."""

    def __init__(self, errors: dict[int, str]) -> None:
        self.errors = errors
        self.configs: list[TrainConfig] = []
        self.jobs: list[int | None] = []

    def __call__(self, configs: Any, jobs: int | None, on_line: Any) -> list[str | None]:
        self.jobs.append(jobs)
        for config in configs:
            self.configs.append(config)
            if config.seed not in self.errors:
                write_run(config.run_dir, config, [float(config.seed)], 2.0 * config.seed)
                on_line(config.seed, {"evaluated": 2.0 * config.seed})
        return [self.errors.get(config.seed) for config in configs]


def trained(monkeypatch: pytest.MonkeyPatch, errors: dict[int, str] | None = None) -> Trained:
    runs = Trained(errors or {})
    monkeypatch.setattr(multi_seed, "_train_in_processes", runs)
    return runs


def test_each_seed_has_a_folder_and_all_are_summed_up(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    runs = trained(monkeypatch)
    told: list[Any] = []
    config = TrainConfig("WalkerSim-v0", seed=5, run_dir=tmp_path / "all")
    group = train_seeds(config, 3, jobs=2, on_line=lambda *line: told.append(line))
    folders = {5: "seed-5", 6: "seed-6", 7: "seed-7"}
    assert {run.seed: run.run_dir.name for run in runs.configs if run.run_dir} == folders
    assert runs.jobs == [2]
    assert told == [(seed, {"evaluated": 2.0 * seed}) for seed in (5, 6, 7)]
    assert (group.seeds, group.scores) == ((5, 6, 7), (10.0, 12.0, 14.0))
    summary = (tmp_path / "all" / "summary.json").read_text()
    assert summary.endswith("}\n")
    assert json.loads(summary)["groups"][0]["seeds"] == [5, 6, 7]
    assert (tmp_path / "all" / "learning_curves.png").stat().st_size > 1000


@pytest.mark.parametrize(
    ("errors", "message"),
    [
        ({6: "no room"}, "1 of 3 seeds failed; seed 6: no room"),
        ({7: "no room", 5: "no light"}, "2 of 3 seeds failed; seed 5: no light"),
    ],
)
def test_first_failure_is_told_with_their_number(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, errors: dict[int, str], message: str
) -> None:
    trained(monkeypatch, errors)
    with pytest.raises(RunError) as raised:
        train_seeds(TrainConfig("WalkerSim-v0", seed=5, run_dir=tmp_path / "all"), 3)
    assert str(raised.value) == message
    assert (tmp_path / "all").exists(), "what the others learned is kept"
    assert not (tmp_path / "all" / "summary.json").exists()


def test_what_is_no_sweep_is_refused(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    runs = trained(monkeypatch)
    last = 2**32 - 1
    config = TrainConfig("WalkerSim-v0", seed=last, run_dir=tmp_path / "all")
    with pytest.raises(DescriptionError, match="seed"):
        train_seeds(config, 2)
    with pytest.raises(RunError) as raised:
        train_seeds(TrainConfig("Walker-v0", hub="ble", run_dir=tmp_path / "all"), 2)
    assert str(raised.value) == (
        "there is one robot and several seeds want it at once; train them one after the other "
        "with --seed"
    )
    assert not runs.configs and not (tmp_path / "all").exists()


def test_sweep_that_is_broken_off_leaves_no_empty_folder(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    def interrupt(*_: Any) -> None:
        raise KeyboardInterrupt

    monkeypatch.setattr(multi_seed, "_train_in_processes", interrupt)
    with pytest.raises(KeyboardInterrupt):
        train_seeds(TrainConfig("WalkerSim-v0", run_dir=tmp_path / "all"), 2)
    assert not (tmp_path / "all").exists()


def test_cluster_is_asked_where_it_was_named(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    asked: list[Any] = []
    runs = Trained({})

    def on_cluster(address: Any, *given: Any) -> list[str | None]:
        asked.append(address)
        return runs(*given)

    monkeypatch.setattr(multi_seed, "train_on_cluster", on_cluster)
    for number, on in enumerate(("ray", "ray:10.0.0.1:6379")):
        run_dir = tmp_path / str(number)
        train_seeds(TrainConfig("WalkerSim-v0", run_dir=run_dir), 2, jobs=3, on=on)
    assert asked == [None, "10.0.0.1:6379"] and runs.jobs == [3, 3]


@pytest.mark.parametrize("text", ["slurm", "ray:", "", "rays:here"])
def test_other_places_are_none(text: str) -> None:
    with pytest.raises(RunError) as raised:
        parse_on(text)
    assert str(raised.value) == (
        f"there is no '{text}' to run on; choose ray, or ray:ADDRESS for a cluster that is there"
    )


class Child:
    """A process of a seed, which ends when it is told to."""

    running: list[Child]

    def __init__(self, module: str, deliver: Callable[[Any], None], **variables: str) -> None:
        assert module == "bricksrl.evaluation.multi_seed"
        assert variables == {"OMP_NUM_THREADS": "1", "MKL_NUM_THREADS": "1"}
        self.deliver = deliver
        self.sent: list[Any] = []
        self.timeouts_s: list[float] = []
        Child.running.append(self)

    def send(self, kind: str, content: Any) -> None:
        self.sent.append((kind, content))
        if kind == "train":
            seed = content[0]["seed"]
            self.deliver(("report", {"episode": 1, "return": float(seed)}))
            if seed == 2:
                self.deliver(("report", {"error": "no light"}))
            if seed < 9:
                self.deliver(None)

    def end(self, timeout_s: float) -> int:
        self.timeouts_s.append(timeout_s)
        Child.running.remove(self)
        return {1: 0, 2: 1, 3: 7}.get(self.sent[0][1][0]["seed"], 0)


@pytest.fixture
def children(monkeypatch: pytest.MonkeyPatch) -> None:
    Child.running = []
    monkeypatch.setattr(multi_seed, "ChildProcess", Child)


@pytest.mark.usefixtures("children")
@pytest.mark.parametrize("jobs", [1, 2, 3, 9])
def test_as_many_processes_run_at_a_time_as_were_asked_for(tmp_path: Path, jobs: int) -> None:
    configs = [TrainConfig("WalkerSim-v0", seed=seed, run_dir=tmp_path) for seed in (1, 2, 3, 4)]
    most: list[int] = []
    told: list[Any] = []

    def on_line(seed: int, message: dict[str, Any]) -> None:
        most.append(len(Child.running))
        told.append((seed, message))

    errors = multi_seed._train_in_processes(configs, jobs, on_line)
    assert errors == [None, "no light", "its process ended with exit code 7", None]
    assert max(most) == min(jobs, 4)
    episodes = [seed for seed, message in told if "episode" in message]
    assert sorted(episodes) == [1, 2, 3, 4]
    assert (2, {"error": "no light"}) in told


@pytest.mark.usefixtures("children")
def test_all_processes_are_asked_to_end_after_an_error(tmp_path: Path) -> None:
    configs = [TrainConfig("WalkerSim-v0", seed=seed, run_dir=tmp_path) for seed in (9, 10)]
    started: list[Child] = []

    def on_line(*_: Any) -> None:
        started.extend(Child.running)
        raise KeyboardInterrupt

    with pytest.raises(KeyboardInterrupt):
        multi_seed._train_in_processes(configs, 2, on_line)
    assert len(started) == 2
    for child in started:
        assert child.sent[-1] == ("end", None)
        assert 5.0 <= child.timeouts_s[0] <= 30.0, "somebody waits for the prompt"


def test_run_is_resumed_where_it_has_a_checkpoint(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    asked: list[Any] = []
    result = SimpleNamespace(interrupted=False)

    def train(config: TrainConfig, reporter: Any, *, stop: Any) -> Any:
        asked.append(("train", config.seed, config.run_dir, stop))
        return result

    def resume(run_dir: Path, reporter: Any, *, stop: Any) -> Any:
        asked.append(("resume", run_dir, stop))
        return result

    monkeypatch.setattr("bricksrl.training.run.train", train)
    monkeypatch.setattr("bricksrl.training.run.resume", resume)
    evaluated = SimpleNamespace(return_mean=2.5)
    monkeypatch.setattr("bricksrl.evaluation.evaluator.evaluate", lambda run_dir: evaluated)
    sent: list[Any] = []
    reporter = Reporter(sent.append)
    config = TrainConfig("WalkerSim-v0", seed=3).to_dict()
    stop = threading.Event()
    assert train_and_evaluate(config, tmp_path, reporter, stop) is None
    RunFolder(tmp_path).checkpoint_path.touch()
    assert train_and_evaluate(config, tmp_path, reporter) is None
    assert asked == [("train", 3, tmp_path, stop), ("resume", tmp_path, None)]
    assert sent == [{"evaluated": 2.5}] * 2
    result.interrupted = True
    with pytest.raises(KeyboardInterrupt):
        train_and_evaluate(config, tmp_path, reporter)
    assert len(sent) == 2, "what is not finished is not evaluated"


def test_failure_of_a_run_is_a_line_and_a_fault_of_ours_is_raised(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    errors: list[Exception] = [RunError("no light"), ZeroDivisionError("ours")]

    def train(*_: Any, **__: Any) -> None:
        raise errors[0]

    monkeypatch.setattr("bricksrl.training.run.train", train)
    monkeypatch.setattr(multi_seed, "failure_of_user", lambda error: None)
    config = TrainConfig("WalkerSim-v0").to_dict()
    reporter = Reporter(print)
    assert train_and_evaluate(config, tmp_path / "run", reporter) == "no light"
    del errors[0]
    with pytest.raises(ZeroDivisionError):
        train_and_evaluate(config, tmp_path / "run", reporter)
    monkeypatch.setattr(multi_seed, "failure_of_user", lambda error: "line 3 of yours")
    assert train_and_evaluate(config, tmp_path / "run", reporter) == "line 3 of yours"


def test_reporter_sends_each_episode() -> None:
    sent: list[Any] = []
    episode = Episode(3, Phase.TRAIN, 30, 10, -1.5, None)
    Reporter(sent.append).on_episode(episode, None)  # type: ignore[arg-type]
    assert sent == [{"episode": 3, "return": -1.5}]


def test_function_is_mapped_in_order_with_a_core_each() -> None:
    asked: list[Any] = []

    def options(**named: Any) -> Any:
        asked.append(named)
        return SimpleNamespace(remote=lambda *order: order)

    ray = SimpleNamespace(remote=lambda function: SimpleNamespace(options=options), get=sum)
    assert list(map_on_cluster(ray, sum, [(1, 2), (3, 4)])) == [3, 7]
    assert asked == [{"num_cpus": 1, "max_retries": 3}]


class Ray:
    """The module of a cluster that notes how it was started."""

    def __init__(self) -> None:
        self.is_running = False
        self.error: Exception | None = None
        self.started: list[dict[str, Any]] = []
        self.done: list[str] = []

    def is_initialized(self) -> bool:
        return self.is_running

    def init(self, **options: Any) -> None:
        self.started.append(options)
        if self.error is not None:
            raise self.error

    def shutdown(self) -> None:
        self.done.append("shutdown")


@pytest.fixture
def ray(monkeypatch: pytest.MonkeyPatch) -> Ray:
    module: Any = Ray()
    monkeypatch.setitem(sys.modules, "ray", module)
    monkeypatch.setenv("RAY_ACCEL_ENV_VAR_OVERRIDE_ON_ZERO", "0")
    return module


USUAL = {
    "log_to_driver": False,
    "logging_level": "ERROR",
    "runtime_env": {
        "env_vars": {
            "OMP_NUM_THREADS": "1",
            "MKL_NUM_THREADS": "1",
            "RAY_ACCEL_ENV_VAR_OVERRIDE_ON_ZERO": "0",
        }
    },
}
"""A run is one process with one thread, and prints nothing."""


def test_local_cluster_stays_on_this_computer(ray: Ray, monkeypatch: pytest.MonkeyPatch) -> None:
    for cores, cpus, count in ((8, None, 8), (None, None, 1), (8, 3, 3)):
        monkeypatch.setattr(multi_seed.os, "cpu_count", lambda cores=cores: cores)
        with multi_seed.connected(None, cpus) as module:
            assert module is ray
        options = dict(ray.started[-1])
        assert options.pop("object_store_memory") >= 10**7
        assert options == USUAL | {
            "num_cpus": count,
            "num_gpus": 0,
            "include_dashboard": False,
            "_node_ip_address": "127.0.0.1",
        }
    assert ray.done == ["shutdown"] * 3


def test_cluster_that_is_there_is_only_joined(ray: Ray) -> None:
    with pytest.raises(KeyboardInterrupt), multi_seed.connected("10.0.0.1:6379", 3):
        raise KeyboardInterrupt
    assert ray.started == [USUAL | {"address": "10.0.0.1:6379"}]
    assert ray.done == ["shutdown"], "however it ends"


@pytest.mark.parametrize(
    ("address", "cluster"), [(None, "a cluster here"), ("there", "the cluster at there")]
)
def test_cluster_that_does_not_answer_is_told(ray: Ray, address: str | None, cluster: str) -> None:
    ray.error = ConnectionError("nobody is there")
    with pytest.raises(RunError) as raised, multi_seed.connected(address):
        raise AssertionError("it is not connected")
    assert str(raised.value) == (
        f"{cluster} does not start or answer (nobody is there); see `ray status`"
    )
    ray.error = None
    ray.is_running = True
    with pytest.raises(RunError) as raised, multi_seed.connected(address):
        raise AssertionError("it is not connected")
    assert str(raised.value) == "Ray is at work in this process already; shut it down first"
    assert ray.done == []
