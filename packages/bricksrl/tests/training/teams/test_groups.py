"""What a group of robots learns from, and by how much, with numbers made by hand."""

from __future__ import annotations

import math
import threading
from dataclasses import replace
from pathlib import Path
from types import SimpleNamespace
from typing import Any

import pytest
import torch
from tensordict import TensorDict, TensorDictBase

from brickhub.seed import derive_seed, episode_seed
from bricksrl.envs.arenas import make_arena
from bricksrl.errors import CheckpointError, DescriptionError, HubError
from bricksrl.training.checkpoint import load_checkpoint, save_checkpoint
from bricksrl.training.teams import team as teams
from bricksrl.training.teams.groups import PPOGroup, SACGroup, TeamSettings, make_group
from bricksrl.training.teams.team import Team, TeamConfig, TeamEpisode, play_team

SETTINGS = TeamSettings(hidden=(8,), steps=4, passes=3)
SCALE = torch.tensor([2.0, 4.0])


def ppo(*, central: bool, robots: int = 2, settings: TeamSettings = SETTINGS) -> PPOGroup:
    torch.manual_seed(0)
    return PPOGroup("agents", robots, SCALE, 3, settings, central=central)


def observed(*rows: tuple[float, float]) -> TensorDict:
    """What the robots of a single copy observe."""
    observation = torch.tensor([rows])
    return TensorDict({"agents": {"observation": observation}}, [1])


def test_robots_share_a_policy_that_sees_its_own_robot_alone() -> None:
    for central in (False, True):
        policy = ppo(central=central).policy
        both = policy(observed((1.0, -2.0), (1.0, -2.0)))["agents", "loc"][0]
        assert torch.allclose(both[0], both[1], atol=1e-6)
        other = policy(observed((1.0, -2.0), (0.5, 3.0)))["agents", "loc"][0]
        assert torch.allclose(other[0], both[0], atol=1e-6)
        assert not torch.allclose(other[1], both[1], atol=1e-3)
        action = policy(observed((1.0, -2.0), (0.5, 3.0)))["agents", "action"]
        assert action.shape == (1, 2, 3)


@pytest.mark.parametrize("central", [False, True])
def test_only_the_critic_of_mappo_sees_the_other_robot(central: bool) -> None:
    critic = ppo(central=central).loss.critic_network
    alike = critic(observed((1.0, -2.0), (1.0, -2.0)))["agents", "state_value"][0]
    other = critic(observed((1.0, -2.0), (0.5, 3.0)))["agents", "state_value"][0]
    assert alike.shape == (2, 1)
    assert torch.allclose(alike[0], other[0], atol=1e-6) is not central


def test_networks_read_observations_by_their_bounds() -> None:
    """An observation at its bounds is a one to the network."""
    group = ppo(central=False)
    body = group.policy[0].module
    scaled = body[0]
    with torch.no_grad():
        assert torch.equal(scaled(SCALE.expand(1, 2, 2)), scaled.net(torch.ones(1, 2, 2)))


def test_no_robot_stops_exploring() -> None:
    """However sure of itself a network is, its actions have a scale of 0.05 or more."""
    group = ppo(central=False)
    with torch.no_grad():
        for name, parameter in group.policy.named_parameters():
            parameter.fill_(-50.0 if name.endswith("bias") else 0.0)
    scale = group.policy(observed((2.0, 4.0), (2.0, 4.0)))["agents", "scale"]
    assert float(scale.detach().min()) == pytest.approx(0.05, abs=1e-4)


def test_settings_reach_the_loss_and_the_optimiser() -> None:
    settings = TeamSettings(
        hidden=(8,),
        learning_rate=0.25,
        gamma=0.5,
        gae_lambda=0.75,
        clip_epsilon=0.125,
        entropy_coeff=0.0625,
    )
    group = ppo(central=True, settings=settings)
    assert float(group._advantage.gamma) == 0.5
    assert float(group._advantage.lmbda) == 0.75
    assert float(group.loss.clip_epsilon) == pytest.approx(0.125)
    assert float(group.loss.entropy_coeff) == pytest.approx(0.0625)
    assert group.loss.normalize_advantage
    assert [each["lr"] for each in group._optimizer.param_groups] == [0.25]


def steps_of(group: PPOGroup, copies: int, time: int) -> TensorDictBase:
    """Random steps of two robots; the first copy's episode ends in its second step."""
    torch.manual_seed(1)
    frames = TensorDict({"agents": {"observation": torch.rand(copies, time, 2, 2)}}, [copies, time])
    with torch.no_grad():
        group.policy(frames)
    done = torch.zeros(copies, time, 1, dtype=torch.bool)
    done[0, 1] = True
    after = {
        "agents": {
            "observation": torch.rand(copies, time, 2, 2),
            "reward": torch.rand(copies, time, 2, 1),
        },
        "done": done,
        "terminated": done.clone(),
    }
    frames["next"] = TensorDict(after, [copies, time])
    return frames


@pytest.mark.parametrize(
    ("batch_size", "sizes"), [(None, [8]), (8, [8]), (9, [8]), (3, [3, 3, 2]), (1, [1] * 8)]
)
def test_each_pass_uses_each_step_once(batch_size: int | None, sizes: list[int]) -> None:
    settings = TeamSettings(hidden=(8,), passes=3, batch_size=batch_size)
    group = ppo(central=False, settings=settings)
    batches: list[TensorDictBase] = []
    values = iter(range(100))

    def loss(rows: TensorDictBase) -> TensorDict:
        batches.append(rows)
        return TensorDict({"loss_objective": torch.tensor(float(next(values)))}, [])

    group.loss = loss  # type: ignore[assignment]
    group._descend = lambda losses: None  # type: ignore[method-assign]
    frames = steps_of(group, 2, 4)
    metrics = group.learn(frames.clone())
    assert [len(rows) for rows in batches] == sizes * 3
    each_pass = len(sizes)
    for start in range(0, len(batches), each_pass):
        rows = torch.cat(batches[start : start + each_pass])
        seen = sorted(rows["agents", "observation"].flatten().tolist())
        assert seen == sorted(frames["agents", "observation"].flatten().tolist())
    assert float(metrics["loss_objective"]) == pytest.approx((len(batches) - 1) / 2), "their mean"


def test_each_robot_has_the_ends_of_its_arena() -> None:
    group = ppo(central=False)
    seen: list[TensorDictBase] = []
    group._advantage = lambda frames: seen.append(frames) or frames  # type: ignore[assignment]
    group.loss = lambda rows: TensorDict({}, [])  # type: ignore[assignment]
    group._descend = lambda losses: None  # type: ignore[method-assign]
    frames = steps_of(group, 2, 4)
    done = frames["next", "done"].clone()
    group.learn(frames)
    for name in ("done", "terminated"):
        of_robots = seen[0]["next", "agents", name]
        assert of_robots.shape == (2, 4, 2, 1)
        for robot in range(2):
            assert torch.equal(of_robots[:, :, robot], done)
        assert not seen[0]["agents", name].any()


def test_gradient_step_minimises_losses_within_a_norm() -> None:
    """The gradient of 100 times a sum is far greater than one half, of which it is cut to."""
    group = ppo(central=False)
    norms: list[float] = []

    def step() -> None:
        gradients = [one.grad for one in group.loss.parameters() if one.grad is not None]
        norms.append(math.sqrt(sum(float(gradient.square().sum()) for gradient in gradients)))

    cleared: list[bool] = []
    optimizer = SimpleNamespace(step=step, zero_grad=lambda: cleared.append(True))
    group._optimizer = optimizer  # type: ignore[assignment]
    first, *_ = group.loss.parameters()
    losses = {"loss_objective": 60.0 * first.sum(), "loss_critic": 40.0 * first.sum()}
    ignored = {"entropy": -1000.0 * first.sum()}
    group._descend(TensorDict(losses | ignored, []))
    assert norms == [pytest.approx(0.5, rel=1e-4)] and cleared == [True]
    assert first.grad is not None
    assert bool((first.grad > 0).all()), "both losses were minimised, and nothing else"
    first.grad = None
    group._descend(TensorDict({"loss_objective": 1e-3 * first.sum()}, []))
    assert norms[1] == pytest.approx(1e-3 * math.sqrt(first.numel()), rel=1e-4), "a small one stays"


def test_fractions_of_updates_wait_for_further_steps() -> None:
    """Three updates in eight steps, and four steps at a time: 1.5 updates, 3, 4.5 and 6 in all."""
    settings = TeamSettings(hidden=(8,), updates_per_step=0.375)
    group: Any = SACGroup("agents", 2, -SCALE, SCALE, 3, settings)
    made: list[int] = []
    remembered: list[Any] = []

    def make_updates(count: int) -> dict[str, torch.Tensor]:
        made.append(count)
        return {}

    group._learner = SimpleNamespace(remember=remembered.append, make_updates=make_updates)
    group._as_copies = lambda frames: ("copies of", frames)
    frames = TensorDict({}, [5, 4])
    for _ in range(4):
        group.learn(frames)
    assert made == [1, 2, 1, 2]
    assert [what for what, _ in remembered] == ["copies of"] * 4


def test_independent_sac_has_the_settings_of_its_team() -> None:
    settings = TeamSettings(hidden=(8, 9), gamma=0.5, learning_rate=0.25, batch_size=7)
    group: Any = SACGroup("agents", 2, -SCALE, SCALE, 3, settings)
    learner = group._learner
    assert learner.memory.batch_size == 7
    assert [each["lr"] for each in learner.descent.optimizer.param_groups] == [0.25]
    assert float(learner.loss.gamma) == 0.5
    action = group.policy(observed((1.0, -2.0), (1.0, -2.0)))["agents", "action"]
    assert action.shape == (1, 2, 3) and action.abs().max() <= 1.0


def test_group_is_made_for_its_robots_and_bounds() -> None:
    env = make_arena("Tag-v0")
    group: Any = make_group(env, "catcher", "ippo", SETTINGS)
    scale = group.policy[0].module[0].scale
    wanted = [max(abs(entry.low), abs(entry.high)) for entry in env.task.entries]
    assert scale.tolist() == pytest.approx(wanted)
    sac: Any = make_group(env, "catcher", "sac", SETTINGS)
    assert sac._robots == len(env.task.groups["catcher"])
    with pytest.raises(DescriptionError) as raised:
        make_group(env, "cat", "sac", SETTINGS)
    assert str(raised.value) == "Tag-v0 has no group 'cat'; it has catcher, runner"


def team_of(*groups: str) -> Team:
    agents = dict.fromkeys(groups, "ippo")
    config = TeamConfig("Tag-v0", agents, {}, frames=32, copies=2)
    return Team(config, SETTINGS, {}, None)  # type: ignore[arg-type]


def test_progress_counts_episodes_that_ended_with_their_earlier_rewards() -> None:
    """Two copies, three steps, two robots. The first copy's episode began with a return of 10,
    ends after two steps with success, and another begins; the second copy's goes on."""
    rewards = torch.tensor([[[1.0, 3.0], [5.0, 7.0], [100.0, 300.0]], [[1.0, 1.0]] * 3])
    done = torch.tensor([[False, True, False], [False] * 3]).unsqueeze(-1)
    success = torch.tensor([[True, True, True], [True] * 3]).unsqueeze(-1)
    after = {
        "a": {"reward": rewards.unsqueeze(-1)},
        "b": {"reward": -rewards.unsqueeze(-1)},
        "done": done,
        "success": success,
    }
    frames = TensorDict({"next": TensorDict(after, [2, 3])}, [2, 3])
    running = {"a": torch.tensor([10.0, 20.0]), "b": torch.zeros(2)}
    progress = teams._progress(team_of("a", "b"), frames, running, 77)
    assert (progress.frames, progress.episodes, progress.success) == (77, 1, 1.0)
    # Means of the robots: 2 and 6, then 200, and 1 in each step of the other copy.
    assert progress.returns == {"a": 18.0, "b": -8.0}
    assert running["a"].tolist() == [200.0, 23.0]
    assert running["b"].tolist() == [-200.0, -3.0]
    frames["next", "done"][:] = False
    later = teams._progress(team_of("a", "b"), frames, running, 80)
    assert later.episodes == 0
    assert math.isnan(later.success) and math.isnan(later.returns["a"])


@pytest.mark.parametrize(
    ("copies", "frames", "rounds"), [(2, 32, 4), (2, 31, 3), (2, 7, 1), (0, 12, 3), (1, 8, 2)]
)
def test_training_has_as_many_rounds_as_fit_into_its_steps(
    monkeypatch: pytest.MonkeyPatch, copies: int, frames: int, rounds: int
) -> None:
    """A round is four steps of each copy, and there is always one."""
    asked: list[tuple[int, int]] = []
    told: list[int] = []
    learned: list[TensorDictBase] = []
    stop = threading.Event()

    def collect_round(_env: Any, _policy: Any, steps: int, each: int) -> Any:
        asked.append((steps, each))
        for _ in range(steps // each):
            yield TensorDict({}, [each] if copies == 0 else [copies, each])

    def progress(_team: Any, _frames: Any, running: Any, done: int) -> int:
        assert running["a"].shape == (max(1, copies),)
        return done

    monkeypatch.setattr(teams, "collect_round", collect_round)
    monkeypatch.setattr(teams, "_progress", progress)
    learner: Any = SimpleNamespace(learn=learned.append)
    config = TeamConfig("Tag-v0", {"a": "ippo"}, frames=frames, copies=copies)
    team = Team(config, SETTINGS, {"a": learner}, None)  # type: ignore[arg-type]
    teams._learn(None, team, told.append, stop)  # type: ignore[arg-type]
    assert asked == [(4 * rounds, 4)]
    each_round = 4 * max(1, copies)
    assert told == [each_round * number for number in range(1, rounds + 1)]
    assert [part.shape for part in learned] == [(max(1, copies), 4)] * rounds
    stop.set()
    learned.clear()
    teams._learn(None, team, told.append, stop)  # type: ignore[arg-type]
    assert len(learned) == 1, "the round in which it is stopped is learned from"


def test_played_episodes_are_counted_by_their_rewards(monkeypatch: pytest.MonkeyPatch) -> None:
    seeds: list[int] = []
    drawn: list[float] = []
    lost = threading.Event()

    def play(_env: Any, _policy: Any) -> Any:
        drawn.append(float(torch.rand(())))
        for step in range(3):
            rewards = {"a": {"reward": torch.tensor([[1.0], [3.0]])}}
            rewards |= {"b": {"reward": torch.tensor([[float(step)]])}}
            ends = {
                "success": torch.tensor([step == 2]),
                "link_lost": torch.tensor([lost.is_set() and step == 2]),
            }
            yield TensorDict({"next": {**rewards, **ends}}, [])

    monkeypatch.setattr(teams, "play", play)
    error = HubError("the link broke")
    monkeypatch.setattr(teams, "interface_of", lambda env: SimpleNamespace(link_error=error))
    task = SimpleNamespace(groups={"a": (0, 1), "b": (2,)})
    env: Any = SimpleNamespace(task=task, set_seed=seeds.append)
    policy: Any = None
    played = play_team(env, policy, 2, 7)
    assert played == [TeamEpisode(True, 3, {"a": 6.0, "b": 3.0})] * 2
    assert seeds == [episode_seed("evaluation", 7, 1), episode_seed("evaluation", 7, 2)]
    torch.manual_seed(derive_seed(7, "policy", 2))
    assert drawn[1] == float(torch.rand(())) and drawn[0] != drawn[1]
    assert play_team(env, policy, 1, 7) == played[:1] and drawn[2] == drawn[0]
    lost.set()
    with pytest.raises(HubError, match="the link broke"):
        play_team(env, policy, 1, 7)


def test_team_is_saved_with_plain_values_and_loaded_against_others(tmp_path: Path) -> None:
    agents = {"catcher": "ippo"}
    config = TeamConfig("Tag-v0", agents, {"runner": "flee"}, frames=64, copies=4, seed=5)
    settings = TeamSettings(hidden=(8, 4), learning_rate=0.5)
    torch.manual_seed(0)
    team = teams._new_team(make_arena("Tag-v0"), config, settings)
    team.save(tmp_path / "team.bin")
    state = load_checkpoint(tmp_path / "team.bin")
    assert set(state) == {"config", "settings", "groups"}
    assert state["config"]["agents"] == agents and state["settings"]["hidden"] == [8, 4]
    assert list(state["groups"]) == ["catcher"]
    loaded = teams.load_team(tmp_path / "team.bin")
    assert (loaded.config, loaded.settings) == (config, settings)
    one, other = (each.learners["catcher"].policy.state_dict() for each in (team, loaded))
    assert all(torch.equal(one[name], other[name]) for name in one)
    against = teams.load_team(str(tmp_path / "team.bin"), {"runner": "random"})
    assert against.config.scripts == {"runner": "random"}
    assert replace(against.config, scripts=config.scripts) == config
    save_checkpoint(tmp_path / "other.bin", {"config": {}})
    with pytest.raises(CheckpointError) as raised:
        teams.load_team(tmp_path / "other.bin")
    assert str(raised.value) == (
        f"{tmp_path / 'other.bin'} has no team (KeyError: 'settings'); choose another file or "
        "train one"
    )


@pytest.mark.parametrize(
    ("changes", "says"),
    [
        ({"frames": 0}, "frames is 0; give"),
        ({"frames": 10**9 + 1}, "frames is 1000000001; give"),
        ({"copies": -1}, "copies is -1; give"),
        ({"copies": 2**16 + 1}, "copies is 65537; give"),
        ({"seed": -1}, "seed"),
    ],
)
def test_config_of_a_team_has_limits(changes: dict[str, int], says: str) -> None:
    TeamConfig("Tag-v0", {"catcher": "ippo"}, frames=1, copies=0)
    TeamConfig("Tag-v0", {"catcher": "ippo"}, frames=10**9, copies=2**16)
    options: dict[str, Any] = changes
    with pytest.raises(DescriptionError, match=says):
        TeamConfig("Tag-v0", {"catcher": "ippo"}, **options)


def test_training_is_seeded_and_ends_with_its_arena(monkeypatch: pytest.MonkeyPatch) -> None:
    asked: list[Any] = []
    env: Any = SimpleNamespace(close=lambda *, raise_if_closed: asked.append(raise_if_closed))

    def make(name: str, **options: Any) -> Any:
        asked.append((name, options))
        return env

    def new_team(*given: Any) -> Any:
        asked.append((torch.initial_seed(), *given))
        return "the team"

    monkeypatch.setattr(teams, "make_arena", make)
    monkeypatch.setattr(teams, "_new_team", new_team)
    monkeypatch.setattr(teams, "_learn", lambda *given: asked.append(given[:2]))
    config = TeamConfig("Guide-v0", {"agents": "sac"}, copies=3, seed=5, deaf=True)
    assert teams.train_team(config) == "the team"  # type: ignore[comparison-overlap]
    options = {"seed": derive_seed(5, "arena"), "deaf": True, "batch_size": 3}
    assert asked == [
        ("Guide-v0", options),
        (derive_seed(5, "team"), env, config, TeamSettings()),
        (env, "the team"),
        False,
    ]
