"""What an export to a hub compares, writes and refuses, without playing or teaching."""

from __future__ import annotations

import json
from dataclasses import replace
from pathlib import Path
from types import SimpleNamespace
from typing import Any

import pytest

from brickhub.seed import episode_seed
from bricksrl.envs.registry import get_task
from bricksrl.errors import RunError
from bricksrl.policies import hub_export
from bricksrl.policies.hub_export import HubExport

TASK = get_task("RunAway-v0")
MEMORY_BYTES = TASK.robot.hub.model.program_bytes
LONGEST_MS = TASK.interface.settle.longest_ms


class Stage:
    """A policy with returns of 10, 20, ... over its link and of 1, 2, ... by itself."""

    def __init__(self, monkeypatch: pytest.MonkeyPatch, task: Any = TASK) -> None:
        self.task = task
        self.time_s = 0.0
        self.computing_ms = [3, 8, 5]
        self.heap_bytes = [100, 300, 200]
        self.blob_bytes = 1000
        self.asked: dict[str, Any] = {}
        self.seeds: list[int] = []
        self.written: dict[str, bytes] = {}
        self.single: Any = None
        self.actor: Any = None
        monkeypatch.setattr(hub_export, "interface_of", self.interface_of)
        monkeypatch.setattr(hub_export, "play_episodes", self.play_episodes)
        monkeypatch.setattr(hub_export, "hub_structure", lambda actor: self.single)
        monkeypatch.setattr(hub_export, "source_by", lambda *given: ("source by", *given))
        monkeypatch.setattr(hub_export, "HubNetwork", self.network)
        monkeypatch.setattr(hub_export, "distil", self.distil)
        monkeypatch.setattr(hub_export, "generate_alone", self.generate)
        monkeypatch.setattr(hub_export, "compile_program", lambda program: "compiled")
        monkeypatch.setattr(hub_export, "program_blob", lambda *given: bytes(self.blob_bytes))
        monkeypatch.setattr(hub_export, "play_as_env", self.play_as_env)
        monkeypatch.setattr(hub_export, "write_durably", self.write)

    def interface_of(self, _env: Any) -> Any:
        self.time_s += 0.31
        return SimpleNamespace(task=self.task, episode=SimpleNamespace(hub_time_s=self.time_s))

    def play_episodes(
        self, env: Any, policy: Any, episodes: int, seed: int, *, reset_policy: Any
    ) -> Any:
        self.asked["played"] = (env, episodes, seed, reset_policy)
        for number in range(1, episodes + 1):
            assert policy("a state") == ("acted on", "a state")
            yield SimpleNamespace(return_=10.0 * number)

    def network(self, *given: Any) -> Any:
        self.asked["network"] = given
        return SimpleNamespace(hub_source=lambda: "source of a network")

    def distil(self, *given: Any) -> None:
        self.asked["distilled"] = given

    def generate(self, *given: Any) -> Any:
        self.asked["generated"] = given
        return SimpleNamespace(source="the program")

    def play_as_env(self, source: str, task: Any, physics: Any, seed: int) -> Any:
        assert (source, task, physics) == ("the program", self.task, "the physics")
        number = len(self.seeds)
        self.seeds.append(seed)
        return SimpleNamespace(
            computing_ms=self.computing_ms[number],
            heap_bytes=self.heap_bytes[number],
            return_=float(number + 1),
        )

    def write(self, path: Path, data: bytes) -> None:
        self.written[path.name] = data

    def export(self) -> HubExport:
        policy: Any = Policy()
        physics: Any = "the physics"
        return hub_export._export("the env", policy, self.actor, Path("away.py"), physics, (4,), 3)


class Policy:
    """A policy that says what it acts on."""

    def __call__(self, state: Any) -> Any:
        return ("acted on", state)

    def reset(self) -> None:
        """It remembers nothing."""


def test_policy_is_compared_with_its_program(monkeypatch: pytest.MonkeyPatch) -> None:
    """A step over the link takes 310 ms, 60 more than its commands last."""
    settle = TASK.interface.settle
    stage = Stage(monkeypatch)
    made = stage.export()
    age_ms = 0 if settle.fixed_ms is None else 310 - settle.fixed_ms
    assert made == HubExport("network", age_ms, 1000, 300, 8, 20.0, 2.0)
    env, episodes, seed, _ = stage.asked["played"]
    assert (env, episodes) == ("the env", 3)
    assert stage.seeds == [episode_seed("evaluation", seed, number) for number in (1, 2, 3)]
    assert stage.written["away.py"] == b"the program"


def test_program_is_of_the_task_and_its_network(monkeypatch: pytest.MonkeyPatch) -> None:
    stage = Stage(monkeypatch)
    made = stage.export()
    observed, size, hidden = stage.asked["network"]
    assert [entry.name for entry in observed] == [
        TASK.entries[index].name for index in TASK.observed_channels
    ]
    assert (size, hidden) == (1, (4,))
    env, _, network, seed = stage.asked["distilled"]
    assert (env, seed) == ("the env", stage.asked["played"][2])
    assert network.hub_source() == "source of a network"
    assert stage.asked["generated"] == (
        TASK.robot,
        TASK.interface,
        TASK.observed_channels,
        "source of a network",
        "a network that learned RunAway-v0",
        made.age_ms,
        None,
        "away",
        None,
    )
    world = stage.written["away.json"]
    assert world.endswith(b"}\n") and json.loads(world), "its world lies beside it"


def test_gait_is_written_as_it_is(monkeypatch: pytest.MonkeyPatch) -> None:
    task = replace(get_task("Walker-v1"), scene=hub_export.OPEN_FLOOR)
    stage = Stage(monkeypatch, task)
    stage.single = "the structure"
    stage.actor = SimpleNamespace(best=SimpleNamespace(tolist=lambda: [0.5, 90.0]))
    assert stage.export().kind == "gait"
    generated = stage.asked["generated"]
    assert generated[3] == ("source by", "the structure", [0.5, 90.0])
    assert generated[4] == "a gait that learned Walker-v1" and generated[7] == ""
    assert "distilled" not in stage.asked
    assert list(stage.written) == ["away.py"], "an open floor is the usual world"


@pytest.mark.parametrize("beyond", [0, 1])
def test_program_computes_within_a_step(monkeypatch: pytest.MonkeyPatch, beyond: int) -> None:
    stage = Stage(monkeypatch)
    stage.computing_ms = [1, LONGEST_MS + beyond, 2]
    if not beyond:
        assert stage.export().computing_ms == LONGEST_MS
        return
    with pytest.raises(RunError) as raised:
        stage.export()
    assert str(raised.value) == (
        f"the program computes for {LONGEST_MS + 1} ms, and a step of RunAway-v0 takes "
        f"{LONGEST_MS} ms; give fewer hidden units, such as export_program(..., hidden=(8, 8))"
    )
    assert stage.written == {}


@pytest.mark.parametrize("beyond", [0, 1])
def test_program_fits_into_the_hub_with_its_objects(
    monkeypatch: pytest.MonkeyPatch, beyond: int
) -> None:
    stage = Stage(monkeypatch)
    stage.blob_bytes = MEMORY_BYTES - 300 + beyond
    if not beyond:
        assert stage.export().program_bytes == MEMORY_BYTES - 300
        return
    with pytest.raises(RunError) as raised:
        stage.export()
    assert str(raised.value) == (
        f"the program and its objects need {MEMORY_BYTES + 1} bytes; give fewer hidden units, such "
        "as export_program(..., hidden=(8, 8))"
    )
    assert stage.written == {}


@pytest.mark.parametrize("taken", ["walk.py", "walk.json"])
def test_neither_the_program_nor_its_world_is_overwritten(tmp_path: Path, taken: str) -> None:
    (tmp_path / taken).touch()
    with pytest.raises(RunError, match=f"{taken} exists already"):
        hub_export.export_own("RunAway-v0", tmp_path / "walk.py")
