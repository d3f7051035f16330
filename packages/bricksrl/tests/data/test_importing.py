from __future__ import annotations

import json
import math
import os
import pickle
from contextlib import closing
from pathlib import Path

import pytest
import torch
from tensordict import TensorDict

from bricksrl.data import formats, load
from bricksrl.data.formats import import_paper
from bricksrl.data.integrity import check
from bricksrl.envs import get_task, make
from bricksrl.errors import DataError
from bricksrl.training.learners import read_for


def save(
    folder: Path,
    observation: torch.Tensor,
    action: torch.Tensor,
    reward: torch.Tensor,
    done: torch.Tensor,
    **more,
) -> None:
    """Save a buffer as the released code does: ``observation`` ``[steps + 1, n]``, episodes end at
    ``done``."""
    n = len(action)
    root = {
        "observation": observation[:-1].clone(),
        **{key: value[:-1].clone() for key, value in more.items()},
    }
    after = {
        "observation": observation[1:].clone(),
        **{key: value[1:].clone() for key, value in more.items()},
    }
    for i in done.nonzero().flatten().tolist():  # each episode starts anew
        if i + 1 < n:
            root["observation"][i + 1] += 1.0
    flag = done[:, None]
    data = TensorDict(
        {
            **root,
            "action": action,
            "index": torch.arange(n),
            "done": torch.zeros_like(flag),
            "terminated": torch.zeros_like(flag),
            "next": TensorDict(
                {**after, "reward": reward[:, None], "done": flag, "terminated": flag}, [n]
            ),
        },
        [n],
    )
    data.memmap(folder)


def test_walker_data_is_reordered(tmp_path: Path) -> None:
    observation = torch.tensor([[-170.0, 10, 20, 179, 1, 2, 300 + i] for i in range(131)])
    action = torch.rand(130, 4)
    done = torch.zeros(130, dtype=torch.bool)
    done[99] = done[119] = True
    save(tmp_path / "Walker/expert_data", observation, action, torch.full((130,), -0.5), done)
    imported = import_paper(tmp_path, tmp_path / "ours")
    assert [found.root.name for _, found in imported] == ["Walker-v0-expert"]
    episodes = load(tmp_path / "ours/Walker-v0-expert")
    assert [row.length for row in episodes.rows] == [100, 20, 10]
    assert episodes.observation[0].tolist() == [190.0, 10.0, 20.0, 179.0, 1.0, 2.0, 300.0]
    assert torch.equal(episodes.action, action[:, [0, 2, 1, 3]])
    ends = [(bool(episodes.terminated[i]), bool(episodes.truncated[i])) for i in (99, 119, 129)]
    # time limit; fall; the buffer ends in an episode
    assert ends == [(False, True), (True, False), (False, True)]
    assert [row.about.whole for row in episodes.rows] == [True, True, False]
    assert [c.name for c in episodes.description.observation] == [
        e.name for e in get_task("Walker-v0").entries
    ]
    assert check(tmp_path / "ours/Walker-v0-expert") == []


def test_ends_of_the_paper_s_episodes_are_told_apart_by_their_length(tmp_path: Path) -> None:
    """A time limit was stored as any other end, and a recording that was broken off as none."""
    most = get_task("RunAway-v0").max_steps
    lengths = (3, most, most - 1, 2)
    steps = sum(lengths)
    done = torch.zeros(steps, dtype=torch.bool)
    done[[2, 2 + most, 1 + 2 * most]] = True
    observation = torch.arange(5.0 * (steps + 1)).view(-1, 5)
    save(tmp_path / "runaway", observation, torch.zeros(steps, 1), torch.ones(steps), done)
    ((source, dataset),) = import_paper(tmp_path / "runaway", tmp_path / "ours")
    assert source == tmp_path / "runaway" and dataset.description.env == "RunAway-v0"
    rows = dataset.rows
    assert [(row.length, row.terminated, row.about.whole) for row in rows] == [
        (3, True, True),
        (most, False, True),
        (most - 1, True, True),
        (2, False, False),
    ]
    assert load(tmp_path / "ours").truncated.nonzero().flatten().tolist() == [2 + most, steps - 1]
    assert {row.about.policy for row in rows} == {"runaway"}


@pytest.mark.parametrize(
    ("folder", "task", "policy"),
    [
        ("walker_expert", "Walker-v0", "expert"),
        ("spinning/random-2", "Spinning-v0", "random"),
        ("RoboArm/mine", "RoboArm-v0", "mine"),
        ("walker/runaway_expert", "RunAway-v0", "expert"),
    ],
)
def test_names_of_folders_tell_task_and_policy(folder: str, task: str, policy: str) -> None:
    path = Path("/nowhere") / folder
    assert (formats._task_of(path), formats._policy_of(path)) == (task, policy)


@pytest.mark.parametrize("before", [None, "elsewhere"])
def test_the_folder_of_minari_is_set_for_a_while(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, before: str | None
) -> None:
    name = "MINARI_DATASETS_PATH"
    monkeypatch.delenv(name, raising=False)
    if before is not None:
        monkeypatch.setenv(name, before)
    with formats._datasets_in(tmp_path / "x" / ".."):
        assert os.environ[name] == str(tmp_path.resolve())
    assert os.environ.get(name) == before


def test_acceleration_is_not_named_distance(tmp_path: Path) -> None:
    observation = torch.tensor([[0.0, 0, 0, 0, 0, 0, -900.0 + i] for i in range(11)])
    save(
        tmp_path / "old",
        observation,
        torch.zeros(10, 4),
        torch.zeros(10),
        torch.zeros(10, dtype=torch.bool),
    )
    import_paper(tmp_path / "old", tmp_path / "ours", env="Walker-v0")
    assert load(tmp_path / "ours").description.observation[-1].name == "acceleration_x"


def test_walker_with_an_acceleration_is_learned_from_without_the_distance(tmp_path: Path) -> None:
    """By the file of the documentation."""
    observation = torch.tensor([[0.0, 90, 180, 270, 1, 2, -900.0 + i] for i in range(11)])
    ends = torch.zeros(10, dtype=torch.bool)
    save(tmp_path / "old", observation, torch.zeros(10, 4), torch.zeros(10), ends)
    import_paper(tmp_path / "old", tmp_path / "ours", env="Walker-v0")
    page = (Path(__file__).parents[4] / "docs" / "data.md").read_text()
    task = tmp_path / "blind_walker.py"
    task.write_text(page.partition('title="blind_walker.py"\n')[2].partition("```")[0])
    with closing(make(str(task))) as env:
        found = read_for(str(tmp_path / "ours"), env, images=False)
        assert list(found.observation[0]) == [0, 90, 180, 270, 1, 2]
        env.rollout(2)


def test_all_four_tasks_expert_and_random(tmp_path: Path) -> None:
    sizes = {
        "Walker": (7, 4),
        "RoboArm": (4, 4),
        "2Wheeler/RunAway": (5, 1),
        "2Wheeler/Spinning": (6, 2),
    }
    for name, (n, m) in sizes.items():
        for policy in ("expert_data", "random_data"):
            goal = (
                {"goal_observation": torch.tensor([[-100.0, -70, 40, -90]]).repeat(21, 1)}
                if name == "RoboArm"
                else {}
            )
            done = torch.arange(20) % 10 == 9
            save(
                tmp_path / "paper" / name / policy,
                10 + torch.rand(21, n),
                torch.rand(20, m),
                torch.rand(20),
                done,
                **goal,
            )
    imported = import_paper(tmp_path / "paper", tmp_path / "ours")
    tasks = ("RoboArm-v0", "RunAway-v0", "Spinning-v0", "Walker-v0")
    assert sorted(found.root.name for _, found in imported) == [
        f"{task}-{policy}" for task in tasks for policy in ("expert", "random")
    ]
    arm = load(tmp_path / "ours/RoboArm-v0-random")
    assert arm.observation.shape == (20, 8) and arm.observation[0, 4:].tolist() == [
        270.0,
        40.0,
        -70.0,
        -100.0,
    ]
    assert [row.length for row in arm.rows] == [10, 10] and bool(arm.terminated[9])


class Bomb:
    def __reduce__(self):
        return (Path.touch, (Path(__file__).with_name("exploded"),))


@pytest.mark.parametrize(
    ("damage", "told"),
    [
        (lambda root: (root / "meta.json").write_text("{"), "not JSON"),
        (
            lambda root: (root / "meta.json").write_text("[1]"),
            "description .* is not JSON as we write it",
        ),
        (lambda root: (root / "action.memmap").write_bytes(b"1234"), "has 4 bytes"),
        (lambda root: (root / "action.memmap").unlink(), "cannot read"),
        (lambda root: (root / "meta.json").write_bytes(pickle.dumps(Bomb())), "not JSON"),
        (lambda root: (root / "next/meta.json").write_text("{}"), "no tensor observation"),
        (
            lambda root: replace_in(root / "meta.json", '"action"', '"../../secret"'),
            "not of the paper",
        ),
        (
            lambda root: replace_in(root / "meta.json", "torch.float32", "torch.complex64"),
            "not of the paper",
        ),
        (lambda root: reshape(root, "observation", []), "no steps in its tensor observation"),
        (lambda root: reshape(root, "observation", [0, 5]), "no steps in its tensor observation"),
        (lambda root: reshape(root, "action", [9]), "shapes that are not those"),
        (lambda root: reshape(root, "action", [3, 1]), "shapes that are not those"),
        (lambda root: reshape(root, "observation", [4, 6]), "observes 6 numbers"),
    ],
)
def test_damaged_or_hostile_folder_raises(tmp_path: Path, damage, told) -> None:
    root = tmp_path / "RunAway"
    save(root, torch.rand(5, 5), torch.rand(4, 1), torch.rand(4), torch.zeros(4, dtype=torch.bool))
    (root / "other.pickle").write_bytes(pickle.dumps(Bomb()))
    damage(root)
    with pytest.raises(DataError, match=told):
        import_paper(root, tmp_path / "ours")
    assert not (tmp_path / "ours").exists() and not Path(__file__).with_name("exploded").exists()


def test_goals_without_steps_raise(tmp_path: Path) -> None:
    root = tmp_path / "RoboArm"
    save(
        root,
        torch.rand(5, 4),
        torch.rand(4, 4),
        torch.rand(4),
        torch.zeros(4, dtype=torch.bool),
        goal_observation=torch.rand(5, 4),
    )
    reshape(root, "goal_observation", [3, 4])
    with pytest.raises(DataError, match="different numbers of steps"):
        import_paper(root, tmp_path / "ours")


def reshape(root: Path, name: str, shape: list[int]) -> None:
    """Replace a tensor by zeros of another shape."""
    meta = json.loads((root / "meta.json").read_text())
    meta[name]["shape"] = shape
    (root / "meta.json").write_text(json.dumps(meta))
    (root / f"{name}.memmap").write_bytes(bytes(4 * math.prod(shape)))


def replace_in(path: Path, old: str, new: str) -> None:
    text = path.read_text()
    assert old in text
    path.write_text(text.replace(old, new))


def test_unknown_task_must_be_given(tmp_path: Path) -> None:
    save(
        tmp_path / "buffer",
        torch.rand(5, 5),
        torch.rand(4, 1),
        torch.rand(4),
        torch.zeros(4, dtype=torch.bool),
    )
    with pytest.raises(DataError, match="--env"):
        import_paper(tmp_path / "buffer", tmp_path / "ours")
    with pytest.raises(DataError, match="observes 5 numbers"):
        import_paper(tmp_path / "buffer", tmp_path / "ours", env="Spinning-v0")
    with pytest.raises(DataError, match="there is no dataset"):
        import_paper(tmp_path / "nowhere", tmp_path / "ours")
    assert json.loads((tmp_path / "buffer/meta.json").read_text())


@pytest.mark.parametrize("name", ["observation", "next/observation", "action", "next/reward"])
@pytest.mark.parametrize(
    "bits", [0x7FC00000, 0x7F800001, 0x7F800000], ids=["nan", "signalling nan", "infinite"]
)
def test_non_finite_numbers_raise(tmp_path: Path, name: str, bits: int) -> None:
    done = torch.tensor([False, True])
    save(tmp_path / "RunAway", torch.rand(3, 5), torch.rand(2, 1), torch.rand(2), done)
    path = tmp_path / "RunAway" / f"{name}.memmap"
    path.write_bytes(bits.to_bytes(4, "little") + path.read_bytes()[4:])
    with pytest.raises(DataError, match=rf"numbers in its tensor {Path(name).name} that are none"):
        import_paper(tmp_path / "RunAway", tmp_path / "ours")
    assert not (tmp_path / "ours").exists()
