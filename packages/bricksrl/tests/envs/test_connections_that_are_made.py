"""How an environment is connected: what of its options goes to the body, the hub and the link."""

from __future__ import annotations

import importlib
from types import SimpleNamespace
from typing import Any

import pytest

import bricksrl
from brickhub.hub.link.profiles import PROFILES
from brickhub.hub.transport import Pipe
from bricksrl.envs.hub_policy import HubPolicy
from bricksrl.envs.make import has_arrays
from bricksrl.envs.options import EnvOptions
from bricksrl.envs.tasks.run_away import RUN_AWAY
from bricksrl.errors import DescriptionError, RunError
from bricktwin.twin.physics import Physics, RandomPhysics

making = importlib.import_module("bricksrl.envs.make")


class Made:
    """Notes of what was made with which arguments."""

    def __init__(self) -> None:
        self.calls: dict[str, list[Any]] = {}

    def of(self, name: str, result: Any = None) -> Any:
        """A function, which notes its arguments."""

        def make(*about: Any, **named: Any) -> Any:
            self.calls.setdefault(name, []).append((about, named))
            return (name, *about) if result is None else result

        return make


@pytest.fixture
def made(monkeypatch: pytest.MonkeyPatch) -> Made:
    made = Made()
    body = SimpleNamespace(pose="pose")
    reset, now_s = object(), object()
    twin = SimpleNamespace(reset=reset, now_s=now_s)
    monkeypatch.setattr(making, "make_body", made.of("body", body))
    monkeypatch.setattr("brickhub.virtual.faults.with_faults", made.of("faults", "faulty"))
    monkeypatch.setattr("brickhub.kits.virtual_kit.virtual_robot", made.of("twin", twin))
    monkeypatch.setattr(making, "_link", made.of("link", "link"))
    made.twin = twin  # type: ignore[attr-defined]
    return made


def test_virtual_robot_has_the_physics_link_and_faults_of_the_options(made: Made) -> None:
    physics = Physics(battery_v=7.1)
    options = EnvOptions(physics=physics, link="bad-room", realtime=True, fault=("battery=6.2",))
    task, connect = making._connected(RUN_AWAY, options, None)
    assert task is RUN_AWAY and made.calls == {}
    connection = connect(5)
    ((robot,), named) = made.calls["body"][0]
    assert robot is RUN_AWAY.robot
    assert named == {"scene": RUN_AWAY.scene, "physics": physics, "seed": 5}
    assert made.calls["faults"][0][0][1] == ("battery=6.2",)
    assert made.calls["twin"] == [
        (("faulty",), {"realtime": True, "link": PROFILES["bad-room"], "seed": 5})
    ]
    twin = made.twin  # type: ignore[attr-defined]
    assert (connection.link, connection.place, connection.twin) == ("link", twin.reset, twin)
    assert (connection.camera, connection.true_pose, connection.sensors) == (None, "pose", ())


def test_virtual_robot_is_drawn_anew_where_it_is_random_and_warns_once(made: Made) -> None:
    _, connect = making._connected(RUN_AWAY, EnvOptions(randomize=True), None)
    for seed in (1, 2):
        connect(seed)
    bodies = [named for _, named in made.calls["body"]]
    assert all(isinstance(named["physics"], RandomPhysics) for named in bodies)
    assert [named["seed"] for named in bodies] == [1, 2]
    assert [named["link"] for _, named in made.calls["twin"]] == [None, None]
    assert [named["warns"] for _, named in made.calls["link"]] == [True, False]
    plain = making._connected(RUN_AWAY, EnvOptions(), None)[1]
    plain(3)
    assert made.calls["body"][-1][1]["physics"] is None


@pytest.mark.parametrize(
    "option",
    [
        {"realtime": True},
        {"randomize": True},
        {"physics": Physics(battery_v=7.0)},
        {"link": "mac"},
        {"scene": "maze"},
        {"fault": ("battery=6.2",)},
    ],
)
def test_real_robot_has_no_option_of_a_virtual_one(option: dict[str, Any]) -> None:
    with pytest.raises(DescriptionError) as caught:
        making._connected(RUN_AWAY, EnvOptions(hub="ble", **option), None)
    assert str(caught.value) == (
        "a real robot has its own time, physics, link, surroundings and faults; omit realtime, "
        "physics, link, scene and fault"
    )


KINDS = {
    "lockstep.HubLink": "lock",
    "streaming.StreamingLink": "stream",
    "own_client.ClientLink": "client",
    "trial_link.TrialLink": "trial",
}


@pytest.fixture
def links(monkeypatch: pytest.MonkeyPatch) -> Made:
    made = Made()
    # One of them is made of another, and has to be so before that is replaced.
    for place in KINDS:
        importlib.import_module(f"brickhub.hub.link.{place.partition('.')[0]}")
    for place, name in KINDS.items():
        monkeypatch.setattr(f"brickhub.hub.link.{place}", made.of(name))
    monkeypatch.setattr("brickhub.kits.link.KitLink", made.of("kit"))
    return made


def task_of(**changes: Any) -> Any:
    """A task of which only the kind of its hub and program is known."""
    model = SimpleNamespace(runs_programs=changes.pop("runs_programs", True))
    robot = SimpleNamespace(hub=SimpleNamespace(model=model))
    known = {"robot": robot, "interface": "interface", "client": None, "streams": False}
    return SimpleNamespace(**{**known, "program": "mine.py", **changes})


POLICY = HubPolicy((), "source", 35.0, lambda: ([], None))


def test_links_are_those_of_the_hub_the_task_and_the_options(links: Made) -> None:
    for task, options, policy, kind, pipe in (
        (task_of(), EnvOptions(), None, "lock", Pipe.STDIN),
        (task_of(), EnvOptions(app_data=True), None, "lock", Pipe.APP_DATA),
        (task_of(), EnvOptions(streaming=True), None, "stream", Pipe.STDIN),
        (task_of(streams=True), EnvOptions(app_data=True), None, "stream", Pipe.APP_DATA),
        (task_of(streams=True), EnvOptions(), POLICY, "trial", Pipe.STDIN),
        (task_of(), EnvOptions(app_data=True), POLICY, "trial", Pipe.APP_DATA),
    ):
        link = making._link(task, options, "transport", "calibrate", policy)
        assert link[:4] == (kind, "transport", task.robot, "interface")
        named = links.calls[kind][-1][1]
        tilt = {"tilt_deg": 35.0} if policy else {}
        assert named == {"pipe": pipe, "calibrate": "calibrate", **tilt}
        assert link[4:] == (((), "source") if policy else ())


def test_own_client_and_kits_are_linked_without_pipes(links: Made) -> None:
    client = task_of(client="client")
    assert making._link(client, EnvOptions(), "transport", warns=False)[4:] == ("client",)
    assert links.calls["client"][0][1] == {"warns": False}
    assert making._link(client, EnvOptions(), "transport")[0] == "client"
    assert links.calls["client"][1][1] == {"warns": True}
    says = "mine.py is a client of your own, which neither streams nor reads AppData; omit both"
    for task, options in (
        (client, EnvOptions(streaming=True)),
        (client, EnvOptions(app_data=True)),
        (task_of(client="client", streams=True), EnvOptions()),
    ):
        with pytest.raises(DescriptionError) as caught:
            making._link(task, options, "transport")
        assert str(caught.value) == says
    kit = task_of(runs_programs=False)
    assert making._link(kit, EnvOptions(), "radio") == ("kit", "radio", kit.robot, "interface")
    for named in ({"streaming": True}, {"app_data": True}):
        with pytest.raises(DescriptionError) as caught:
            making._link(kit, EnvOptions(**named), "radio")
        says = "devices of LEGO's kits always stream; omit streaming and app_data"
        assert str(caught.value) == says


def test_robots_with_arrays_alone_are_known() -> None:
    assert has_arrays("RunAway-v0") and has_arrays("RunAway-v0", EnvOptions(hub="ble"))
    assert not has_arrays("WalkerSim-v0")
    assert not has_arrays("RunAway-v0", EnvOptions(frame_stack=2))


# ---------------------------------------------------------------- copies


class Processes:
    """Processes that are none."""

    error: type[Exception] | None = None

    def __init__(self, copies: int, make_one: Any, *, mp_start_method: str) -> None:
        self.copies = copies
        self.make_one = make_one
        self.method = mp_start_method
        self.started = 0
        self.task: Any = None

    def start(self) -> None:
        self.started += 1
        if self.error is not None:
            raise self.error


def test_each_core_has_eight_processes_at_most(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr("bricksrl.envs.env.Processes", Processes)
    monkeypatch.setattr(making.os, "cpu_count", lambda: 2)
    env = making._make_processes("RunAway-v0", EnvOptions(), 16, 3)
    assert (env.copies, env.method, env.started) == (16, "spawn", 1)
    assert env.task.id == "RunAway-v0"
    assert env.make_one.args == ("RunAway-v0", EnvOptions())
    assert env.make_one.keywords == {"seed": 3}
    with pytest.raises(RunError) as caught:
        making._make_processes("RunAway-v0", EnvOptions(), 17, 3)
    assert str(caught.value) == (
        "17 copies of RunAway-v0 are too many: each is a process, and this computer has 2 cores; "
        "give num_envs 16 or fewer"
    )
    monkeypatch.setattr(making.os, "cpu_count", lambda: None)
    assert making._make_processes("RunAway-v0", EnvOptions(), 8, 3).copies == 8


def test_script_without_a_main_part_is_told_to_have_one(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr("bricksrl.envs.env.Processes", Processes)
    monkeypatch.setattr(Processes, "error", EOFError)
    with pytest.raises(RunError) as caught:
        bricksrl.make("RunAway-v0", copies=2)
    assert str(caught.value) == (
        "the 2 processes cannot start; put your script under `if __name__ == '__main__':`"
    )


def test_simulation_that_is_made_again_keeps_what_it_was_made_with() -> None:
    from bricksrl.envs.task import Kinematics

    kinematics = Kinematics(0.3, "state")
    env: Any = bricksrl.make("WalkerSim-v0", batch_size=3, kinematics=kinematics, seed=1)
    again = env.remake(seed=2)
    assert again.batch_size == (3,) and again._kinematics == kinematics and again._seed == 2
    robot: Any = bricksrl.make("Walker-v0", step_ms=100, link="mac", seed=1)
    again = robot.remake(seed=2)
    assert again.task.interface.settle.fixed_ms == 100 and again._seed == 2
