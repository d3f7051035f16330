"""The robot's side of a learner in another process: how long it waits, and what it says of a
death; with a process that only notes what it is sent."""

from __future__ import annotations

from collections.abc import Callable
from pathlib import Path
from typing import Any

import pytest
import torch
from tensordict import TensorDict
from test_learner_side import OF_FOUR, SMALL, state_of, steps
from toys import Cart

from bricksrl.agents import make_learner
from bricksrl.errors import HubError, LearnerError
from bricksrl.training import TrainConfig
from bricksrl.training import learner_side as sides
from bricksrl.training.checkpoint import load_checkpoint
from bricksrl.training.learner_side import AsyncLearner, InLoopLearner


class Process:
    """A learner's process that does nothing, and ends as it is told."""

    def __init__(self, module: str, deliver: Callable[[Any], None]) -> None:
        self.module = module
        self.deliver = deliver
        self.sent: list[tuple[str, Any]] = []
        self.timeouts_s: list[float] = []
        self.is_gone = False
        self.code: int | None = 0

    def send(self, kind: str, content: Any) -> None:
        if self.is_gone:
            self.deliver(None)
            raise OSError("broken pipe")
        self.sent.append((kind, content))

    def end(self, timeout_s: float) -> None:
        self.timeouts_s.append(timeout_s)

    def wait(self, timeout_s: float) -> int | None:
        assert timeout_s > 0
        return self.code


@pytest.fixture
def process(monkeypatch: pytest.MonkeyPatch) -> list[Process]:
    """Processes that were started."""
    started: list[Process] = []

    def start(module: str, deliver: Callable[[Any], None]) -> Process:
        started.append(Process(module, deliver))
        return started[-1]

    monkeypatch.setattr(sides, "ChildProcess", start)
    return started


def beside(**options: Any) -> AsyncLearner:
    """The robot's side of a learner that has learned from 3 of 5 steps."""
    learner = make_learner("sac", Cart(), SMALL)
    config = TrainConfig("Cart", settings=SMALL, **options)
    return AsyncLearner(config, Cart(), learner, state_of(learner, {"asked": 5, "done": 3}))


@pytest.mark.parametrize(
    ("error", "is_waited_for"),
    [(None, True), (HubError("out of reach"), True), (KeyboardInterrupt(), False)],
)
def test_pending_work_is_waited_for_unless_somebody_waits_for_the_prompt(
    process: list[Process], error: BaseException | None, is_waited_for: bool
) -> None:
    side = beside()
    assert process[0].module == "bricksrl.training.learner_side"
    side.__exit__(None if error is None else type(error), error, None)
    (timeout_s,) = process[0].timeouts_s
    assert (timeout_s >= 60.0) is is_waited_for
    assert (timeout_s <= 10.0) is not is_waited_for
    assert process[0].sent[-1][0] == "end"


@pytest.mark.parametrize("realtime", [False, True])
def test_simulated_robot_is_four_steps_ahead_at_most(
    process: list[Process], realtime: bool
) -> None:
    """A robot in real time waits for nobody."""
    side: Any = beside(realtime=realtime)
    waited: list[Callable[[], bool]] = []
    side._wait = waited.append
    side.learn(2)
    assert process[0].sent[-1] == ("learn", 2)
    assert (side.pace.asked, side.pace.done) == (7, 3)
    if realtime:
        assert not waited
        return
    (may_go_on,) = waited
    assert may_go_on()
    side._asked = 8
    assert not may_go_on()
    process[0].deliver(("learned", (4, {}, {})))
    assert may_go_on()


def test_real_robot_waits_for_no_learner(process: list[Process]) -> None:
    side: Any = beside(hub="ble")
    waited: list[Any] = []
    side._wait = waited.append
    side.learn(50)
    assert not waited


def test_run_ends_with_all_updates_and_checkpoints(process: list[Process]) -> None:
    side: Any = beside()
    waited: list[Callable[[], bool]] = []
    side._wait = waited.append
    side.save(Path("here") / "a.bin", {"seed": 1})
    assert process[0].sent[-1] == ("save", (str((Path("here") / "a.bin").absolute()), {"seed": 1}))
    goes_on = [True]
    side.finish(lambda: goes_on[0])
    has_learned, has_saved = waited
    assert not has_learned() and not has_saved()
    goes_on[0] = False
    assert has_learned(), "nobody wants the rest"
    goes_on[0] = True
    process[0].deliver(("learned", (5, {}, {})))
    assert has_learned() and not has_saved()
    process[0].deliver(("saved", 1))
    assert has_saved()


@pytest.mark.parametrize(
    ("code", "says"),
    [(-9, "died (signal 9)"), (3, "died (exit code 3)"), (0, "died (exit code 0)")],
)
def test_death_of_the_learner_ends_the_run(process: list[Process], code: int, says: str) -> None:
    side = beside()
    process[0].code = code
    process[0].is_gone = True
    message = f"the learner's process {says}; resume the run from its last checkpoint"
    for _ in range(2):
        with pytest.raises(LearnerError) as raised:
            side.end_episodes(0)
        assert str(raised.value) == message
    with pytest.raises(LearnerError):
        side.wait_until_ready()


def test_own_failure_says_more_than_an_exit_code(process: list[Process]) -> None:
    side = beside()
    process[0].deliver(("failed", "failed (out of memory)"))
    process[0].deliver(None)
    with pytest.raises(LearnerError, match=r"process failed \(out of memory\); resume the run"):
        side.learn(1)


def test_process_that_cannot_be_started_is_told(monkeypatch: pytest.MonkeyPatch) -> None:
    def refuse(*_: Any) -> None:
        raise OSError(11, "Resource temporarily unavailable")

    monkeypatch.setattr(sides, "ChildProcess", refuse)
    with pytest.raises(LearnerError) as raised:
        beside()
    assert str(raised.value) == (
        "cannot start the learner's process (Resource temporarily unavailable); train synchronously"
    )


def test_frames_go_as_flat_tables_of_their_robot(process: list[Process]) -> None:
    side = beside()
    frames = TensorDict({"a": torch.ones(2, 3), "next": {"b": torch.zeros(2, 1)}}, [2])
    side.remember(frames, 4)
    kind, (robot, columns) = process[0].sent[-1]
    assert (kind, robot) == ("remember", 4)
    assert list(columns) == ["a", "next.b"]
    side.end_episodes()
    assert process[0].sent[-1] == ("end_episodes", None)


def test_process_is_told_what_to_learn_and_where_to_go_on(process: list[Process]) -> None:
    beside()
    kind, begin = process[0].sent[0]
    assert kind == "begin"
    assert begin["config"]["env"] == "Cart" and begin["has_task"] is False
    assert begin["state"]["pace"] == {"asked": 5, "done": 3}
    assert set(begin["specs"]) == {
        "observation_spec",
        "action_spec",
        "reward_spec",
        "done_spec",
    }


def test_steps_without_an_outcome_do_not_complete_a_stretch() -> None:
    """A learner of four steps at once is given five, if the link was lost in one of them."""
    env = Cart()
    learner = make_learner("ppo", env, OF_FOUR)
    remembered: list[int] = []
    learner.remember = lambda frames, _robot=0: remembered.append(frames.shape[-1])
    side = InLoopLearner(learner, state_of(learner))
    frames = steps(env, learner, 5)
    lost = torch.zeros(5, 1, dtype=torch.bool)
    lost[1] = True
    frames["next", "link_lost"] = lost
    for step in range(4):
        side.remember(frames[step : step + 1])
    assert remembered == []
    side.remember(frames[4:5])
    assert remembered == [5]
    side.remember(frames[:1])
    assert remembered == [5], "the next stretch begins"


def test_checkpoint_has_the_learner_and_what_it_has_not_learned_from(tmp_path: Path) -> None:
    env = Cart()
    learner = make_learner("ppo", env, OF_FOUR)
    side = InLoopLearner(learner, state_of(learner))
    side.remember(steps(env, learner, 3))
    side.learn(3)
    side.save(tmp_path / "a.bin", {"seed": 7})
    state = load_checkpoint(tmp_path / "a.bin")
    assert (state["seed"], state["pace"]) == (7, {"asked": 3, "done": 3})
    assert [len(frames["action"]) for frames in state["collected"]] == [3]
    assert set(learner.state_dict()) == set(state["agent"])
    side.save(tmp_path / "b.bin", {"pace": {"asked": 9, "done": 3}})
    assert load_checkpoint(tmp_path / "b.bin")["pace"] == {"asked": 9, "done": 3}, "as it was told"
    again = InLoopLearner(learner, state | {"pace": {"asked": 3, "done": 3}})
    again.remember(steps(env, learner, 1))
    assert again.learn(1), "the fourth step completes the stretch"
