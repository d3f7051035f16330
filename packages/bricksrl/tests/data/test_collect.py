from __future__ import annotations

import threading
from pathlib import Path

import pytest
import torch
from tensordict import TensorDictBase

import bricksrl
from bricksrl.data import Recorder, describe, load
from bricksrl.data.collect import collect, random_policy
from bricksrl.envs.connection import Reconnect
from bricksrl.errors import HubError


@pytest.fixture(scope="module")
def env():
    env = bricksrl.make("RunAway-v0", seed=0)
    yield env
    env.close(raise_if_closed=False)


def test_collected_dataset_has_provenance(tmp_path: Path, env) -> None:
    with Recorder(tmp_path / "set", describe(env)) as recorder:
        told = collect(env, random_policy(env, 0), recorder, 2, name="random", seed=3)
    episodes = load(tmp_path / "set")
    assert [len(episodes.observation[episodes.episode == k]) for k in (0, 1)] == [
        one.length for one in told
    ]
    assert [row.return_ for row in episodes.rows] == pytest.approx([one.return_ for one in told])
    assert torch.equal(
        episodes.next_observation[:-1][~episodes.truncated[:-1]],
        episodes.observation[1:][~episodes.truncated[:-1]],
    )
    about = episodes.rows[0].about
    assert (about.policy, about.hub, about.whole) == ("random", "virtual", True)
    assert (
        about.program_hash
        and about.seed
        and about.versions["torch"]
        and about.physics["battery_v"] > 0
        and about.started
    )
    assert ((episodes.age_s > 0) & (episodes.age_s < 0.3)).all(), (
        "two intervals, and a pause at the start"
    )
    assert (episodes.hub_time_s[: told[0].length].diff() > 0).all()
    description = episodes.description
    assert (description.env, description.robot["name"], description.robot["hub"]) == (
        "RunAway-v0",
        "two-wheeler",
        "prime",
    )
    assert [(c.name, c.unit) for c in description.observation][-1] == ("distance", "mm")
    assert [(c.name, c.unit, c.low, c.high) for c in description.action] == [
        ("straight", "mm", -100.0, 100.0)
    ]


def test_episodes_depend_on_seed_only(tmp_path: Path, env) -> None:
    found = []
    for name, seed in (("a", 1), ("b", 1), ("c", 2)):
        with Recorder(tmp_path / name, describe(env)) as recorder:
            collect(env, random_policy(env, seed), recorder, 1, name="random", seed=seed)
        found.append(load(tmp_path / name).observation)
    assert torch.equal(found[0], found[1]) and not torch.equal(found[0], found[2])


def test_interventions_are_marked(tmp_path: Path, env) -> None:
    calls = iter(range(1000))

    def driver(observation: torch.Tensor) -> torch.Tensor | None:
        assert observation.shape == (5,)
        return torch.tensor([0.25]) if next(calls) % 3 == 1 else None

    with Recorder(tmp_path / "set", describe(env)) as recorder:
        told = collect(
            env,
            lambda state: state.set("action", torch.tensor([-0.5])),
            recorder,
            2,
            name="policy",
            driver=driver,
        )
    episodes = load(tmp_path / "set")
    assert torch.equal(episodes.action[:, 0] == 0.25, episodes.intervention)
    assert torch.equal(episodes.action[:, 0] == -0.5, ~episodes.intervention)
    assert [one.interventions for one in told] == [row.interventions for row in episodes.rows]
    assert sum(one.interventions for one in told) == int(episodes.intervention.sum()) > 0


def test_discarded_episode_is_recorded_again(tmp_path: Path, env) -> None:
    """From the same start; what the user did not want is not in the dataset."""
    discard, frames, seeds = threading.Event(), [], []

    def on_frame(_: TensorDictBase) -> None:
        frames.append(1)
        if len(frames) in (4, 9):
            discard.set()

    with Recorder(tmp_path / "set", describe(env)) as recorder:
        told = collect(
            env,
            random_policy(env, 0),
            recorder,
            2,
            name="random",
            seed=3,
            on_frame=on_frame,
            on_episode=lambda row: seeds.append(row.about.seed),
            discard=discard,
        )
    with Recorder(tmp_path / "plain", describe(env)) as recorder:
        plain = collect(env, random_policy(env, 0), recorder, 2, name="random", seed=3)
    assert len(told) == len(load(tmp_path / "set").rows) == 2
    assert sum(row.length for row in told) == len(frames) - 9
    assert seeds == [row.about.seed for row in plain], "the episodes that were asked for"
    assert all(row.about.whole for row in told)


def test_lost_link_keeps_recorded_steps(
    tmp_path: Path, env, monkeypatch: pytest.MonkeyPatch
) -> None:
    count = iter(range(100))

    def policy(state: TensorDictBase) -> TensorDictBase:
        if next(count) == 3:
            monkeypatch.setattr(env, "_act", gone)
        return state.set("action", torch.zeros(1))

    def gone(_: object) -> None:
        raise HubError("gone")

    with (
        Recorder(tmp_path / "set", describe(env)) as recorder,
        pytest.raises(HubError, match="gone"),
    ):
        collect(env, policy, recorder, 2, name="policy")
    episodes = load(tmp_path / "set")
    assert len(episodes) == 3 and not episodes.rows[0].about.whole and bool(episodes.truncated[-1])


def test_paused_episode_is_not_whole(tmp_path: Path, env) -> None:
    count = iter(range(100))

    def policy(state: TensorDictBase) -> TensorDictBase:
        if next(count) == 3:
            env.pause()
        return state.set("action", torch.zeros(1))

    def resume(_: object) -> None:
        env.resume()

    with Recorder(tmp_path / "set", describe(env)) as recorder:
        collect(env, policy, recorder, 2, name="policy", on_episode=resume)
    abouts = [row.about for row in load(tmp_path / "set").rows]
    assert [(about.whole, about.success) for about in abouts] == [(False, None), (True, False)]


def test_environment_without_task_is_recorded(tmp_path: Path) -> None:
    from toys import Cart

    cart = Cart()
    with Recorder(tmp_path / "set", describe(cart)) as recorder:
        collect(cart, random_policy(cart, 0), recorder, 2, name="random")
    episodes = load(tmp_path / "set")
    assert episodes.description.env == "Cart" and episodes.description.observation[0].high == 1000.0
    assert episodes.rows[0].about.success is None and episodes.rows[0].about.program_hash is None


def test_lost_episode_is_recorded_again(tmp_path: Path) -> None:
    """With another seed, as the link of a virtual robot would break again; its steps are kept."""
    from toys import LosingCart

    told, lost = [], []
    cart = LosingCart(3)
    with Recorder(tmp_path / "set", describe(cart)) as recorder:
        rows = collect(
            cart,
            random_policy(cart, 0),
            recorder,
            4,
            name="random",
            on_episode=lambda row: told.append(row.episode),
            on_lost=lambda steps, error: lost.append((steps, str(error))),
        )
    recorded = load(tmp_path / "set").rows
    assert [row.about.whole for row in recorded] == [True, True, False, True, True] and len(
        rows
    ) == 5
    assert told == [0, 1, 3, 4] and lost == [(2, "the hub did not answer; switch it on")]
    assert recorded[2].length == 2 and len({row.about.seed for row in recorded}) == 5


@pytest.mark.parametrize("at", [1, 2])
def test_link_that_breaks_in_every_episode_ends_the_recording(tmp_path: Path, at: int) -> None:
    from toys import LosingCart

    class Hopeless(LosingCart):
        def _is_lost(self) -> bool:
            return self.resets > 1 and self.step_count + 1 == at

    cart = Hopeless(at)
    cart.reconnect = Reconnect(patience_s=60.0, wait=lambda _: None)
    with (
        Recorder(tmp_path / "set", describe(cart)) as recorder,
        pytest.raises(HubError, match="did not answer"),
    ):
        collect(cart, random_policy(cart, 0), recorder, 4, name="random")
    rows = load(tmp_path / "set").rows
    assert cart.resets == 6 and [row.about.whole for row in rows] == [True] + [False] * (
        5 if at == 2 else 0
    )
