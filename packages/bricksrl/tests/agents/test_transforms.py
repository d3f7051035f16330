"""Transforms between an environment and its agents: what reaches the networks, and what is held
within what was learned on."""

from __future__ import annotations

import logging
import math
from collections.abc import Callable
from typing import Any

import numpy as np
import pytest
import torch
from small import Sight
from tensordict import TensorDict, TensorDictBase
from torch import Tensor
from torchrl.data import Bounded, Composite, NonTensor, Unbounded
from torchrl.envs import (
    ActionDiscretizer,
    CatFrames,
    CatTensors,
    Compose,
    DoubleToFloat,
    DTypeCastTransform,
    EnvBase,
    ExcludeTransform,
    FlattenObservation,
    InitTracker,
    ObservationNorm,
    ObservationTransform,
    RenameTransform,
    RewardScaling,
    SqueezeTransform,
    StepCounter,
    Timer,
    ToTensorImage,
    TrajCounter,
    Transform,
    TransformedEnv,
    UnsqueezeTransform,
    VecNorm,
    VecNormV2,
    gSDENoise,
)
from torchrl.envs.utils import ExplorationType, set_exploration_type

import bricksrl
from brickhub.entry import Entry
from bricksrl.agents import make_learner, preset
from bricksrl.agents.features.encoder import Encoder, encode, make_encoder
from bricksrl.envs.rollout import play_episodes
from bricksrl.envs.specs import Number, ObservationLayout
from bricksrl.envs.transforms import (
    FrameSkip,
    changes_nothing,
    keeps_vectors,
    layout_of,
    numbers_of,
    own_frames,
    prepare,
    runs_on,
)
from bricksrl.envs.transforms.rows import has_unit, numbers_behind
from bricksrl.errors import DescriptionError

KEYS = ["observation"]


class Mixed(Transform):
    """Reverses the vector, leaves half of it out, and scales the rest."""

    def __init__(self) -> None:
        super().__init__(in_keys=KEYS, out_keys=KEYS)

    def _apply_transform(self, observation: Tensor) -> Tensor:
        return observation.flip(-1)[..., ::2] * -0.25 + 3.0

    def _reset(
        self, _tensordict: TensorDictBase, tensordict_reset: TensorDictBase
    ) -> TensorDictBase:
        return self._call(tensordict_reset)

    def transform_observation_spec(self, observation_spec: Composite) -> Composite:
        spec = observation_spec["observation"]
        observation_spec["observation"] = Unbounded((*spec.shape[:-1], 4), device=spec.device)
        return observation_spec


class Embedding(Transform):
    """Sixteen numbers that are made of all entries, beside them."""

    def __init__(self) -> None:
        super().__init__(in_keys=KEYS, out_keys=["embedding"])

    def _apply_transform(self, observation: Tensor) -> Tensor:
        return torch.sin(observation.sum(-1, keepdim=True) * torch.arange(1, 17))

    def _reset(
        self, _tensordict: TensorDictBase, tensordict_reset: TensorDictBase
    ) -> TensorDictBase:
        return self._call(tensordict_reset)

    def transform_observation_spec(self, observation_spec: Composite) -> Composite:
        observation_spec["embedding"] = Unbounded(16)
        return observation_spec


class Noisy(ObservationTransform):
    """Adds noise to each number, of 5 degrees."""

    def __init__(self) -> None:
        super().__init__(in_keys=KEYS, out_keys=KEYS)

    def _apply_transform(self, observation: Tensor) -> Tensor:
        return observation + 5.0 * torch.randn_like(observation)

    def _reset(
        self, _tensordict: TensorDictBase, tensordict_reset: TensorDictBase
    ) -> TensorDictBase:
        return self._call(tensordict_reset)


class Swapped(Transform):
    """Exchanges the joints that an action moves."""

    def __init__(self) -> None:
        super().__init__(in_keys_inv=["action"], out_keys_inv=["action"])

    def _inv_apply_transform(self, action: Tensor) -> Tensor:
        return action.flip(-1)


class Endless(Transform):
    """Goes on after the end of an episode."""

    def _step(self, _tensordict: TensorDictBase, next_tensordict: TensorDictBase) -> TensorDictBase:
        return next_tensordict.update(
            {name: torch.zeros(1, dtype=torch.bool) for name in ("done", "terminated", "truncated")}
        )


class Forgetful(Noisy):
    """Leaves half of the vector out, and says nothing in its spec."""

    def _apply_transform(self, observation: Tensor) -> Tensor:
        return observation[..., :4]


def arm(*transforms: Transform) -> EnvBase:
    env = TransformedEnv(bricksrl.make("RoboArmSim-v0", seed=3), Compose(*transforms))
    prepare(env)
    return env


def features(env: EnvBase) -> tuple[Tensor, Tensor, ObservationLayout]:
    """Features of an observation after two steps, the observation of the arm itself, and the
    layout."""
    settings = preset("default", "sac")
    encoder = make_encoder(env, settings)
    state = env.reset()
    for _ in range(2):
        frame = env.step(state.update(env.full_action_spec.rand()))
        own = own_frames(env, frame)[-1]["next", "observation"]
        state = env.step_mdp(frame)
    return encode(encoder, state), own, layout_of(env)


UNCHANGED: dict[str, Callable[[], list[Transform]]] = {
    "renamed": lambda: [RenameTransform(KEYS, ["joints"])],
    "unsqueezed and squeezed": lambda: [
        UnsqueezeTransform(-1, in_keys=KEYS),
        SqueezeTransform(-1, in_keys=KEYS),
    ],
    "as a matrix": lambda: [UnsqueezeTransform(-1, in_keys=KEYS)],
    "normalised": lambda: [
        ObservationNorm(
            torch.linspace(-90, 90, 8), torch.linspace(20, 90, 8), KEYS, standard_normal=True
        )
    ],
    "running statistics": lambda: [VecNormV2(in_keys=KEYS)],
    "running statistics of the reward too": lambda: [VecNorm(in_keys=[*KEYS, "reward"])],
    "noted by TorchRL": lambda: [
        Timer(),
        StepCounter(),
        InitTracker(),
        gSDENoise(state_dim=8, action_dim=4),
    ],
    "frozen statistics": lambda: [VecNormV2(in_keys=KEYS), RewardScaling(0.0, 0.1)],
    "double and float": lambda: [
        DTypeCastTransform(torch.float32, torch.float64, in_keys=KEYS),
        DoubleToFloat(in_keys=KEYS),
    ],
}


@pytest.mark.filterwarnings("ignore::FutureWarning")
@pytest.mark.parametrize("name", UNCHANGED)
def test_angles_and_goals_survive_where_the_numbers_do(name: str) -> None:
    env = arm(*UNCHANGED[name]())
    made, own, layout = features(env)
    plain = bricksrl.make("RoboArmSim-v0")
    torch.testing.assert_close(
        made, make_encoder(plain, preset("default", "sac"))(own), atol=1e-4, rtol=1e-4
    )
    before = layout_of(plain)
    assert (layout.wraps, layout.goals, layout.names) == (before.wraps, before.goals, before.names)


def test_stacked_frames_are_stacked_entries() -> None:
    env = arm(CatFrames(3, -1, in_keys=KEYS))
    made, own, layout = features(env)
    assert layout.names == layout_of(bricksrl.make("RoboArmSim-v0")).names * 3
    assert layout.goals == tuple(
        (8 * frame + goal, 8 * frame + goal - 4) for frame in range(3) for goal in range(4, 8)
    )
    angles = [index for index, wraps in enumerate(layout.wraps) if wraps]
    assert angles == [0, 4, 8, 12, 16, 20]
    assert layout.past == {index: 16 + index % 8 for index in range(16)}
    sines = made[18 : 18 + 6]  # after the linear entries
    torch.testing.assert_close(sines[4], torch.sin(own[0] * math.pi / 180), atol=1e-5, rtol=0)


@pytest.mark.parametrize("transform", [Mixed, Noisy])
def test_numbers_of_an_own_transform_are_new(transform: type[Transform]) -> None:
    made, _, layout = features(arm(transform()))
    assert layout.names == tuple(f"observation_{index}" for index in range(len(layout.names)))
    assert (layout.goals, any(layout.wraps), made.shape[-1]) == ((), False, len(layout.names))


def test_rounding_changes_no_meaning() -> None:
    before = layout_of(bricksrl.make("RoboArmSim-v0"))
    layout = layout_of(arm(DTypeCastTransform(torch.float32, torch.int32, in_keys=KEYS)))
    assert (layout.wraps, layout.goals) == (before.wraps, before.goals)


class Undeclared(Transform):
    """Writes what it does not name."""

    def _call(self, next_tensordict: TensorDictBase) -> TensorDictBase:
        return next_tensordict.set("observation", next_tensordict["observation"].flip(-1))


def test_only_what_a_transform_names_is_new_behind_it() -> None:
    before = layout_of(bricksrl.make("RoboArmSim-v0")).names
    assert layout_of(arm(Embedding())).names[:8] == before
    assert layout_of(arm(Swapped())).names == before
    for transform in (Undeclared(), lambda frame: frame.set("observation", frame["observation"])):
        assert not set(layout_of(arm(transform)).names) & set(before)  # type: ignore[arg-type]


def middle_and_half() -> tuple[Tensor, Tensor]:
    return torch.linspace(-90, 90, 8), torch.linspace(20, 90, 8)


FOLLOWED: dict[str, Callable[[], list[Transform]]] = {
    "stacked, then normalised": lambda: [
        CatFrames(3, -1, in_keys=KEYS),
        ObservationNorm(torch.linspace(-9, 9, 24), torch.linspace(1, 3, 24), KEYS),
    ],
    "normalised twice, then stacked": lambda: [
        ObservationNorm(*middle_and_half(), KEYS, standard_normal=True),
        ObservationNorm(torch.linspace(-1, 1, 8), torch.linspace(2, 3, 8), KEYS),
        CatFrames(2, -1, in_keys=KEYS, out_keys=["frames"]),
    ],
    "stacks of stacks": lambda: [
        CatFrames(2, -1, in_keys=KEYS),
        CatFrames(2, -1, in_keys=KEYS, padding="same"),
    ],
    "rows of frames, flat": lambda: [
        UnsqueezeTransform(-2, in_keys=KEYS),
        CatFrames(3, -2, in_keys=KEYS),
        FlattenObservation(-2, -1, in_keys=KEYS),
    ],
    "columns of frames": lambda: [
        UnsqueezeTransform(-1, in_keys=KEYS),
        SqueezeTransform(-2, in_keys=KEYS),
        CatFrames(2, -1, in_keys=KEYS),
    ],
    "a copy joined": lambda: [
        RenameTransform(KEYS, ["again"], create_copy=True),
        ObservationNorm(*middle_and_half(), in_keys=["again"], standard_normal=True),
        CatTensors(["observation", "again"], "both"),
    ],
    "beside new numbers": lambda: [Embedding(), CatTensors([*KEYS, "embedding"], "both")],
    "from step to step": lambda: [FrameSkip(1), CatFrames(2, -1, in_keys=KEYS), StepCounter()],
}


@pytest.mark.parametrize("name", FOLLOWED)
def test_numbers_are_what_the_layout_says(name: str) -> None:
    """Each number with a known entry is its ``scale * entry + offset``, of its own frame."""
    env = arm(*FOLLOWED[name]())
    own_names = layout_of(bricksrl.make("RoboArmSim-v0")).names
    numbers = [number for numbers in numbers_of(env).values() for number in numbers]
    known = [index for index, number in enumerate(numbers) if number.entry.name in own_names]
    assert known
    torch.manual_seed(0)
    state, past = env.reset(), list[Tensor]()
    for _ in range(6):
        frame = env.step(state.update(env.full_action_spec.rand()))
        past += [own["next", "observation"] for own in own_frames(env, frame)]
        state = env.step_mdp(frame)
    made = torch.cat([state[key].flatten() for key in layout_of(env).keys])
    said = [
        number.scale * past[-1 - number.frame][own_names.index(number.entry.name)] + number.offset
        for number in (numbers[index] for index in known)
    ]
    torch.testing.assert_close(made[known], torch.stack(said), atol=1e-4, rtol=1e-4)
    if name == "beside new numbers":
        assert len(numbers) - len(known) == 16
    else:
        assert len(known) == len(numbers)


def known(*shape: int) -> dict[str, Any]:
    """The numbers a, b, c... of a vector, once scaled."""
    numbers = np.empty(math.prod(shape), dtype=object)
    numbers[:] = [Number(Entry(letter), 2.0, 1.0) for letter in "abcdefghijkl"[: math.prod(shape)]]
    return {"observation": numbers.reshape(shape)}


def row(transform: Transform, *shape: int) -> tuple[Any, ...] | None:
    """Shape, names and frames behind a transform of a vector of this shape; ``None`` if new."""
    after = numbers_behind(transform, known(*shape)).get("observation")
    if after is None:
        return None
    frames = [number.frame for number in after.ravel()]
    return after.shape, "".join(number.entry.name for number in after.ravel()), frames


def test_a_place_counted_from_the_end_is_known_and_one_from_the_front_is_not() -> None:
    ones, two = [0] * 6, [0, 0]
    assert row(UnsqueezeTransform(-1, in_keys=KEYS), 2) == ((2, 1), "ab", two)
    assert row(UnsqueezeTransform(0, allow_positive_dim=True, in_keys=KEYS), 2) is None
    assert row(SqueezeTransform(-1, in_keys=KEYS), 2, 1) == ((2,), "ab", two)
    assert row(SqueezeTransform(-2, in_keys=KEYS), 1, 2) == ((2,), "ab", two)
    assert row(SqueezeTransform(-1, in_keys=KEYS), 1, 2) == ((1, 2), "ab", two)
    assert row(SqueezeTransform(0, allow_positive_dim=True, in_keys=KEYS), 1, 2) is None
    assert row(SqueezeTransform(-3, in_keys=KEYS), 1, 2) is None
    assert row(FlattenObservation(-2, -1, in_keys=KEYS), 2, 3) == ((6,), "abcdef", ones)
    assert row(FlattenObservation(-1, -1, in_keys=KEYS), 2, 3) == ((2, 3), "abcdef", ones)
    shapes = {(-2, -1): (2, 6), (-3, -2): (6, 2), (-3, -1): (12,)}
    for (first, last), shape in shapes.items():
        found = row(FlattenObservation(first, last, in_keys=KEYS), 2, 3, 2)
        assert found == (shape, "abcdefghijkl", [0] * 12)
    assert row(FlattenObservation(-3, -1, in_keys=KEYS), 2, 3) is None
    assert row(FlattenObservation(0, 1, allow_positive_dim=True, in_keys=KEYS), 2, 3) is None
    assert row(CatFrames(3, -1, in_keys=KEYS), 2) == ((6,), "ababab", [2, 2, 1, 1, 0, 0])
    assert row(CatFrames(2, -2, in_keys=KEYS), 1, 2) == ((2, 2), "abab", [1, 1, 0, 0])
    assert row(CatFrames(2, -2, in_keys=KEYS), 2) is None


def test_statistics_of_another_shape_or_without_deviation_make_new_numbers() -> None:
    def normalised(mean: list[Any], deviation: list[Any], *, is_inverse: bool) -> Any:
        statistics = torch.tensor(mean), torch.tensor(deviation)
        transform = ObservationNorm(*statistics, KEYS, standard_normal=is_inverse)
        after = numbers_behind(transform, known(2)).get("observation")
        return None if after is None else [(number.scale, number.offset) for number in after]

    # What was 2 * entry + 1 is divided, or multiplied.
    divided, multiplied = [(1.0, -0.5), (0.5, -0.75)], [(4.0, 4.0), (8.0, 8.0)]
    mean, deviation = [2.0, 4.0], [2.0, 4.0]
    assert normalised(mean, deviation, is_inverse=True) == divided
    assert normalised(mean, deviation, is_inverse=False) == multiplied
    assert normalised([mean] * 3, [deviation] * 3, is_inverse=True) == divided
    assert normalised([0.0], [2.0], is_inverse=False) == [(4.0, 2.0)] * 2
    assert normalised(mean, [2.0, 0.0], is_inverse=True) is None
    assert normalised(mean, [2.0, 0.0], is_inverse=False) == [(4.0, 4.0), (0.0, 4.0)]
    for is_inverse in (True, False):
        assert normalised([1.0] * 3, deviation, is_inverse=is_inverse) is None
        assert normalised(mean, [1.0] * 3, is_inverse=is_inverse) is None


def test_a_renamed_vector_is_no_longer_under_its_old_name() -> None:
    before = known(2)
    for is_copy, keys in ((False, {"other"}), (True, {"observation", "other"})):
        renamed = RenameTransform(KEYS, ["other"], create_copy=is_copy)
        assert numbers_behind(renamed, before).keys() == keys
        assert numbers_behind(renamed, {}) == {}


@pytest.mark.parametrize(
    ("entry", "has"),
    [
        (Entry("wind"), False),
        (Entry("wind", low=0.0), False),
        (Entry("wind", high=0.0), False),
        (Entry("wind", 0.0, 9.0), True),
        (Entry("arm_goal"), True),
        (Entry("left_angle"), True),
        (Entry("goal_of_wind"), False),
        (Entry("turn", wraps=True), True),
    ],
)
def test_angles_goals_and_what_has_a_range_have_units(entry: Entry, has: bool) -> None:
    assert has_unit(entry) is has


def test_numbers_of_several_vectors_are_read() -> None:
    made, own, layout = features(arm(Embedding()))
    assert layout.keys == ["observation", "embedding"]
    assert layout.names[8] == "embedding_0"
    plain = make_encoder(bricksrl.make("RoboArmSim-v0"), preset("default", "sac"))
    assert made.shape[-1] == plain.size + 16
    torch.testing.assert_close(
        made[6 : 6 + 16], torch.sin(own.sum() * torch.arange(1, 17)), atol=1e-3, rtol=0
    )


def test_what_no_agent_reads_is_an_error() -> None:
    env = bricksrl.make("RoboArmSim-v0")
    for name, spec in {
        "said": NonTensor(()),
        "volume": Unbounded((2, 3, 4, 5)),
        "inner": Composite(x=Unbounded(2)),
    }.items():
        env.observation_spec = Composite(
            observation=env.observation_spec["observation"], **{name: spec}
        )
        with pytest.raises(DescriptionError, match=f"'{name}'"):
            layout_of(env)
    env.observation_spec = Composite(image=Bounded(0, 1, (3, 20, 30)))
    with pytest.raises(DescriptionError, match="'image' of shape"):
        layout_of(env)


@pytest.mark.parametrize(
    ("transform", "says"),
    [
        (lambda: ExcludeTransform(*KEYS), "nothing that an agent observes"),
        (lambda: ObservationNorm(in_keys=KEYS), "ObservationNorm fails .*init_stats"),
        (TrajCounter, "TrajCounter fails"),
        (Forgetful, r"'observation' \[4\]; correct transform_observation_spec"),
        (lambda: ActionDiscretizer(3), "gives no such action .*int64"),
        (lambda: RenameTransform(["reward"], ["pay"]), "no 'action' or no 'reward'"),
    ],
)
def test_what_no_agent_learns_behind_is_refused_by_name(
    transform: Callable[[], Transform], says: str
) -> None:
    env = TransformedEnv(bricksrl.make("RoboArmSim-v0", seed=3), transform())
    with pytest.raises(DescriptionError, match=says):
        make_learner("sac", env)


class Odd(Sight):
    """Observes a scalar, text, a part of a group, and an image that is no square, and is told
    nothing else."""

    def __init__(self) -> None:
        super().__init__()
        wide = Bounded(0, 255, (3, 20, 30), dtype=torch.uint8)
        self.observation_spec = Composite(
            x=Bounded(-1, 1, ()), said=NonTensor(()), arm=Composite(angle=Unbounded(2)), wide=wide
        )

    def _jump(self) -> TensorDict:
        return self.observation_spec.rand()


def test_transforms_make_readable_what_no_agent_reads() -> None:
    out, angle = ExcludeTransform("said", "wide"), RenameTransform([("arm", "angle")], ["angle"])
    env = TransformedEnv(
        Odd(), Compose(UnsqueezeTransform(-1, in_keys=["x"], out_keys=["x"]), angle, out)
    )
    assert layout_of(env).names == ("x_0", "arm.angle_0", "arm.angle_1")


def test_running_statistics_of_an_image_keep_the_units_of_a_vector() -> None:
    env = TransformedEnv(
        Sight(), Compose(ToTensorImage(in_keys=["image"]), VecNormV2(in_keys=["image"]))
    )
    both = TransformedEnv(
        Sight(), Compose(ToTensorImage(in_keys=["image"]), VecNormV2(in_keys=["image", *KEYS]))
    )
    for one in (env, both):
        prepare(one)
        assert layout_of(one).names == ("observation_0", "observation_1")
        assert one.rollout(3)["next", "image"].shape == (3, 3, 32, 32)


def test_images_alone_and_several_are_read() -> None:
    env = bricksrl.make("RoboArmSim-v0")
    env.observation_spec = Composite(
        left=Bounded(0, 255, (32, 32, 3), dtype=torch.uint8), right=Bounded(0, 1, (4, 20, 20))
    )
    encoder = make_encoder(env, preset("default", "sac"))
    assert encoder.size == 64
    observed = TensorDict(
        {"left": torch.zeros(5, 32, 32, 3, dtype=torch.uint8), "right": torch.rand(5, 4, 20, 20)},
        [5],
    )
    assert encode(encoder, observed).shape == (5, 64)


def test_goals_are_replaced_only_where_the_task_observes_and_pays() -> None:
    plain = bricksrl.make("RoboArmSim-v0")
    assert changes_nothing(plain)
    assert changes_nothing(arm(DoubleToFloat()))
    assert not changes_nothing(arm(CatFrames(2, -1, in_keys=KEYS)))
    assert not changes_nothing(arm(RewardScaling(0.0, 2.0)))
    assert keeps_vectors(arm(RewardScaling(0.0, 2.0)))
    for transform in (
        Swapped(),
        RenameTransform(KEYS, ["joints"]),
        UnsqueezeTransform(-1, in_keys=KEYS),
    ):
        assert not changes_nothing(arm(transform))
        assert not keeps_vectors(arm(transform)), "a mirrored batch would be wrong"


def test_what_depends_on_the_episodes_before_is_known() -> None:
    statistics = ObservationNorm(torch.zeros(8), torch.ones(8), KEYS)
    assert not runs_on(arm(statistics, CatFrames(2, -1, in_keys=KEYS), StepCounter(), Noisy()))
    assert runs_on(arm(VecNormV2(in_keys=KEYS)))


def test_a_hidden_end_is_refused() -> None:
    env = arm(Endless())
    with pytest.raises(DescriptionError, match="a transform hides the end of the episode"):
        next(play_episodes(env, lambda state: state.set("action", torch.zeros(4)), 1, 0))


def test_an_acting_agent_is_held_within_what_it_learned_on(
    caplog: pytest.LogCaptureFixture,
) -> None:
    env = bricksrl.make("WalkerSim-v0", seed=0)
    learner = make_learner("sac", env)
    learner.remember(env.rollout(20))
    state = env.reset()
    far = state.clone()
    far["observation"][6] = 2000.0  # the distance, which a kinematic simulation reads as 0
    with caplog.at_level(logging.WARNING):
        assert torch.equal(learner.exploit(state)["action"], learner.exploit(far)["action"])
        learner.exploit(far)
    assert [record.getMessage() for record in caplog.records] == [
        "distance reads 2000, but the agent learned with 0: it acts as if it read that"
    ]
    (learning,) = (module for module in learner.loss.modules() if isinstance(module, Encoder))  # type: ignore[union-attr]
    assert float(encode(learning, far)[2]) == pytest.approx(1.0)  # what is learned from is not held
    with set_exploration_type(ExplorationType.RANDOM):
        assert float(encode(learner.policy.module[0].module.encoder, far)[2]) == pytest.approx(1.0)


def test_normalised_numbers_have_no_mean_and_unit_deviation() -> None:
    env = bricksrl.make("RoboArmSim-v0", seed=0)
    learner = make_learner("sac", env, preset("default", "sac").__class__(normalize=True))
    frames = env.rollout(200, break_when_any_done=False)
    learner.remember(frames)
    (encoder,) = (module for module in learner.loss.modules() if isinstance(module, Encoder))  # type: ignore[union-attr]
    numbers = encode(encoder, frames)[:, :6]
    assert float(numbers.mean(0).abs().max()) < 0.1
    torch.testing.assert_close(numbers.std(0), torch.ones(6), atol=0.1, rtol=0)
