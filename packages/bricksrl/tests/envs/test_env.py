"""Robot environments over the link to the virtual hub."""

from __future__ import annotations

import dataclasses
import itertools

import pytest
import torch
from tensordict import TensorDict
from torchrl.envs import (
    CatFrames,
    Compose,
    DoubleToFloat,
    EnvBase,
    ObservationNorm,
    RewardSum,
    StepCounter,
    TransformedEnv,
    check_env_specs,
)

import bricksrl
from brickhub.errors import BluetoothUnavailableError, Reason
from brickhub.hub.interface import Heading
from brickhub.hub.link.lockstep import HubLink
from brickhub.virtual.virtual_transport import VirtualHub
from bricksrl.envs.connection import Connection
from bricksrl.envs.env import HubEnv
from bricksrl.envs.tasks.run_away import RUN_AWAY
from bricksrl.envs.tasks.spinning import SPINNING
from bricksrl.errors import BricksError, HubError
from bricktwin.twin.make_body import make_body

IDS = pytest.mark.parametrize("env_id", ["RunAway-v0", "Spinning-v0"])


def act(*values: float) -> TensorDict:
    return TensorDict({"action": torch.tensor(values)}, batch_size=())


def always(*values: float):
    return lambda td: td.set("action", torch.tensor(values))


def run_away_env(hub_class: type[VirtualHub] = VirtualHub, seed: int = 0) -> HubEnv:
    """The environment of ``make`` with another virtual hub."""

    def connect(twin_seed: int) -> Connection:
        twin = hub_class(make_body(RUN_AWAY.robot, scene=RUN_AWAY.scene, seed=twin_seed))
        return Connection(
            HubLink(twin, RUN_AWAY.robot, RUN_AWAY.interface, timeout_s=0.5), twin.reset, twin
        )

    return HubEnv(RUN_AWAY, connect, seed=seed)


@IDS
def test_specs_hold_for_random_episodes(env_id: str) -> None:
    env = bricksrl.make(env_id, seed=0)
    check_env_specs(env, break_when_any_done="both")
    steps = env.rollout(60, break_when_any_done=False)
    assert steps["next", "done"].any()
    assert all(
        env.observation_spec.is_in(step)
        for step in steps["next"].select("observation", "link_lost")
    )


def test_specs_match_tables() -> None:
    env = bricksrl.make("Spinning-v0")
    spec = env.observation_spec["observation"]
    assert spec.low.tolist() == [0, 0, -90, -90, -100, 0]
    assert spec.high.tolist() == [360, 360, 90, 90, 100, 1]
    assert spec.is_in(torch.tensor([0.0, 0.0, 0.0, 0.0, 190.0, 1.0]))
    assert not spec.is_in(torch.tensor([0.0, 0.0, 0.0, 0.0, 190.0, 2.0]))
    assert env.action_spec.low.tolist() == [-1, -1]
    assert env.action_spec.high.tolist() == [1, 1]
    assert bricksrl.make("RunAway-v0").action_spec.shape == (1,)


@IDS
def test_equal_seeds_give_identical_runs(env_id: str) -> None:
    def run(env: HubEnv) -> TensorDict:
        generator = torch.Generator().manual_seed(1)
        size = env.action_spec.shape
        return env.rollout(
            25,
            lambda td: td.set("action", torch.rand(size, generator=generator) * 2 - 1),
            break_when_any_done=False,
        )

    env = bricksrl.make(env_id, seed=3)
    first, second = run(env), run(bricksrl.make(env_id, seed=3))
    assert (first == second).all()
    assert not torch.equal(run(bricksrl.make(env_id, seed=4))["observation"], first["observation"])
    env.set_seed(3)
    assert (run(env) == first).all()


def test_a_reset_moves_nothing() -> None:
    env = bricksrl.make("Spinning-v0", seed=0)
    before = env.reset()["observation"]
    after = env.reset()["observation"]
    assert before[:2].tolist() == after[:2].tolist() == [0.0, 0.0]
    assert after[4].abs() < 5


def test_a_new_episode_starts_at_rest() -> None:
    env = bricksrl.make("Spinning-v0", seed=0)
    env.rollout(5, always(-1.0, 1.0))
    assert env.reset()["observation"][4].abs() < 5


@pytest.mark.parametrize(
    ("env_id", "names"),
    [
        ("Walker-v1", ("forward",)),
        ("Park-v0", ("last_drive_speed", "last_turn_rate", "moved", "turned")),
    ],
)
def test_nothing_was_driven_or_commanded_before_the_first_step(
    env_id: str, names: tuple[str, ...]
) -> None:
    env = bricksrl.make(env_id, seed=0)
    places = [entry.name for entry in env.task.entries]
    first = env.reset()
    env.step(env.rand_action(first.clone()))
    for state in (first, env.reset()):
        observation = state["observation"]
        assert [observation[places.index(name)].item() for name in names] == [0.0] * len(names)
    env.close()


def test_starts_and_directions_vary_within_their_ranges() -> None:
    env = bricksrl.make("RunAway-v0", seed=0)
    distances_mm = torch.stack([env.reset()["observation"][4] for _ in range(20)])
    assert 190 <= distances_mm.min() < 230
    assert 270 < distances_mm.max() <= 310
    spinning = bricksrl.make("Spinning-v0", seed=0)
    assert {spinning.reset()["observation"][5].item() for _ in range(20)} == {0.0, 1.0}


def test_driving_away_is_rewarded_until_time_limit() -> None:
    env = bricksrl.make("RunAway-v0", seed=0)
    steps = env.rollout(30, always(-1.0))
    assert steps["next", "reward"].sum() > 13
    moved_mm = steps["next", "observation"][:, 4] - steps["observation"][:, 4]
    assert 80 < moved_mm.median() < 120
    if len(steps) == 20:
        assert steps["next", "truncated"][-1] and not steps["next", "terminated"][-1]
    else:
        assert steps["next", "observation"][-1, 4] == 2000


def test_driving_into_the_wall_terminates_without_reward() -> None:
    steps = bricksrl.make("RunAway-v0", seed=0).rollout(30, always(1.0))
    assert steps["next", "terminated"][-1]
    assert not steps["next", "truncated"][-1]
    assert steps["next", "reward"][-1] == 0
    assert steps["next", "reward"][0] == -1
    assert steps["next", "observation"][-1, 4] <= 40


def test_fast_spin_exceeds_nominal_range() -> None:
    env = bricksrl.make("Spinning-v0", seed=0)
    left = env.rollout(50, always(-1.0, 1.0))
    rates, direction = left["next", "observation"][:, 4], left["observation"][0, 5]
    assert 140 < rates[5:].mean() < 200
    assert left["next", "truncated"][-1]
    assert not left["next", "terminated"].any()
    assert torch.equal(left["next", "observation"][:, 5], direction.expand(50))
    assert torch.equal(left["next", "reward"][:, 0], rates if direction == 0 else -rates)


def test_heading_counts_from_the_start_of_each_episode_however_far_the_robot_has_turned() -> None:
    task = dataclasses.replace(
        SPINNING,
        interface=dataclasses.replace(
            SPINNING.interface, channels=(*SPINNING.interface.channels, Heading())
        ),
    )
    twin = VirtualHub(make_body(task.robot, scene=task.scene))
    env = HubEnv(
        task,
        lambda _seed: Connection(HubLink(twin, task.robot, task.interface), twin.reset),
        seed=0,
    )
    for turned_deg in (0.0, 3270.0, 40_000.0):
        env.reset()
        twin.machine.heading.set_angle(turned_deg)
        heading = env.reset()["observation"][5]
        after = [env.step(act(1.0, -1.0))["next", "observation"][5] for _ in range(3)]
        assert heading == 0 and 1 < after[0] < after[1] < after[2] < 180, turned_deg
    env.close()


def test_clamping_leaves_agents_action() -> None:
    action = torch.tensor([-7.0])
    wild, tame = run_away_env(), run_away_env()
    wild.reset()
    tame.reset()
    wild_step, tame_step = (
        wild.step(TensorDict({"action": action}, batch_size=())),
        tame.step(act(-1.0)),
    )
    assert action.tolist() == [-7.0]
    assert wild_step["action"] is action
    assert torch.equal(wild_step["next", "observation"], tame_step["next", "observation"])


def test_observations_may_be_changed_in_place() -> None:
    one, other = run_away_env(), run_away_env()
    other.reset()
    one.reset()["observation"].fill_(5000)
    assert torch.equal(
        one.step(act(-1.0))["next", "reward"], other.step(act(-1.0))["next", "reward"]
    )


@pytest.mark.parametrize("values", [(0.5, 0.5), (), (float("nan"),)])
def test_invalid_actions_raise_and_episode_continues(values: tuple[float, ...]) -> None:
    env = run_away_env()
    env.reset()
    with pytest.raises(BricksError, match=r"shape|NaN"):
        env.step(act(*values))
    env.step(act(-1.0))


def test_step_without_reset_raises() -> None:
    env = run_away_env()
    with pytest.raises(BricksError, match="reset"):
        env.step(act(0.0))
    env.reset()
    env.close()
    with pytest.raises(BricksError, match="reset"):
        env.step(act(0.0))


def test_link_opens_at_first_reset() -> None:
    class Watched(VirtualHub):
        calls: list[str] = []  # noqa: RUF012

        def open(self) -> None:
            self.calls.append("open")
            super().open()

        def close(self) -> None:
            self.calls.append("close")
            super().close()

    env = run_away_env(Watched)
    assert Watched.calls == []
    env.reset()
    env.reset()
    assert Watched.calls == ["open"]
    env.close()
    env.close()
    assert Watched.calls[:2] == ["open", "close"]
    env.reset()
    assert Watched.calls[-1] == "open"


class Deaf(VirtualHub):
    """Loses answers while it is deaf."""

    hears = True

    def read(self, timeout_s: float) -> bytes:
        data = super().read(timeout_s)
        return data if self.hears else b""


def deaf_env() -> tuple[HubEnv, Deaf]:
    env = run_away_env(Deaf)
    env.reset()
    assert isinstance(env.twin, Deaf)
    return env, env.twin


def test_lost_link_in_step_truncates() -> None:
    env, twin = deaf_env()
    before = env.step(act(-1.0))["next"]
    assert not before["link_lost"] and before["reward"] == 1
    twin.hears = False
    lost = env.step(act(-1.0))["next"]
    assert [bool(lost[key]) for key in ("link_lost", "truncated", "done", "terminated")] == [
        True,
        True,
        True,
        False,
    ]
    ends = [lost[key] for key in env.done_keys]
    assert all(end.dtype is torch.bool and end.shape == (1,) for end in ends)
    assert torch.equal(lost["observation"], before["observation"]) and lost["reward"] == 0
    assert env.observation_spec.is_in(lost.select(*env.observation_spec.keys()))
    assert isinstance(env.link_error, HubError) and "answer" in str(env.link_error)
    assert env._connection is not None and not env._connection.link.is_open, "the motors stop"
    with pytest.raises(BricksError, match="reset"):
        env.step(act(-1.0))
    twin.hears = True
    assert not env.reset()["link_lost"]
    assert env.step(act(-1.0))["next", "reward"] == 1


def test_failed_reset_without_patience_raises() -> None:
    env, twin = deaf_env()
    twin.hears = False
    for says in ("answer", "hello"):
        with pytest.raises(HubError, match=says):
            env.reset()
    twin.hears = True
    assert env.step(env.reset().set("action", torch.tensor([-1.0])))["next", "reward"] == 1


def test_reset_retries_within_patience() -> None:
    env, twin = deaf_env()
    waits_s: list[float] = []
    told: list[str] = []

    def wait(duration_s: float) -> None:
        waits_s.append(duration_s)
        twin.hears = len(waits_s) == 3

    env.reconnect.patience_s, env.reconnect.wait = 300.0, wait
    env.reconnect.on_error = lambda error: told.append(str(error))
    twin.hears = False
    assert env.step(act(-1.0))["next", "link_lost"]
    env.reset()
    assert waits_s == [0.5, 1.0, 2.0], "at once, then after pauses that grow"
    assert len(told) == 4 and "answer" in told[0] and all("hello" in text for text in told[1:])


@pytest.mark.parametrize("answered", [False, True])
@pytest.mark.parametrize("reason", Reason)
def test_errors_that_last_are_raised_before_the_first_answer(
    reason: Reason, answered: bool, monkeypatch
) -> None:
    env = run_away_env(Deaf)
    pauses_s: list[float] = []

    def fail() -> None:
        raise BluetoothUnavailableError("could not look for hubs: why", reason)

    def wait(duration_s: float) -> None:
        pauses_s.append(duration_s)
        monkeypatch.undo()

    env.reconnect.patience_s, env.reconnect.wait = 300.0, wait
    if answered:
        env.reset()
    monkeypatch.setattr(env, "_start", fail)
    if not answered and reason not in (Reason.UNKNOWN, Reason.NOT_FOUND):
        with pytest.raises(BluetoothUnavailableError, match="why"):
            env.reset()
        assert not pauses_s
    else:
        env.reset()
        assert pauses_s == [0.5]


def test_robot_answering_only_resets_is_given_up() -> None:
    env, twin = deaf_env()
    now_s = [0.0]

    def wait(duration_s: float) -> None:
        now_s[0] += duration_s

    env.reconnect.patience_s, env.reconnect.wait = 0.2, wait
    lost = 0
    while lost < 2:
        twin.hears = False
        lost += bool(env.step(act(-1.0))["next", "link_lost"])
        twin.hears = True
        if lost < 2:
            env.reset()
    with pytest.raises(HubError, match="answer"):
        env.reset()


def test_seeding_keeps_link_of_placed_robot() -> None:
    twin = VirtualHub(make_body(SPINNING.robot, scene=SPINNING.scene))
    link = HubLink(twin, SPINNING.robot, SPINNING.interface)
    placed = []
    env = HubEnv(SPINNING, lambda _seed: Connection(link, placed.append), seed=0)
    assert env.twin is None
    directions = [env.reset()["observation"][5].item() for _ in range(10)]
    env.set_seed(0)
    assert [env.reset()["observation"][5].item() for _ in range(10)] == directions
    assert len(placed) == 20
    assert env.step(act(1.0, -1.0))["next", "observation"][4] < 0


@IDS
def test_step_writes_complete_torchrl_output(env_id: str) -> None:
    env = bricksrl.make(env_id, seed=0)
    env.reset()
    mine = env._step(TensorDict({"action": env.action_spec.rand()}, batch_size=()))
    theirs = EnvBase._step_proc_data(env, mine.clone())
    assert set(theirs.keys()) == set(env._step_proc_data(mine.clone()).keys())
    assert (theirs == mine).all()
    env.close()


def test_wrong_reward_shape_raises() -> None:
    task = dataclasses.replace(
        SPINNING,
        reward=lambda previous, action, observation: SPINNING.reward(previous, action, observation)[
            0
        ],
    )
    env = bricksrl.make("Spinning-v0", seed=0)
    env.task = task
    assert env.rollout(2)["next", "reward"].shape == (2, 1)
    env.close()


def test_step_and_maybe_reset() -> None:
    env = run_away_env()
    td = env.reset()
    ends = 0
    for _ in range(12):
        td.set("action", torch.ones(1))
        step, td = env.step_and_maybe_reset(td)
        if step["next", "done"]:
            ends += 1
            assert td["observation"][4] > 150
            assert not td["done"]
    assert ends >= 2


def test_transforms() -> None:
    env = TransformedEnv(
        bricksrl.make("Spinning-v0", seed=0),
        Compose(
            StepCounter(),
            RewardSum(),
            DoubleToFloat(),
            ObservationNorm(
                loc=torch.zeros(6),
                scale=torch.full((6,), 0.01),
                in_keys=["observation"],
                out_keys=["normed"],
            ),
            CatFrames(N=3, dim=-1, in_keys=["normed"]),
        ),
    )
    check_env_specs(env)
    steps = env.rollout(50, always(-1.0, 1.0))
    assert env.observation_spec.is_in(steps[-1]["next"].select(*env.observation_spec.keys()))
    assert steps["next", "step_count"][-1] == 50
    assert steps["next", "episode_reward"][-1] == pytest.approx(
        steps["next", "reward"].sum().item(), rel=1e-4
    )
    assert steps["normed"].shape == (50, 18)
    assert torch.allclose(steps["normed"][2:, -6:], steps["observation"][2:] * 0.01)
    assert torch.allclose(steps["normed"][2:, :6], steps["observation"][:-2] * 0.01)


def test_observation_norm_in_place() -> None:
    env = TransformedEnv(
        bricksrl.make("RunAway-v0", seed=0), ObservationNorm(in_keys=["observation"])
    )
    env.transform.init_stats(num_iter=20)
    check_env_specs(env)


def test_user_task_on_same_robot() -> None:
    """Everything that a user writes for a task."""
    task = dataclasses.replace(
        RUN_AWAY,
        id="Approach-v0",
        max_steps=3,
        reward=lambda before, _, after: (before - after)[..., 4:],
    )
    bricksrl.register(task)
    steps = bricksrl.make("Approach-v0", seed=0).rollout(10, always(0.5))
    assert len(steps) == 3
    assert 30 < steps["next", "reward"].mean() < 70


def test_walker_waits_for_clear_path(caplog: pytest.LogCaptureFixture) -> None:
    env = bricksrl.make("Walker-v0", seed=0)
    env.reset()
    assert env.twin is not None
    body, readings = env.twin.body, iter([30, 30, 30, 500, 500, 500])
    body.distance_mm = lambda port: next(readings)  # type: ignore[method-assign]
    legs = [body.angle_mdeg(port) for port in env.twin.machine.servos]
    env._episode.observation[6] = 40.0
    with caplog.at_level("WARNING"):
        after = env.step(TensorDict({"action": torch.ones(4)}))["next"]
    assert "in the robot's way" in caplog.text
    assert after["observation"][6] == 500
    assert next(readings) == 500, "it read until the way was clear, then once for the step"
    assert [body.angle_mdeg(port) for port in env.twin.machine.servos] == pytest.approx(
        legs, abs=8000
    )


def test_walker_gives_up_if_blocked(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr("bricksrl.envs.env.BLOCKED_TIMEOUT_S", 0.5)
    env = bricksrl.make("Walker-v0", seed=0, blocked_at_mm=2000)
    env.reset()
    assert env.step(TensorDict({"action": torch.zeros(4)}))["next", "link_lost"]
    assert "clear it" in str(env.link_error)


def test_step_has_timestamp() -> None:
    env = bricksrl.make("Spinning-v0", seed=0)
    state = env.reset()
    with pytest.raises(BricksError, match="no step yet"):
        _ = env.timing
    times_s = []
    for _ in range(5):
        state = env.step(state.set("action", torch.zeros(2)))["next"]
        times_s.append(env.timing.hub_time_s)
        assert 0.0 < env.timing.age_s < 0.1  # it came over a radio that takes milliseconds
    assert all(0.1 <= later - sooner < 0.2 for sooner, later in itertools.pairwise(times_s))
    env.close()


class OpenLink:
    """A link of which only its end matters."""

    def __init__(self, *, is_open: bool) -> None:
        self.is_open = is_open
        self.closed: list[str] = []

    def emergency_stop(self) -> None:
        self.is_open = False
        self.closed.append("stopped")

    def close(self) -> None:
        self.closed.append("closed")


@pytest.mark.parametrize("is_open", [True, False])
def test_a_real_robot_has_stopped_where_its_link_said_so(is_open: bool) -> None:
    link = OpenLink(is_open=is_open)
    env = HubEnv(RUN_AWAY, lambda _seed: Connection(link, lambda _rng: None))  # type: ignore[arg-type]
    assert not env.has_stopped
    assert env.twin is None, "it is connected now"
    env.stop()
    assert link.closed == ["stopped"]
    assert env.has_stopped is is_open, "a link that was broken tells nothing of the motors"


def test_a_robot_that_was_never_reached_has_stopped_and_a_virtual_one_where_nothing_drives() -> (
    None
):
    env = bricksrl.make("Spinning-v0", seed=0)
    env.stop()
    assert env.has_stopped
    env.resume()
    env.step(env.reset().set("action", torch.ones(2)))
    assert not env.has_stopped
    env.stop()
    assert env.has_stopped
    env.close()
