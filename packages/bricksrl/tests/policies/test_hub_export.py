"""Policies as programs: they act as they did, compute in time, and stop with the center button."""

from __future__ import annotations

import io
import json
import math
from dataclasses import asdict, replace
from pathlib import Path
from typing import Any

import pytest
import torch
from hub_programs import output

from brickhub.entry import Entry
from brickhub.hub.interface import Interface, MotorAngle, RunAngle, Wait
from brickhub.hub.program.generate import generate_alone
from brickhub.robot import HubKind, Motor, Robot
from brickhub.search.structure import source_by
from brickhub.virtual.machine import Machine
from brickhub.virtual.panel import parse_press
from brickhub.virtual.run import Operation, run_file
from bricksrl.agents.sac import SACSettings
from bricksrl.agents.search.structures import make_oscillators
from bricksrl.cli import main
from bricksrl.envs import Task, make, register
from bricksrl.envs.host_sensors.host_sensor import HostSensor
from bricksrl.envs.odometry import TargetTracker, floor_pose
from bricksrl.envs.registry import _specs, get_task
from bricksrl.errors import RunError
from bricksrl.policies import hub_export, hub_network, load_policy
from bricksrl.policies.hub_export import export_program
from bricksrl.policies.hub_network import HubNetwork
from bricksrl.training import TrainConfig, train
from bricktwin.robots import WALKER
from bricktwin.site.tab.plain_values import read_plain
from bricktwin.twin.make_body import make_body
from bricktwin.twin.physics import Physics

OBSERVED = [
    [10.0, 200.0, 359.5, 90.0, 3.0, -4.0, 812.0],
    [0.0, 0.0, 180.0, 270.25, -30.0, 2.5, 2000.0],
]


def acted(source: str, observed: list[list[float]]) -> torch.Tensor:
    """Actions of a program's ``act`` on a virtual hub."""
    printed = output(source + "".join(f"\nprint(*act({numbers}))" for numbers in observed))
    return torch.tensor([[float(word) for word in line.split()] for line in printed.splitlines()])


def test_a_gait_acts_on_the_hub_as_here() -> None:
    structure = make_oscillators(make("WalkerSim-v0", seed=0))
    numbers = torch.tensor([-0.6, 140.0])
    here = structure(torch.tensor(OBSERVED), numbers.expand(2, 2)).clamp(-1.0, 1.0)
    source = source_by(structure.single, numbers.tolist())
    assert torch.allclose(acted(source, OBSERVED), here, atol=2e-4)


def test_a_network_acts_on_the_hub_as_here() -> None:
    torch.manual_seed(0)
    task = get_task("Walker-v1")
    network = HubNetwork(task.entries[:7], 4)
    network.round()
    with torch.no_grad():
        here = network(torch.tensor([[*row, 0.0] for row in OBSERVED]))
    assert torch.allclose(acted(network.hub_source(), OBSERVED), here, atol=2e-4)


def test_a_network_on_the_hub_sees_angles_as_directions_and_lengths_in_their_range() -> None:
    torch.manual_seed(0)
    angles = [Entry("left", 0.0, 360.0, "deg", wraps=True), Entry("right", wraps=True)]
    network = HubNetwork([angles[0], Entry("way", -50.0, 150.0, "mm"), angles[1]], 2)
    # The way; sine and cosine of each angle and of their difference.
    assert network.layers[0].in_features == 1 + 2 * 3
    features = list[torch.Tensor]()
    network.layers[0].register_forward_pre_hook(lambda _, inputs: features.append(inputs[0]))
    with torch.no_grad():
        acted_on = network(torch.tensor([[30.0, 100.0, 270.0], [390.0, 100.0, -90.0]]))
    assert torch.allclose(acted_on[0], acted_on[1], atol=1e-5), "a whole turn changes nothing"
    radians = [math.radians(degrees) for degrees in (30.0, 270.0, -240.0)]
    wanted = [0.5, *map(math.sin, radians), *map(math.cos, radians)]
    assert features[0][0].tolist() == pytest.approx(wanted, abs=1e-5)
    assert network(torch.full((4, 3), 1e4)).abs().max() <= 1.0


def test_a_network_on_the_hub_is_held_within_what_it_was_taught_on() -> None:
    """As a simulation's distance is always 0, and a hub's on an open floor 2000."""
    torch.manual_seed(0)
    network = HubNetwork(get_task("Walker-v1").entries[:7], 4)
    network.round()
    taught = torch.zeros(1, 7)
    network.hold(taught)
    seen = torch.tensor([0.0, 0.0, 0.0, 0.0, 12.0, -9.0, 2000.0])
    with torch.no_grad():
        wanted = network(taught)
        assert torch.equal(network(seen[None]), wanted)
    assert torch.allclose(acted(network.hub_source(), [seen.tolist()]), wanted, atol=2e-4)


def test_a_policy_with_transforms_is_taught_by_what_the_robot_observes(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    (tmp_path / "halved.py").write_text(
        "from torchrl.envs import ObservationNorm\n"
        "HALVED = ObservationNorm(loc=0.0, scale=0.5, in_keys=['observation'])\n"
    )
    options = {
        "transform": f"{tmp_path / 'halved.py'}:HALVED",
        "settings": SACSettings(hidden=(8,), prefill_episodes=1),
    }
    train(
        TrainConfig("WalkerSim-v0", episodes=1, record=False, run_dir=tmp_path / "run", **options)
    )
    seen: list[float] = []

    def distil(env: Any, policy: Any, network: HubNetwork, _seed: int) -> None:
        frames = env.rollout(30, policy)
        seen.append(float(frames["observation"][:, :4].max()))
        network.hold(frames["observation"])

    monkeypatch.setattr(hub_export, "distil", distil)
    monkeypatch.setattr(hub_export, "EPISODES", 1)
    export_program(tmp_path / "run", tmp_path / "walk.py", hidden=(4,))
    assert 180.0 < seen[0] < 360.0, "angles as the hub counts them, not halved"


def test_products_of_floats_take_time_on_the_virtual_hub() -> None:
    program = (
        "from pybricks.tools import StopWatch\nwatch = StopWatch()\ntotal = 0.0\n"
        "for _ in range({}):\n    total += {} * 3\nprint(watch.time())"
    )
    city = Robot("city", HubKind.CITY)
    assert output(program.format(10_000, "1.5")) == "119"  # 84 products before each ms that passes
    assert output(program.format(10_000, "1.5"), robot=city) == "294"
    assert output(program.format(10_000, "2")) == "0"
    assert output(program.format(80, "1.5")) == "0"


@pytest.fixture(scope="module")
def gait(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """A run of one episode of policy search."""
    folder = tmp_path_factory.mktemp("gait") / "run"
    train(TrainConfig("Walker-v1", "gait", episodes=1, record=False, run_dir=folder))
    return folder


@pytest.fixture
def quick(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(hub_export, "EPISODES", 1)
    for name in ("ROUNDS", "STEPS", "UPDATES"):
        monkeypatch.setattr(hub_network, name, 1)


@pytest.mark.usefixtures("quick")
def test_a_gait_is_exported_walks_alone_and_stops_with_the_button(
    gait: Path, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    path = tmp_path / "walk.py"
    assert main(["export", str(gait), "--format", "hub", "--out", str(path)]) == 0
    said = capsys.readouterr().out
    assert f"written  {path}  (a gait: " in said
    assert "on the virtual hub" in said
    body, out, err = make_body(WALKER, seed=0), io.BytesIO(), io.StringIO()
    operation = Operation(presses=[parse_press("center@2.1s")])
    assert run_file(path, body, stdout=out, stderr=err, time_limit_s=5.0, operation=operation) == 0
    assert "SystemExit" in err.getvalue()
    lines = out.getvalue().decode().splitlines()
    assert len(lines) == 7, "steps as long as over the link"
    assert all(len(line.split()) == 1 + 7 + 4 for line in lines)
    assert all(-1000 <= int(word) <= 0 for line in lines for word in line.split()[8:])


@pytest.mark.usefixtures("quick")
def test_what_the_hub_walks_alone_is_worth_what_the_policy_is(gait: Path, tmp_path: Path) -> None:
    made = export_program(gait, tmp_path / "walk.py")
    assert made.kind == "gait"
    assert 50 <= made.age_ms <= 80, "what an exchange over the link takes"
    assert made.hub_return == pytest.approx(made.policy_return, rel=0.05)
    assert made.program_bytes + made.heap_bytes < 8192


@pytest.mark.usefixtures("quick")
def test_any_agent_becomes_a_network_with_the_distance(tmp_path: Path) -> None:
    train(TrainConfig("RunAway-v0", "random", episodes=1, record=False, run_dir=tmp_path / "run"))
    made = export_program(tmp_path / "run", tmp_path / "away.py")
    assert made.kind == "network"
    assert 1 <= made.computing_ms <= 8
    assert "sensor_eyes.distance()" in (tmp_path / "away.py").read_text()


@pytest.mark.usefixtures("quick")
def test_a_program_that_computes_too_long_is_refused(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(Machine, "charge_product", lambda machine: machine.advance(1))
    register(replace(get_task("Walker-v1"), id="Short-v1", max_steps=4))
    train(TrainConfig("Short-v1", "random", episodes=1, record=False, run_dir=tmp_path / "run"))
    with pytest.raises(
        RunError,
        match=r"computes for \d+ ms, and a step of Short-v1 takes 250 ms; give fewer hidden units",
    ):
        export_program(tmp_path / "run", tmp_path / "walk.py")
    assert not (tmp_path / "walk.py").exists()


@pytest.mark.usefixtures("quick")
def test_a_program_that_does_not_fit_is_refused(
    gait: Path, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(hub_export, "program_blob", lambda *_: bytes(300_000))
    with pytest.raises(RunError, match="the program and its objects need"):
        export_program(gait, tmp_path / "walk.py")


@pytest.fixture
def turning(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    """Two motors of a robot without a plan turn; the reward is the last command of the first."""
    motors = tuple(Motor(name, port) for name, port in (("left", "A"), ("right", "B")))
    turns = tuple(RunAngle(name, 50, 100, speed_deg_s=600) for name in ("left", "right"))
    task = Task(
        id="Turning-v0",
        doc="Turn.",
        robot=Robot("turning", HubKind.CITY, motors=motors),
        interface=Interface(turns, (MotorAngle("left"), MotorAngle("right")), Wait(250)),
        max_steps=10,
        reward=lambda previous, action, observation: observation[..., -2:-1],
        success=lambda observations: observations[..., 0, 0] > 0,
        metrics=lambda observations: {},
        measured_entries=(Entry("forward", -100.0, 100.0, "mm"),),
        observes_commands=True,
        walks=True,
    )
    monkeypatch.setattr("bricksrl.envs.registry._specs", dict(_specs))
    register(task)
    train(TrainConfig("Turning-v0", "random", episodes=1, record=False, run_dir=tmp_path / "run"))


@pytest.mark.usefixtures("quick", "turning")
def test_rewards_on_the_hub_see_what_the_task_observes(tmp_path: Path) -> None:
    made = export_program(tmp_path / "run", tmp_path / "turn.py")
    assert 500.0 <= made.hub_return <= 1000.0


@pytest.mark.usefixtures("quick", "turning")
def test_an_export_tries_a_real_run_on_the_twin_of_its_world(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    file, physics = tmp_path / "run" / "config.json", Physics(battery_v=7.0)
    about = json.loads(file.read_text())
    about["config"] |= {"hub": "ble:nobody", "physics": asdict(physics)}
    file.write_text(json.dumps(about))
    made: list[Any] = []

    def spy(*args: Any, **kwargs: Any) -> Any:
        made.append(kwargs["physics"])
        return make_body(*args, **kwargs)

    monkeypatch.setattr(hub_export, "make_body", spy)
    export_program(tmp_path / "run", tmp_path / "turn.py")
    assert made == [physics], "the policy's world"


@pytest.mark.usefixtures("turning")
def test_what_this_computer_senses_is_refused(tmp_path: Path) -> None:
    sensor = HostSensor(
        "light", (Entry("lux", 0.0, 10.0),), open=lambda: None, twin=lambda world: [1.0]
    )
    register(replace(get_task("Turning-v0"), sensors=(sensor,)))
    with pytest.raises(RunError, match="nothing that this computer senses"):
        export_program(tmp_path / "run", tmp_path / "turn.py")


def test_a_hub_reckons_the_place_to_reach_from_where_it_is_put() -> None:
    task = replace(get_task("Park-v0"), max_steps=20)
    policy = "def act(observed):\n    return [0.4, 0.3 if observed[2] < -200 else -0.3]\n"
    program = generate_alone(
        task.robot,
        task.interface,
        task.observed_channels,
        policy,
        "a policy",
        0,
        place=hub_export.place_of(task),
    )
    starts = []
    for seed in range(2):
        played = hub_export.play_as_env(program.source, task, None, seed)
        observed, _ = played.seen
        truth = TargetTracker(
            task.target,
            task.robot,
            task.interface,
            played.machine.body.pose,
            floor_pose(played.machine.body.pose()),
            [0.0, 0.0],
        ).truth()
        # After 0.8 m of driving, as wheels slip.
        assert observed[2:4].tolist() == pytest.approx(truth[:2], abs=15.0)
        assert float(observed[4]) == pytest.approx(truth[2], abs=6.0)
        assert observed[:2].abs().tolist() == pytest.approx([40.0, 18.0], abs=1.0)
        starts.append(played.return_)
    assert starts[0] != starts[1], "each is told where it was put"


def test_a_program_is_tried_with_the_goals_of_its_policy() -> None:
    task = get_task("Spinning-v0")
    goals = []
    env = make("Spinning-v0", seed=0)
    for seed in (3, 4, 5):
        env.set_seed(seed)
        goals.append(float(env.reset()["observation"][5]))
    env.close()
    policy = "def act(observed):\n    return [0.0, 0.0]\n"
    program = generate_alone(
        task.robot,
        task.interface,
        task.observed_channels,
        policy,
        "a policy",
        0,
        hub_export.goals_of(task),
    )
    short = replace(task, max_steps=1)
    for seed, goal in zip((3, 4, 5), goals, strict=True):
        observed, _ = hub_export.play_as_env(program.source, short, None, seed).seen
        assert float(observed[5]) == goal


@pytest.mark.usefixtures("quick")
def test_a_hub_draws_its_goals_itself(tmp_path: Path) -> None:
    path = tmp_path / "spin.py"
    hub_export.export_own("Spinning-v0", path, hidden=(4,))
    source = path.read_text()
    assert source.startswith("# A network that learned Spinning-v0\n# Robot: two-wheeler\n")
    out = io.BytesIO()
    run_file(path, make_body(get_task("Spinning-v0").robot), stdout=out, time_limit_s=40.0)
    drawn = [float(line.split()[6]) for line in out.getvalue().decode().splitlines()]
    pieces = [set(drawn[start : start + 50]) for start in range(0, 200, 50)]
    # One for each 50 steps, and not always the same.
    assert all(len(piece) == 1 for piece in pieces)
    assert set(drawn) == {0.0, 1.0}


@pytest.mark.usefixtures("quick")
def test_the_world_of_a_policy_is_beside_its_program(tmp_path: Path) -> None:
    path = tmp_path / "away.py"
    assert main(["export", "RunAway-v0", "--format", "hub", "--out", str(path)]) == 0
    assert "\n# Robot: two-wheeler away\n" in path.read_text()
    scene = read_plain(json.loads((tmp_path / "away.json").read_text()))
    assert scene == get_task("RunAway-v0").scene
    with pytest.raises(RunError, match="no policy comes with Park-v0; choose RunAway-v0"):
        hub_export.export_own("Park-v0", tmp_path / "park.py")


def test_a_distilled_network_acts_like_its_policy(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    """A gait that was found in a simulation."""
    for name, value in (("ROUNDS", 2), ("STEPS", 200), ("UPDATES", 300)):
        monkeypatch.setattr(hub_network, name, value)
    train(TrainConfig("WalkerSim-v0", "gait", episodes=1, record=False, run_dir=tmp_path / "run"))
    env = make("WalkerSim-v0", seed=0)
    policy = load_policy(tmp_path / "run", env)
    torch.manual_seed(0)
    student = hub_network.distil(env, policy, HubNetwork(get_task("Walker-v0").entries, 4), seed=0)
    frames = env.rollout(50, student)
    assert (frames["action"] - policy.act(frames["observation"])).abs().mean() < 0.15


@pytest.mark.parametrize(
    ("low", "high", "scaled"),
    [
        (0.0, 10.0, (0.2, -1.0)),
        (-20.0, 20.0, (0.05, 0.0)),
        (-math.inf, 5.0, (1.0, 0.0)),
        (0.0, math.inf, (1.0, 0.0)),
        (-math.inf, math.inf, (1.0, 0.0)),
    ],
)
def test_only_what_has_two_bounds_is_scaled(
    low: float, high: float, scaled: tuple[float, float]
) -> None:
    factor, offset = hub_network._scale(Entry("x", low, high))
    assert (factor, offset) == pytest.approx(scaled)
    if scaled[0] != 1.0:
        assert (low * factor + offset, high * factor + offset) == pytest.approx((-1.0, 1.0))
