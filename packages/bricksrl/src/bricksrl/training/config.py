"""Configuration of training runs: plain data. Importing this loads no torch."""

import dataclasses
import sys
from collections.abc import Callable, Iterator, Mapping
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Annotated, Any, Literal

import numpy as np

from brickhub.fields import Count, Range, check_fields
from brickhub.options import Existing, Flag, option
from brickhub.seed import check_seed
from brickhub.user_files import NotCode, code_names, with_absolute_file, without_folder
from bricksrl.agents import AGENTS, algorithm, preset
from bricksrl.agents.settings import CriticSettings, OffPolicySettings, TargetSettings
from bricksrl.data.dataset import existing_dataset
from bricksrl.envs.options import EnvOptions
from bricksrl.envs.registry import LABELS, get_task, option_types
from bricksrl.errors import BricksError, DescriptionError, RunError, UnknownNameError, counted, hint
from bricksrl.training.existing_run import existing_run
from bricktwin.twin.physics import Physics

SCRIPTED = "scripted"
"""Base that is the hand-written controller of the environment."""
Rule = tuple[Callable[["TrainConfig"], object], str]
"""When options do not go together, and what to say then."""


def _look_for_base(base: str) -> None:
    if base != SCRIPTED:
        existing_run(base)


@dataclass(frozen=True, kw_only=True)
class RunOptions:
    """How to train: device, several robots, evaluations, records, and what is known beforehand."""

    start: Annotated[
        str | None, option(name="from", metavar="RUN"), NotCode(), Existing(existing_run)
    ] = None
    """Let the agent of this run go on learning, here or in another world."""
    base: Annotated[str | None, option(metavar="RUN"), NotCode(), Existing(_look_for_base)] = None
    """Add what is learned to the actions of a frozen policy: the folder of a run, or scripted for
    the hand-written controller."""
    demonstrations: Annotated[
        str | None, option(metavar="DIR"), NotCode(), Existing(existing_dataset)
    ] = None
    """Imitate a dataset first, and draw half of each batch from it; of a run its steps, with what
    its policy does in them."""
    num_envs: Annotated[Count, option(metavar="N")] = 1
    """Copies to train on in parallel: a simulation runs as one batch, virtual robots in one process
    each."""
    robots: Annotated[Count, option(metavar="N")] = 1
    """Virtual robots that train one agent, each in its process; real ones are named by the hub,
    such as ble:A,ble:B."""
    device: Annotated[str, option(metavar="NAME"), NotCode()] = "cpu"
    """Device of networks, replay buffer and simulations: cpu, cuda, mps, or auto for the best
    available."""
    compile: Flag = False
    """Compile loss and gradients into one graph; slow to start, worth it for long runs."""
    eval_every: Annotated[int, Range(), option(metavar="N")] = 0
    """Evaluate after every N episodes, and keep the best checkpoint; 0 to do neither."""
    eval_episodes: Annotated[Count, option(metavar="N")] = 5
    """Episodes of each of these evaluations."""
    normalize: Flag = False
    """Scale observations by their running mean and deviation, kept with the policy; angles stay
    sine and cosine."""
    stop_at: Annotated[float | None, option(metavar="RETURN")] = None
    """Stop when the mean return of the last five episodes, or of an evaluation if there are any,
    reaches this."""
    record: Flag = True
    """Record all transitions as a dataset in the run's folder data, unless --no-record is given."""
    log: Annotated[Literal["none", "tensorboard", "wandb", "trackio"], option(metavar="NAME")] = (
        "none"
    )
    """Also log to tensorboard, wandb or trackio; metrics.csv is always written."""
    name: Annotated[str, option(metavar="NAME"), NotCode()] = ""
    """Name of who trains, in a class; report and tables show it."""
    patience_s: Annotated[float, Range(), option(name="patience", metavar="SECONDS")] = 300.0
    """How long to retry when the link to a robot is lost; 0 gives up at once."""


@dataclass(frozen=True)
class TrainConfig(RunOptions, EnvOptions):
    """A training run in an environment. Synchronous runs on the virtual hub are bit-identical for
    equal configs."""

    env: Annotated[str, NotCode(LABELS)]
    """Environment id, or your own task, as for `bricksrl.make`."""
    agent: Annotated[str, NotCode(AGENTS)] = "sac"
    """Agent by name (``bricksrl.agents.AGENTS``), or your own algorithm: my_agent.py[:NAME]."""
    episodes: Count = 40
    """Episodes, including those of random actions at the start."""
    seed: int = 0
    """Seed of everything random: networks, exploration, replay, and the virtual robot."""
    asynchronous: bool | None = None
    """Learn in another process while the robot moves; by default in real time. Only synchronous
    runs are repeatable."""
    settings: Any = None
    """Settings of the agent; by default of its preset "default"."""
    data: Annotated[str | None, NotCode()] = None
    """Folder of a dataset, or of a run that recorded one, to learn from without the robot."""
    updates: Annotated[int, Range()] = 0
    """Updates from the data, spread over the episodes, which only show what was learned; 0 learns
    on the robot."""
    run_dir: Path | None = None
    """New folder of the run; by default the first free one of ``runs/<env>-<agent>-seed-<seed>``
    and the same with -2, -3, ..."""

    def __post_init__(self) -> None:
        check_seed(self.seed)
        # a path or a text: one is as good as the other, but a config in a file has texts
        for name in ("data", "start", "base", "demonstrations"):
            if isinstance(getattr(self, name), Path | str):
                object.__setattr__(self, name, str(getattr(self, name)))
        if isinstance(self.run_dir, Path | str):
            object.__setattr__(self, "run_dir", Path(self.run_dir))
        super().__post_init__()
        object.__setattr__(self, "physics", self.known_physics)  # stored with the run
        for name in ("env", "agent"):  # the run can then be used in any folder
            object.__setattr__(self, name, with_absolute_file(getattr(self, name)))
        if self.asynchronous is None:
            object.__setattr__(self, "asynchronous", self.realtime or self.hub != "virtual")
        for is_wrong, message in _RULES:
            if is_wrong(self):
                updates = counted(self.updates, "update")
                episodes = counted(self.episodes, "episode")
                raise RunError(message.format(self, updates=updates, episodes=episodes))
        if self.settings is None:  # stored, so that later versions use the same
            object.__setattr__(self, "settings", settings_for(self.env, "default", self.agent))
        if not dataclasses.is_dataclass(self.settings):
            raise DescriptionError(
                f"settings is {self.settings!r}; give those of the agent, such as "
                "preset('paper', 'sac')"
            )
        if self.normalize and not hasattr(self.settings, "normalize"):
            raise DescriptionError(
                f"{self.agent} cannot normalize; give its settings a field normalize, or omit it"
            )
        object.__setattr__(
            self,
            "settings",
            _plain(self.settings, **({"normalize": True} if self.normalize else {})),
        )

    @property
    def dataset(self) -> str | None:
        """Folder of what is learned from beside the robot's own steps."""
        return self.demonstrations if self.data is None else self.data

    @property
    def hubs(self) -> tuple[str, ...]:
        """Address of each robot; several make a fleet."""
        addresses = tuple(part.strip() for part in self.hub.split(","))
        return addresses if len(addresses) > 1 else addresses * self.robots

    @property
    def robot(self) -> EnvOptions:
        """Options of the environment of a single robot, the first."""
        return replace(self.env_options, hub=self.hubs[0])

    def to_dict(self) -> dict[str, Any]:
        """Plain values for JSON, without the run's folder."""
        data = dataclasses.asdict(self)
        del data["run_dir"]
        values = data["settings"].items()
        data["settings"] = {
            name: list(value) if isinstance(value, tuple) else value for name, value in values
        }
        data["fault"] = list(data["fault"])
        return data

    @classmethod
    def from_dict(cls, data: dict[str, Any], run_dir: Path | None = None) -> "TrainConfig":
        """Inverse of `to_dict`. Raises RunError if a name or type is invalid."""
        values = data.get("settings")
        if not isinstance(values, dict | None):
            raise RunError("'settings' in the config is not a table; restore the file")
        physics = data.get("physics")
        try:
            settings = (
                None if values is None else settings_from(data.get("agent", cls.agent), values)
            )
            data = {
                **data,
                "settings": settings,
                "physics": None if physics is None else Physics.from_dict(physics),
            }
            return cls(**data, run_dir=run_dir)
        except UnknownNameError as error:  # says what to do
            raise RunError(f"the run needs what is not here: {error}") from None
        except (AttributeError, BricksError, TypeError) as error:
            raise RunError(
                f"the config is invalid: {error}; restore the file or start a new run"
            ) from None


def _are_ambiguous(hubs: tuple[str, ...]) -> bool:
    real = {hub for hub in hubs if hub != "virtual"}
    return (
        len(hubs) > 1
        and bool(real)
        and (len(real) < len(hubs) or any(":" not in hub for hub in real))
    )


@dataclass(frozen=True)
class _CommonSettings(CriticSettings, TargetSettings, OffPolicySettings):
    """What a user's agent may have too: its texts are known to name code, or not."""


MAX_NAME = 40
"""Length of the name of who trains."""
_RULES: tuple[Rule, ...] = (
    (
        lambda run: len(run.name) > MAX_NAME or not run.name.isprintable(),
        f"the name of who trains is no line of up to {MAX_NAME} characters; give one, such as Anna",
    ),
    (
        lambda run: run.stop_at is not None and not abs(run.stop_at) <= sys.float_info.max,
        "stop_at is not a finite number; give the return to stop at, or omit it",
    ),
    (
        lambda run: run.num_envs > 1 and (run.hub != "virtual" or run.realtime or run.updates),
        "copies need a simulation or virtual robots in simulated time; omit num_envs",
    ),
    (
        lambda run: run.asynchronous and run.num_envs > 1,
        "copies cannot be trained asynchronously; train synchronously, or omit num_envs",
    ),
    (
        lambda run: run.updates and run.data is None,
        "{updates} from data need data; give the folder of a dataset",
    ),
    (
        lambda run: run.data and not run.updates,
        "data without updates has no effect; give it as demonstrations",
    ),
    (
        lambda run: run.updates and run.demonstrations,
        "what learns from data alone takes no demonstrations; omit them",
    ),
    (
        lambda run: 0 < run.updates < run.episodes,
        "{updates} cannot be spread over {episodes}; give fewer episodes",
    ),
    (
        lambda run: run.robots > 1 and set(run.hubs) != {"virtual"},
        "real robots are named one by one, such as ble:A,ble:B; omit robots",
    ),
    (
        lambda run: _are_ambiguous(run.hubs),
        "the hubs {0.hub} are ambiguous; give each robot a name, such as ble:A,ble:B",
    ),
    (
        lambda run: len(run.hubs) > 1 and (run.num_envs > 1 or run.eval_every or run.updates),
        "a fleet does not support num_envs, eval_every and updates; omit them",
    ),
)


def _plain(settings: Any, **changed: Any) -> Any:
    """Settings, with changes, for a file: NumPy numbers, such as rates from an array, as Python's;
    files by their whole path."""
    changed |= {
        name: value.item()
        for name, value in vars(settings).items()
        if isinstance(value, np.generic)
    }
    changed |= {
        name: with_absolute_file(value)
        for name, value in vars(settings).items()
        if isinstance(value, str)
    }
    return replace(settings, **changed) if changed else settings


def portable(data: dict[str, Any]) -> dict[str, Any]:
    """A config as plain values with only the names of the user's files: it is the same on all
    computers."""
    settings = {
        name: without_folder(value) if isinstance(value, str) else value
        for name, value in data["settings"].items()
    }
    names = {
        name: without_folder(data[name])
        for name in ("env", "agent", "transform")
        if data.get(name) is not None
    }
    return {**data, **names, "settings": settings}


def code_in(config: Any) -> tuple[str, ...]:
    """Texts in a run's config, as plain values, that may name code of the user's: using the config
    may execute it.

    The annotations of `TrainConfig`, of the settings of our agents and of the options of our
    environments say which texts name none.
    """
    if not isinstance(config, Mapping):
        return tuple(code_names(config))
    apart = "settings", "options"
    fields = {name: value for name, value in config.items() if name not in apart}
    settings, options = (config.get(name) for name in apart)
    named = [
        *code_names(fields, TrainConfig),
        *_code_in_settings(settings, config.get("agent", TrainConfig.agent)),
    ]
    env = config.get("env")
    # those of a user's task are for its code, which is named already
    if isinstance(env, str) and env in LABELS:
        named += code_names(options, option_types(env))
    return tuple(named)


def _code_in_settings(settings: Any, agent: Any) -> Iterator[str]:
    """Texts in an agent's settings that may name code; of a user's agent, among those that ours
    have too."""
    if not isinstance(settings, Mapping):
        return code_names(settings)
    if isinstance(agent, str) and agent in AGENTS:
        return code_names(settings, algorithm(agent).settings)
    common = {field.name for field in dataclasses.fields(_CommonSettings)}
    known = {name: value for name, value in settings.items() if name in common}
    return code_names(known, _CommonSettings)


def code_in_settings(
    values: Mapping[str, Any], settings_type: type[Any] = _CommonSettings
) -> tuple[str, ...]:
    """Texts in settings, as plain values, that may name code of the user's."""
    return tuple(code_names(values, settings_type))


def settings_from(agent: str, given: dict[str, Any]) -> Any:
    """Settings of an agent from plain values. Raises BricksError or TypeError if the agent or its
    settings are invalid."""
    settings_type = algorithm(agent).settings
    values = {
        key: tuple(value) if isinstance(value, list) else value for key, value in given.items()
    }
    check_fields(settings_type, values)
    return settings_type(**values)


def settings_for(env: str, name: str, agent: str) -> Any:
    """Settings of a preset for an agent in an environment; those of its task in the preset
    "default". Raises UnknownNameError if there is no such agent or preset, DescriptionError if no
    agent has a setting of the task, or this one not such a value."""
    try:
        task = get_task(env)
    except BricksError:  # not a registered environment
        return preset(name, agent)
    settings = preset(name, agent, images=bool(task.images))
    if name != "default":
        return settings
    if others := [key for key in task.settings if key not in vars(settings)]:
        known = {
            field.name for each in AGENTS for field in dataclasses.fields(algorithm(each).settings)
        }
        if unknown := [key for key in others if key not in known]:
            raise DescriptionError(
                f"{env} sets {unknown[0]}, which no agent has{hint(unknown[0], known)}; correct "
                "or omit it"
            )
    return replace(
        settings, **{key: value for key, value in task.settings.items() if key in vars(settings)}
    )
