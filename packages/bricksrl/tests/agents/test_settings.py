"""Settings and presets."""

from __future__ import annotations

import enum
import subprocess
import sys
from collections.abc import Callable
from dataclasses import FrozenInstanceError, dataclass, replace
from pathlib import Path
from typing import Annotated, Any, Literal

import numpy as np
import pytest
from small import ENV, SIGHT
from toys import Cart

from brickhub.fields import check_value
from bricksrl.agents import AGENTS, PRESETS, algorithm, make_learner, preset
from bricksrl.agents.gradient_descent import GradientLearner
from bricksrl.agents.offline.act import ACTSettings
from bricksrl.agents.sac import SACSettings
from bricksrl.agents.settings import Positive, Range, Settings
from bricksrl.agents.td3 import TD3Settings
from bricksrl.errors import DescriptionError, UnknownNameError

OF_ALL = [
    {"learning_rate": 0.0},
    {"learning_rate": float("inf")},
    {"learning_rate": "fast"},
    {"learning_rate": True},
    {"gamma": float("nan")},
    {"batch_size": 0},
    {"gamma": 1.1},
    {"adam_beta": 1.0},
    {"hidden": ()},
    {"hidden": (8, 0)},
    {"hidden": (8, 20_000)},
    {"hidden": (8192, 8192, 1)},
    {"hidden": (8.0, 8)},
    {"prefill_episodes": -1},
    {"updates_per_step": 0},
    {"actor_delay": 0},
    {"angles": "degrees"},
    {"goals": "none"},
    {"encoder": "eyes"},
    {"hindsight": -0.1},
    {"hindsight": 0.6, "new_goals": 0.6},
    {"buffer_size": 1},
    {"n_step": 0},
    {"n_step": 65},
    {"shift_px": -1},
]
OF_ONE: list[tuple[str, dict[str, Any]]] = [
    ("sac", {"tau": 0.0}),
    ("sac", {"tau": 2.0}),
    ("sac", {"dropout": -0.1}),
    ("sac", {"dropout": 1.0}),
    ("sac", {"alpha_init": 0.0}),
    ("sac", {"min_scale": 0.0}),
    ("sac", {"num_qs": 0}),
    ("sac", {"num_min_qs": 3}),
    ("sac", {"actor_q": "max"}),
    ("td3", {"tau": 0.0}),
    ("td3", {"exploration_noise": -0.1}),
    ("td3", {"target_noise": -0.1}),
    ("td3", {"target_noise_clip": 0.0}),
    ("crossq", {"momentum": 0.0}),
    ("tqc", {"quantiles": 1}),
    ("tqc", {"dropped": -1}),
    ("tqc", {"dropped": 25}),
    ("bc", {"dropout": 1.0}),
    ("iql", {"expectile": 1.0}),
    ("iql", {"temperature": -1.0}),
    ("cql", {"min_q_weight": -1.0}),
    ("cql", {"sampled_actions": 0}),
    ("cql", {"drawn_actions": -1}),
    ("cql", {"imitation_updates": -1}),
    ("cql", {"lagrange_threshold": float("nan")}),
    ("td3bc", {"value_weight": 0.0}),
    ("ppo", {"clip_epsilon": 0.0}),
    ("ppo", {"gae_lambda": 1.1}),
    ("ppo", {"passes": 0}),
    ("act", {"chunk": 0}),
    ("act", {"executed": 0}),
    ("act", {"executed": 9}),
    ("act", {"ensemble": -0.1}),
    ("act", {"heads": 3}),
    ("act", {"dropout": 1.0}),
    ("act", {"latent": 0}),
    ("act", {"kl_weight": -1.0}),
    ("act", {"weight_decay": -1.0}),
    ("diffusion", {"denoising_steps": 0}),
    ("diffusion", {"ensemble": -1.0}),
]


@pytest.mark.parametrize(
    ("agent", "change"),
    [*((agent, change) for agent in ("sac", "td3", "crossq") for change in OF_ALL), *OF_ONE],
)
def test_invalid_settings_raise(agent: str, change: dict[str, Any]) -> None:
    with pytest.raises(DescriptionError, match=next(iter(change))) as caught:
        replace(preset("default", agent), **change)
    assert "\n" not in str(caught.value)


@pytest.mark.parametrize(
    ("agent", "change"),
    [
        ("sac", {"hidden": (1,)}),
        ("sac", {"hidden": (16_384,)}),
        ("sac", {"hidden": (8192, 8192)}),
        ("sac", {"hindsight": 0.5, "new_goals": 0.5}),
        ("sac", {"gamma": 1.0, "adam_beta": 0.0, "tau": 1.0, "shift_px": 64}),
        ("sac", {"batch_size": 1, "buffer_size": 2, "n_step": 64, "prefill_episodes": 0}),
        ("sac", {"num_qs": 1, "num_min_qs": 1, "dropout": 0.0}),
        ("tqc", {"quantiles": 25, "dropped": 24}),
        ("tqc", {"quantiles": 2, "dropped": 0}),
        ("act", {"chunk": 1, "executed": 1}),
        ("act", {"chunk": 8, "executed": 8}),
        ("cql", {"sampled_actions": 1, "drawn_actions": 0, "min_q_weight": 0.0}),
        ("ppo", {"gae_lambda": 1.0, "passes": 1}),
    ],
)
def test_settings_at_the_ends_of_their_ranges_are_taken(agent: str, change: dict[str, Any]) -> None:
    settings = replace(preset("default", agent), **change)
    assert {name: getattr(settings, name) for name in change} == change


@pytest.mark.parametrize(
    ("limits", "inside", "outside"),
    [
        (Range(0.0, 1.0), (0, 0.0, 1.0, 0.5), (-0.1, 1.1)),
        (Range(0.0, 1.0, above=True), (1e-9, 1.0), (0.0,)),
        (Range(0.0, 1.0, below=True), (0.0, 0.999), (1.0,)),
        (Positive, (1, 1e-9, 2**24), (0, -1.0, 2**24 + 1)),
    ],
)
def test_range_bounds(limits: Range, inside: tuple[float, ...], outside: tuple[float, ...]) -> None:
    assert all(value in limits for value in inside)
    assert not any(value in limits for value in outside)


def test_messages_name_allowed_values() -> None:
    with pytest.raises(DescriptionError, match=r"^gamma is 1.5; give a number from 0 to 1$"):
        SACSettings(gamma=1.5)
    with pytest.raises(DescriptionError, match=r"^tau is 0; give a number above 0 to 1$"):
        SACSettings(tau=0)
    with pytest.raises(
        DescriptionError, match=r"^angles is 'round'; choose phases, sincos or raw$"
    ):
        SACSettings(angles="round")  # type: ignore[arg-type]
    with pytest.raises(
        DescriptionError, match=r"^hidden is \(\); give the units of at least one layer"
    ):
        Settings(hidden=())
    with pytest.raises(DescriptionError, match=r"^batch_size is 2.5; give a whole number$"):
        SACSettings(batch_size=2.5)  # type: ignore[arg-type]
    with pytest.raises(DescriptionError, match=r"^memory_mapped is 'yes'; give True or False$"):
        SACSettings(memory_mapped="yes")  # type: ignore[arg-type]
    with pytest.raises(DescriptionError, match=r"^network is 3; give a text$"):
        SACSettings(network=3)  # type: ignore[arg-type]
    with pytest.raises(DescriptionError, match=r"^hidden is \('8',\); give"):
        SACSettings(hidden=("8",))  # type: ignore[arg-type]


def test_user_settings_are_checked_by_annotations() -> None:
    @dataclass(frozen=True)
    class Own(Settings):
        rate: Annotated[float, Range(0.0, 2.0)] = 1.0
        kind: Literal["a", "b"] = "a"
        maybe: Annotated[float | None, Positive] = None

    assert Own(rate=2, maybe=3.0, kind="b").maybe == 3.0
    for change in ({"rate": 3.0}, {"kind": "c"}, {"maybe": 0.0}, {"batch_size": 0}):
        with pytest.raises(DescriptionError, match=next(iter(change))):
            Own(**change)  # type: ignore[arg-type]
    with pytest.raises(FrozenInstanceError):
        Own().rate = 0.5  # type: ignore[misc]
    check_value("anything", "goes", str)


class Shade(enum.Enum):
    DARK = "dark"
    LIGHT = "light"


@pytest.mark.parametrize(
    ("value", "hint", "message"),
    [
        ("dark", Shade, "x is 'dark'; give Shade.DARK or Shade.LIGHT"),
        ("dark", Shade | None, "x is 'dark'; give Shade.DARK or Shade.LIGHT"),
        (3, Path | None, "x is 3; give the path of a file"),
        (b"3", int | str, "x is b'3'; give a whole number or a text"),
        (list(range(99)), str, "x is of type list; give a text"),
        (True, float, "x is True; give a number"),
    ],
)
def test_message_names_wanted_types(value: object, hint: Any, message: str) -> None:
    with pytest.raises(DescriptionError) as caught:
        check_value("x", value, hint)
    assert str(caught.value) == message


@pytest.mark.parametrize(
    ("value", "hint"),
    [
        (Shade.DARK, Shade),
        (None, Shade | None),
        (np.float64(3), float),
        (3, float | None),
        (len, Callable),
        ([], Any),
    ],
)
def test_values_of_wanted_types_pass(value: object, hint: Any) -> None:
    check_value("x", value, hint)


@pytest.mark.parametrize("agent", AGENTS)
def test_every_field_has_help(agent: str) -> None:
    import ast
    import inspect

    for kind in algorithm(agent).settings.__mro__[:-1]:
        body = ast.parse(inspect.getsource(kind)).body[0]
        assert isinstance(body, ast.ClassDef)
        for field, following in zip(body.body, [*body.body[1:], None], strict=True):
            if isinstance(field, ast.AnnAssign) and isinstance(field.target, ast.Name):
                inherited = any(
                    field.target.id in getattr(base, "__annotations__", {})
                    for base in kind.__mro__[1:]
                )
                assert inherited or isinstance(following, ast.Expr), field.target.id


WITHOUT_LOSS = ("gait", "random")


@pytest.mark.parametrize("name", PRESETS)
@pytest.mark.parametrize("agent", AGENTS)
def test_every_preset_builds_every_agent(name: str, agent: str) -> None:
    if (name, agent) == ("paper", "act"):  # its authors' transformers have millions of weights
        assert preset(name, agent).decoder_layers == 7
        return
    for env in (ENV, Cart()):
        learner = make_learner(agent, env, preset(name, agent))
        assert learner.prefill_episodes == getattr(preset(name, agent), "prefill_episodes", 0)
        assert isinstance(learner, GradientLearner) != (agent in WITHOUT_LOSS)


@pytest.mark.parametrize("name", PRESETS)
@pytest.mark.parametrize("agent", [agent for agent in AGENTS if agent not in ("act", "gait")])
def test_every_preset_builds_every_agent_for_images(name: str, agent: str) -> None:
    changes = {"encoder": "keypoints"} if agent != "random" else {}
    learner = make_learner(agent, SIGHT, replace(preset(name, agent, images=True), **changes))
    assert ("image" in learner.policy.in_keys) == (agent != "random")


def test_image_preset_is_small() -> None:
    plain, images = preset("default", "sac"), preset("default", "sac", images=True)
    assert (images.hidden, images.batch_size, images.buffer_size, images.encoder) == (
        (128, 128),
        64,
        15_000,
        "keypoints",
    )
    assert (plain.hidden, plain.batch_size, plain.buffer_size) == ((256, 256), 128, 1_000_000)
    assert "image" in make_learner("sac", SIGHT).policy.in_keys
    assert preset("paper", "sac", images=True).encoder == "convolutions"


@pytest.mark.parametrize("name", PRESETS)
@pytest.mark.parametrize("agent", AGENTS)
@pytest.mark.parametrize("images", [False, True])
def test_preset_values_are_known_settings(name: str, agent: str, images: bool) -> None:
    assert isinstance(preset(name, agent, images=images), algorithm(agent).settings)


def test_paper_preset_equals_paper() -> None:
    for agent in ("sac", "td3", "iql", "cql", "td3bc", "tqc"):
        paper = preset("paper", agent)
        assert (paper.learning_rate, paper.batch_size, paper.gamma, paper.tau) == (
            3e-4,
            256,
            0.99,
            0.005,
        )
        assert (paper.hidden, paper.prefill_episodes, paper.updates_per_step) == (
            (256, 256),
            10,
            1.0,
        )
        assert (paper.angles, paper.goals, paper.critic_norm) == ("raw", "plain", "none")
        assert (paper.hindsight, paper.new_goals, paper.n_step) == (0.0, 0.0, 1)
        assert paper.buffer_size == 1_000_000
    assert (preset("paper", "sac").alpha_init, preset("paper", "sac").actor_delay) == (1.0, 1)


def test_paper_td3_equals_its_authors_and_droq_what_was_released() -> None:
    td3, droq = preset("paper", "td3"), preset("paper", "droq")
    assert isinstance(td3, TD3Settings)
    assert (td3.actor_delay, td3.exploration_noise, td3.target_noise, td3.target_noise_clip) == (
        2,
        0.1,
        0.2,
        0.5,
    )
    assert isinstance(droq, SACSettings)
    assert (droq.updates_per_step, droq.actor_delay, droq.dropout, droq.critic_norm) == (
        20.0,
        1,
        0.01,
        "layer",
    )
    assert (droq.actor_dropout, droq.actor_norm) == (0.01, "layer")
    assert (droq.num_qs, droq.num_min_qs, droq.actor_q) == (2, 2, "mean")


def test_paper_offline_agents_equal_paper() -> None:
    bc, iql, cql = (preset("paper", name) for name in ("bc", "iql", "cql"))
    assert (bc.hidden, bc.learning_rate, bc.batch_size, bc.actor_norm, bc.dropout) == (
        (256, 256),
        3e-4,
        256,
        "layer",
        0.01,
    )
    assert (iql.temperature, iql.expectile) == (1.0, 0.5)
    assert (
        cql.min_q_weight,
        cql.sampled_actions,
        cql.lagrange_threshold,
        cql.imitation_updates,
    ) == (1.0, 10, 5.0, 1000)


def test_act_values_equal_its_authors() -> None:
    act = preset("paper", "act")
    assert isinstance(act, ACTSettings)
    assert (act.learning_rate, act.batch_size, act.chunk, act.kl_weight, act.dropout) == (
        1e-5,
        8,
        100,
        10.0,
        0.1,
    )
    assert (act.encoder_layers, act.decoder_layers, act.feedforward, act.width, act.heads) == (
        4,
        7,
        3200,
        512,
        8,
    )
    assert (act.executed, act.ensemble, act.latent, act.weight_decay) == (1, 0.01, 32, 1e-4)


@pytest.mark.parametrize("name", PRESETS)
def test_redq_has_ten_critics_two_for_targets(name: str) -> None:
    redq = preset(name, "redq")
    assert (redq.num_qs, redq.num_min_qs, redq.actor_q) == (10, 2, "mean")
    assert (redq.critic_norm, redq.dropout) == ("none", 0.0)
    assert redq.updates_per_step == redq.actor_delay == 20


def test_unknown_names_list_known_ones() -> None:
    with pytest.raises(UnknownNameError, match=r"no preset 'papr'; choose one of .*paper"):
        preset("papr")
    for wrong in (
        lambda: make_learner("dqn", ENV),
        lambda: preset("paper", "dqn"),
        lambda: algorithm("dqn"),
    ):
        with pytest.raises(
            UnknownNameError,
            match=r"no agent 'dqn'; choose one of sac, droq, .*, or give a file: my_agent.py",
        ):
            wrong()


def test_settings_of_another_agent_raise() -> None:
    with pytest.raises(
        DescriptionError, match=r"TD3Settings, not SACSettings; see preset\('default', 'td3'\)"
    ):
        make_learner("td3", ENV, preset("default", "sac"))


def test_names_import_no_torch() -> None:
    code = (
        "import sys, bricksrl.agents, bricksrl.agents.settings\n"
        "sys.exit(any(name in sys.modules for name in ('torch', 'matplotlib', 'mujoco', "
        "'pyarrow')))"
    )
    subprocess.run([sys.executable, "-c", code], check=True, timeout=60)
