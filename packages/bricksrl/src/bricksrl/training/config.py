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
    record: Annotated[
        bool, option(help="Do not record the transitions as a dataset in the run's folder data.")
    ] = True
    """Record all transitions as a dataset in the run's folder data."""
    log: Annotated[Literal["none", "tensorboard", "wandb", "trackio"], option(metavar="NAME")] = (
        "none"
    )
    """Also log to tensorboard, wandb or trackio; metrics.csv is always written."""
    name: Annotated[str, option(metavar="NAME"), NotCode()] = ""
    """Name of who trains, in a class; report and tables show it."""
    patience_s: Annotated[float, Range(), option(metavar="SECONDS")] = 300.0
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
        # Paths and texts are equally good here, but a config in a file has texts.
        for name in ("data", "start", "base", "demonstrations"):
            if isinstance(getattr(self, name), Path | str):
                object.__setattr__(self, name, str(getattr(self, name)))
        if isinstance(self.run_dir, Path | str):
            object.__setattr__(self, "run_dir", Path(self.run_dir))
        super().__post_init__()
        # Physics are kept as numbers and not by name, so that a later version trains in the same
        # world.
        object.__setattr__(self, "physics", self.known_physics)
        # Absolute paths let the run be used in any folder.
        for name in ("env", "agent"):
            object.__setattr__(self, name, with_absolute_file(getattr(self, name)))
        # A robot in real time cannot wait for a gradient.
        if self.asynchronous is None:
            object.__setattr__(self, "asynchronous", self.realtime or self.hub != "virtual")
        for is_wrong, message in _RULES:
            if is_wrong(self):
                updates = counted(self.updates, "update")
                episodes = counted(self.episodes, "episode")
                raise RunError(message.format(self, updates=updates, episodes=episodes))
        # Settings are kept with the run, so that a later version goes on with the same ones.
        if self.settings is None:
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
        # Normalizing is an option of the run for its user but a setting for the agent, which reads
        # only settings.
        changed = {"normalize": True} if self.normalize else {}
        object.__setattr__(self, "settings", _plain(self.settings, **changed))

    @property
    def dataset(self) -> str | None:
        """Folder of what is learned from beside the robot's own steps."""
        return self.demonstrations if self.data is None else self.data

    @property
    def hubs(self) -> tuple[str, ...]:
        """Address of each robot; several make a fleet."""
        addresses = tuple(part.strip() for part in self.hub.split(","))
        if len(addresses) > 1:
            return addresses
        # Virtual robots need no address of their own.
        return addresses * self.robots

    @property
    def robot(self) -> EnvOptions:
        """Options of the environment of a single robot, the first."""
        return replace(self.env_options, hub=self.hubs[0])

    def to_dict(self) -> dict[str, Any]:
        """Plain values for JSON, without the run's folder."""
        data = dataclasses.asdict(self)
        # The config lies in this folder, which may be moved.
        del data["run_dir"]
        # JSON has no tuples, so settings get lists here, to equal those of a config that was read.
        data["settings"] = {
            name: list(value) if isinstance(value, tuple) else value
            for name, value in data["settings"].items()
        }
        data["fault"] = list(data["fault"])
        return data

    @classmethod
    def from_dict(
        cls,
        data: dict[str, Any],
        run_dir: Path | None = None,
    ) -> "TrainConfig":
        """Inverse of `to_dict`. Raises RunError if a name or type is invalid."""
        values = data.get("settings")
        if not isinstance(values, dict | None):
            raise RunError("'settings' in the config is not a table; restore the file")
        physics = data.get("physics")
        try:
            settings = None
            if values is not None:
                settings = settings_from(data.get("agent", cls.agent), values)
            if physics is not None:
                physics = Physics.from_dict(physics)
            data = {**data, "settings": settings, "physics": physics}
            return cls(**data, run_dir=run_dir)
        except UnknownNameError as error:
            # The error's text says what to do; the config itself is unchanged.
            raise RunError(f"the run needs what is not here: {error}") from None
        except (AttributeError, BricksError, TypeError) as error:
            raise RunError(
                f"the config is invalid: {error}; restore the file or start a new run"
            ) from None


def _are_ambiguous(hubs: tuple[str, ...]) -> bool:
    """Whether it is not clear which robot a process is to take."""
    real = {hub for hub in hubs if hub != "virtual"}
    if len(hubs) == 1 or not real:
        return False
    # It is not clear which robot a process gets if an address is named twice, or a virtual robot
    # stands among real ones.
    are_repeated = len(real) < len(hubs)
    are_unnamed = any(":" not in hub for hub in real)
    return are_repeated or are_unnamed


@dataclass(frozen=True)
class _CommonSettings(CriticSettings, TargetSettings, OffPolicySettings):
    """Settings that a user's agent may have too. Which of their texts name code is known."""


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
    for name, value in vars(settings).items():
        if isinstance(value, np.generic):
            changed[name] = value.item()
        elif isinstance(value, str):
            changed[name] = with_absolute_file(value)
    # A user's dataclass may have fields that cannot be given anew.
    return replace(settings, **changed) if changed else settings


def portable(data: dict[str, Any]) -> dict[str, Any]:
    """A config as plain values with only the names of the user's files: it is the same on all
    computers."""
    settings = dict(data["settings"])
    for name, value in settings.items():
        if isinstance(value, str):
            settings[name] = without_folder(value)
    plain = {**data, "settings": settings}
    # A checkpoint's identity has no transform, and neither have most runs.
    for name in ("env", "agent", "transform"):
        if data.get(name) is not None:
            plain[name] = without_folder(data[name])
    if data.get("scene") is not None:
        plain["scene"] = Path(data["scene"]).name
    return plain


def code_in(config: Any) -> tuple[str, ...]:
    """Texts in a run's config, as plain values, that may name code of the user's: using the config
    may execute it.

    The annotations of `TrainConfig`, of the settings of our agents and of the options of our
    environments say which texts name none.
    """
    # The content may be a stranger's, so no type in it is certain.
    if not isinstance(config, Mapping):
        return tuple(code_names(config))
    # The agent's annotations check its settings, and the environment's check its options.
    fields = {name: value for name, value in config.items() if name not in ("settings", "options")}
    agent = config.get("agent", TrainConfig.agent)
    named = [
        *code_names(fields, TrainConfig),
        *_code_in_settings(config.get("settings"), agent),
    ]
    env = config.get("env")
    # The options of a user's task are for its code, which is already named.
    if isinstance(env, str) and env in LABELS:
        named += code_names(config.get("options"), option_types(env))
    return tuple(named)


def _code_in_settings(settings: Any, agent: Any) -> Iterator[str]:
    """Texts in an agent's settings that may name code; of a user's agent, among those that ours
    have too."""
    if not isinstance(settings, Mapping):
        return code_names(settings)
    if isinstance(agent, str) and agent in AGENTS:
        return code_names(settings, algorithm(agent).settings)
    # Asking a user's algorithm for its annotations would execute it.
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
    # JSON has lists where a frozen dataclass has tuples.
    values = {
        name: tuple(value) if isinstance(value, list) else value for name, value in given.items()
    }
    # A user's dataclass need not check itself, so it is checked here.
    check_fields(settings_type, values)
    return settings_type(**values)


def settings_for(
    env: str,
    name: str,
    agent: str,
) -> Any:
    """Settings of a preset for an agent in an environment; those of its task in the preset
    "default". Raises UnknownNameError if there is no such agent or preset, DescriptionError if no
    agent has a setting of the task, or this one not such a value."""
    try:
        task = get_task(env)
    except BricksError:
        # This environment is not registered, for example one that was given to `train`.
        return preset(name, agent)
    settings = preset(name, agent, images=bool(task.images))
    # A task may improve on what is good for few robot steps, but the paper's numbers stay the
    # paper's.
    if name != "default":
        return settings
    fitting = {}
    for key, value in task.settings.items():
        if key in vars(settings):
            fitting[key] = value
        else:
            # A setting of another agent is left out, but a misspelled one would never be noticed.
            _check_any_agent_has(key, env)
    return replace(settings, **fitting)


def _check_any_agent_has(setting: str, env: str) -> None:
    """Raise DescriptionError if no agent has a setting of an environment's task."""
    known = set[str]()
    for agent in AGENTS:
        known |= {field.name for field in dataclasses.fields(algorithm(agent).settings)}
    if setting not in known:
        raise DescriptionError(
            f"{env} sets {setting}, which no agent has{hint(setting, known)}; correct or omit it"
        )
