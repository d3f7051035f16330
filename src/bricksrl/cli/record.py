"""``bricksrl record``: datasets, of a policy or of a human."""

from __future__ import annotations

import threading
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Any, Literal

from tyro.conf import Positional, UseAppendAction, arg

from bricksrl.cli.console import INTERRUPTED, print_interrupted, print_line, print_note
from bricksrl.cli.hands import HANDS, driving, quiet
from bricksrl.cli.loading import load_learning
from bricksrl.errors import DataError, DescriptionError, StoppedError
from bricksrl.seed import check_seed

if TYPE_CHECKING:
    import numpy as np
    from torchrl.envs import EnvBase

    from bricksrl.agents.agent import Agent
    from bricksrl.cli.hand import Hand
    from bricksrl.data.collect import Collected, Driver, Policy
    from bricksrl.data.recorder import Recorder


@dataclass(frozen=True)
class Record:
    """Record episodes of a policy or of a human as a dataset that LeRobot and everybody else can read.

    Each episode is on the disk when its line appears. Ctrl-C ends the recording and keeps what there is; keys and signals stop
    and pause the robot as in training. A dataset that is there already goes on, if it is of the same robot, environment and
    shape.

    Examples:
      bricksrl record RunAway-v0 --policy random --episodes 100 --out datasets/run_away_random
      bricksrl record Walker-v0 --policy runs/walker --episodes 100 --out datasets/walker_expert
      bricksrl record Spinning-v0 --policy keyboard --episodes 5 --out datasets/by_hand
      bricksrl record Walker-v0 --policy runs/walker --take-over gamepad --out datasets/corrected
    """

    env: Annotated[Positional[str], arg(metavar="ENV")]
    """Environment; `bricksrl list` shows them. A task of your own: my_task.py, my_task.py:TASK or module:TASK."""
    out: Annotated[Path, arg(metavar="DIR")]
    """Folder of the dataset: a new one, or one that goes on."""
    policy: Annotated[str, arg(metavar="POLICY")] = "random"
    """What acts: random, keyboard, gamepad, or the folder of a run or of a policy that was shared."""
    take_over: Literal["keyboard", "gamepad"] | None = None
    """Let a human take over from the policy, and give back; these steps are marked in the data."""
    episodes: Annotated[int, arg(metavar="N")] = 10
    """Episodes to record."""
    seed: Annotated[int, arg(metavar="N")] = 0
    """Of the episodes and of random actions."""
    explore: bool = False
    """Let the agent of a run explore, as it does in training; without it, it does its best."""
    hub: Annotated[str, arg(metavar="HUB")] = "virtual"
    """How to reach the robot: virtual, ble or usb; ble:NAME, ble:ADDRESS or usb:PORT where there are several."""
    streaming: bool = False
    """Have the hub send observations 100 times a second, and take the latest command: steps then last their own time only."""
    app_data: bool = False
    """Speak to the program over AppData, where a new command replaces an old one, instead of its standard input."""
    realtime: bool = False
    """Let a virtual robot take as long as a real one; always so with a human at the keys."""
    physics: Annotated[Path | None, arg(metavar="FILE")] = None
    """Physics of the virtual robot: a JSON file such as `bricksrl twin fit` writes."""
    option: Annotated[UseAppendAction[tuple[str, ...]], arg(metavar="NAME=VALUE")] = ()
    """Option of the environment's task, as often as needed: sparse=true, threshold_deg=20."""

    def execute(self) -> int:
        """Record, a line an episode."""
        from bricksrl.cli.hand import Hand
        from bricksrl.data.description import describe, describe_task
        from bricksrl.data.recorder import Recorder
        from bricksrl.envs import get_task

        if self.episodes < 1:
            raise DataError(f"episodes is {self.episodes}; record at least 1")
        check_seed(self.seed)
        load_learning()
        count = 0

        def tell(episode: Collected) -> None:
            nonlocal count
            count += 1
            by_hand = f"  {episode.interventions} steps by hand" if episode.interventions else ""
            print_line(f"episode {count}/{self.episodes}  return {episode.return_:.4g}  {episode.length} steps{by_hand}")

        hands = self.policy if self.policy in HANDS else self.take_over
        task = get_task(self.env, **self._options())
        try:
            with (
                Hand(threading.Event(), print_note, keys=False if hands == "keyboard" else None) as hand,
                driving(hands, describe_task(task), in_charge=self.policy in HANDS) as human,
                self._environment(human, hand) as env,
                Recorder(self.out, describe(env, self._options())) as recorder,
            ):
                hand.take(env)
                self._collect(env, recorder, human, tell)
        except (KeyboardInterrupt, StoppedError):
            print_interrupted(f"{count} whole episodes are in {self.out}")
            return INTERRUPTED
        print_line(f"dataset         {self.out}")
        print_line(f"look at it      bricksrl data info {self.out}")
        return 0

    def _options(self) -> dict[str, Any]:
        from bricksrl.cli.train import parse_option

        return dict(map(parse_option, self.option))

    @contextmanager
    def _environment(self, human: Driver | None, hand: Hand) -> Iterator[EnvBase]:
        from bricksrl.envs import make
        from bricksrl.twin.physics import read_physics

        def place(rng: np.random.Generator) -> None:
            with quiet(human):
                hand.place(rng)

        physics = None if self.physics is None else read_physics(self.physics)
        options = {**self._options(), "physics": physics, "streaming": self.streaming, "app_data": self.app_data, "place": place}
        by_hand = self.hub == "virtual" and (self.policy in HANDS or self.take_over is not None)
        try:
            env = make(self.env, self.hub, seed=self.seed, realtime=self.realtime or by_hand, **options)
        except DescriptionError:
            if not by_hand or self.realtime:
                raise
            env = make(self.env, self.hub, seed=self.seed, **options)  # without a robot: paced below
        try:
            yield env
        finally:
            env.close(raise_if_closed=False)

    def _collect(self, env: EnvBase, recorder: Recorder, human: Driver | None, tell: Callable[[Collected], None]) -> None:
        from bricksrl.agents.agent import look
        from bricksrl.data.collect import collect, random_policy
        from bricksrl.data.hands import Paced, rest

        driver = human
        if human is not None and not hasattr(env, "twin"):
            driver = Paced(human, recorder.description.rate_hz)
        policy: Policy
        start_acting = None
        if self.policy == "random":
            policy = random_policy(env, self.seed)
        elif self.policy in HANDS:
            still = rest(recorder.description.action)
            policy = lambda _: still  # noqa: E731  a human gives back: the robot rests
        else:
            agent = _load_agent(Path(self.policy), env)
            policy = lambda state: agent.act(look(agent, state), explore=self.explore)  # noqa: E731
            start_acting = agent.start_acting
        collect(
            env,
            policy,
            recorder,
            self.episodes,
            name=self.policy,
            seed=self.seed,
            hub=self.hub,
            driver=driver,
            start_acting=start_acting,
            on_episode=tell,
        )


def _load_agent(run_dir: Path, env: EnvBase) -> Agent:
    from bricksrl.training import load_agent
    from bricksrl.training.sharing import is_policy, load_policy

    return load_policy(run_dir, env) if is_policy(run_dir) else load_agent(run_dir, env).agent
