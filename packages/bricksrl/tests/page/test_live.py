"""The live page: what it shows, and what its buttons do, without a browser."""

from __future__ import annotations

import math
from collections.abc import Callable
from typing import Any

import numpy as np
import pytest
import torch
from tensordict import TensorDict

from brickhub.entry import Entry
from bricksrl.envs import get_task
from bricksrl.envs.env_interface import BricksEnv
from bricksrl.errors import HubError, StoppedError
from bricksrl.page.live import LivePage, PageDriver
from bricksrl.page.robot_view import SPEEDS
from bricksrl.page.visitors import AWAY_S, Visitor
from bricksrl.policies.by_name import scores_to_beat

TASK = get_task("RunAway-v0")
AT_ONCE = ["stop", "pause", "reset", "step", "speed", "pull"]


class Robot(BricksEnv):
    """A robot that notes what it is told."""

    robots = 1
    batch_size = torch.Size()

    def __init__(self, error: HubError | None = None) -> None:
        self.told: list[str] = []
        self.error = error
        self.paused = False

    @property
    def is_paused(self) -> bool:
        return self.paused

    @property
    def has_stopped(self) -> bool:
        return "confirmed" in self.told

    def stop(self) -> None:
        self.told.append("stop")
        if self.error is not None:
            raise self.error

    def pause(self) -> None:
        self.told.append("pause")
        self.paused = True

    def resume(self) -> None:
        self.told.append("resume")
        self.paused = False


def of_robot(*, is_real: bool = False, **named: Any) -> tuple[LivePage, Robot]:
    page, robot = LivePage("RunAway-v0", task=TASK, **named), Robot()
    page.attach(robot)  # type: ignore[arg-type]
    page._is_real = is_real
    page._publish()
    return page, robot


def shown(page: LivePage) -> dict[str, Any]:
    return page.board.status[1]


def asked(limit: int) -> Callable[[], bool]:
    """Says at this question that all is over."""
    questions = iter(range(1, limit + 1))
    return lambda: next(questions) == limit


# ---------------------------------------------------------------- what is shown


def test_page_begins_with_titles_goal_and_choices() -> None:
    page = LivePage("RunAway-v0", "sac, seed 1", task=TASK, policies=("random", "agent"))
    status = shown(page)
    assert (status["title"], status["subtitle"]) == ("RunAway-v0", "sac, seed 1")
    assert (status["state"], status["speed"], status["policy"]) == ("running", "max", "agent")
    assert (status["speeds"], status["policies"]) == (list(SPEEDS), ["random", "agent"])
    assert status["goal"] == TASK.summary and status["has_ghost"] is False
    assert status["scores"] == scores_to_beat("RunAway-v0") and status["scores"]
    assert page.board.series["channels"].names[-1] == "distance (mm)"
    assert set(page.board.series) == {"return", "reward", "channels"}
    bare = shown(LivePage("Mine"))
    assert (bare["subtitle"], bare["policy"], bare["policies"]) == ("", "", [])
    assert "goal" not in bare


@pytest.mark.parametrize(
    ("named", "controls"),
    [
        ({}, [*AT_ONCE, "drive"]),
        ({"can_drive": False}, AT_ONCE),
        ({"task": None}, AT_ONCE),
        ({"policies": ("agent",)}, [*AT_ONCE, "drive"]),
        ({"policies": ("random", "agent")}, [*AT_ONCE, "drive", "policy"]),
    ],
)
def test_controls_are_those_that_do_something(named: dict[str, Any], controls: list[str]) -> None:
    page = LivePage("RunAway-v0", **{"task": TASK, **named})
    assert shown(page)["controls"] == controls
    assert ("drive" in shown(page)) == ("drive" in controls)


def test_real_robot_is_neither_stepped_nor_pulled_and_a_recording_can_be_discarded() -> None:
    page, _ = of_robot(is_real=True)
    assert shown(page)["controls"] == ["stop", "pause", "reset", "drive"]
    page._press("step", None)
    assert shown(page)["state"] == "running" and page._speed_factor == 0.0
    page._press("discard", None)  # nothing is recorded
    discarded = []
    page.on_discard = lambda: discarded.append(1)
    page._press("discard", None)
    assert discarded == [1]
    assert shown(page)["controls"] == ["stop", "pause", "reset", "discard", "drive"]


def test_attached_environment_says_what_is_drawn() -> None:
    page, copies, robot = LivePage("RunAway-v0", task=TASK), Robot(), Robot()
    copies.batch_size = torch.Size([3])
    for env, robots, is_paced_here, says in (
        (copies, 0, False, "3 copies learn at once; their returns are below."),
        (robot, 1, False, ""),
        (robot, 0, True, "This is a simulation without a robot; its numbers are below."),
        (robot, 2, True, "Several robots learn at once; their returns are below."),
    ):
        env.robots = robots
        page.attach(env)  # type: ignore[arg-type]
        assert shown(page)["no_scene"] == says
        assert page._is_paced_here == is_paced_here


def test_earlier_robot_is_watched_no_more() -> None:
    page, watched = LivePage("RunAway-v0", task=TASK), list[str]()

    class Watched(Robot):
        def watch(self, _watcher: Any) -> Callable[[], None]:
            watched.append("watched")
            return lambda: watched.append("left")

    for _ in range(2):
        page.attach(Watched())  # type: ignore[arg-type]
    assert watched == ["watched", "left", "watched"]
    page.close()
    assert watched[3:] == ["left"]


def test_steps_and_episodes_become_curves_and_numbers(monkeypatch: pytest.MonkeyPatch) -> None:
    now_s = [100.0]
    monkeypatch.setattr("bricksrl.page.live.time.monotonic", lambda: now_s[0])
    page, _ = of_robot()
    page.begin()
    page.show_outcome([1.0, 2.0, 3.0, 4.0, 5.0], 0.5, 0.5)
    facts = dict(shown(page)["facts"])
    assert facts.pop("steps/s") > 0.0
    assert facts == {"step": 1, "return": 0.5, "reward": 0.5}
    now_s[0] += 0.1
    outcome = {"observation": torch.arange(5.0), "reward": torch.tensor([0.25])}
    page.show_step(TensorDict({"next": outcome}))
    assert shown(page)["facts"]["step"] == 1, "nobody reads numbers that fast"
    now_s[0] += 0.15
    page.show_outcome([0.0] * 5, None, 3.0)
    facts = shown(page)["facts"]
    assert (facts["step"], facts["return"]) == (3, 0.5), "a reward that is not known is not shown"
    assert facts["steps/s"] == pytest.approx(2 / 0.25)
    now_s[0] += 0.25
    page.show_outcome([0.0] * 5, 1.0, 4.0)
    assert (shown(page)["facts"]["return"], shown(page)["facts"]["reward"]) == (4.0, 1.0)
    series = page.board.series
    assert list(series["reward"].rows) == [(0.5,), (0.25,), (1.0,)]
    assert len(series["channels"].rows) == 4
    page.note(phase="learning")
    page.end(4.0, "7/20")
    facts = shown(page)["facts"]
    assert (facts["episode"], facts["return"], facts["phase"]) == ("7/20", 4.0, "learning")
    assert list(series["return"].rows) == [(4.0,)]
    page.begin()
    now_s[0] += 1.0
    page.show_step(TensorDict({"next": outcome}))
    facts = shown(page)["facts"]
    assert (facts["step"], facts["return"]) == (1, 0.25), "an episode begins anew"


def test_camera_image_is_copied() -> None:
    page, _ = of_robot()
    image = np.full((2, 2, 3), 7, np.uint8)
    page.show_outcome([0.0] * 5, 1.0, 1.0, image)
    image[:] = 0
    kept = page.board.image[1]
    assert kept is not None and (kept == 7).all()


def test_ghost_stands_at_the_goal_of_the_first_step() -> None:
    page = LivePage("RoboArm-v0", task=get_task("RoboArm-v0"))
    assert not shown(page)["has_ghost"], "there is no goal before the first reset"
    count = len(get_task("RoboArm-v0").entries)
    for first in (20.0, 50.0):
        page.begin()
        page.show_outcome([first] * count, 0.0, 0.0)
        goal = page.view.goal
        page.show_outcome([first + 1.0] * count, 0.0, 0.0)
        assert page.view.goal == goal == get_task("RoboArm-v0").goal([first] * count)
        assert goal is not None and shown(page)["has_ghost"]


def test_finished_page_stays_so() -> None:
    page, _ = of_robot()
    page.finish("Done.")
    page._press("pause", None)
    status = shown(page)
    assert (status["state"], status["note"], status["message"]) == ("finished", "Done.", "")


# ---------------------------------------------------------------- buttons


def test_paused_simulation_waits_and_makes_the_steps_that_are_asked_for() -> None:
    page, robot = of_robot()
    page.hold()
    page._press("pause", None)
    assert shown(page)["state"] == "paused" and not robot.told, "it waits here, before its step"
    over = asked(2)
    page.hold(over)
    with pytest.raises(StopIteration):
        over()
    for _ in range(2):
        page._press("step", None)
    page.hold()
    page.hold()
    over = asked(1)
    page.hold(over)
    with pytest.raises(StopIteration):
        over()
    page._press("step", None)
    page._press("resume", None)
    assert shown(page)["state"] == "running"
    page.hold()
    page._press("pause", None)
    over = asked(1)
    page.hold(over)
    with pytest.raises(StopIteration):
        over()
    page._press("reset", None)
    page.hold()  # a reset ends the waiting


def test_pause_of_a_real_robot_is_the_robots() -> None:
    page, robot = of_robot(is_real=True)
    page._press("resume", None)
    page._press("pause", None)
    assert robot.told == ["pause"] and shown(page)["state"] == "paused"
    page.hold(asked(0))
    page._press("resume", None)
    assert robot.told == ["pause", "resume"] and shown(page)["state"] == "running"


def test_reset_cuts_the_episode_once_by_a_pause() -> None:
    page, robot = of_robot()
    page.cut()
    assert not robot.told
    page._press("reset", None)
    page.cut()
    page.cut()
    assert robot.told == ["pause"]
    page.clear_reset()
    assert robot.told == ["pause", "resume"] and not page.is_reset_requested
    page.clear_reset()
    assert robot.told == ["pause", "resume"]
    page._press("reset", None)
    robot.robots = 0
    page.cut()
    assert robot.told == ["pause", "resume"], "a simulation without a robot is not paused"


def test_stop_reaches_run_and_robot_and_only_a_reset_lets_it_go_on() -> None:
    stopped = []
    page, robot = of_robot(in_charge=True, on_stop=lambda: stopped.append(1))
    page._press("drive", [1.0])
    page._press("reset", None)
    page.stop()
    assert stopped == [1] and robot.told == ["stop"] and page.is_stopped
    assert page.has_stopped() is False, "which only the robot can say"
    assert shown(page)["state"] == "stopped" and not page.is_reset_requested
    assert page.driver is not None and page.driver.pushes == [0.0]
    page._press("pause", None)
    page._press("resume", None)
    assert robot.told == ["stop"], "no button but reset moves it"
    page._press("reset", None)
    page.cut()
    page.clear_reset()
    assert "resume" not in robot.told
    page._press("reset", None)
    page.wait_for_reset(lambda: False)
    page.release()
    assert robot.told[-1] == "resume" and not page.is_stopped
    assert shown(page)["state"] == "running" and shown(page)["stop"] is None


def test_hub_that_cannot_be_stopped_is_told() -> None:
    page, robot = of_robot()
    robot.error = HubError("it is out of reach; switch it off")
    with pytest.raises(HubError):
        page.stop()
    assert shown(page)["message"] == "it is out of reach; switch it off"
    assert shown(page)["state"] == "stopped"


def test_step_of_a_stopped_page_raises() -> None:
    page, _ = of_robot()
    frame = TensorDict({"next": {"observation": torch.zeros(5), "reward": torch.zeros(1)}})
    page.show_step_and_hold(frame)
    page.mark_stopped()
    assert shown(page)["state"] == "stopped"
    with pytest.raises(StoppedError):
        page.show_step_and_hold(frame)


def test_speed_is_real_time_while_somebody_drives() -> None:
    page, _ = of_robot(policies=("agent",), speed="10x")
    assert (page._speed_factor, shown(page)["speed"]) == (10.0, "10x")
    page._press("take_over", True)
    assert (page._speed_factor, shown(page)["speed"]) == (1.0, "1x")
    assert page.is_driven and shown(page)["drive"]["in_charge"]
    page._press("take_over", False)
    assert not page.is_driven and page._speed_factor == 10.0


def test_who_only_drives_cannot_give_back() -> None:
    page, _ = of_robot(in_charge=True)
    assert not shown(page)["drive"]["can_give_back"]
    page._press("take_over", False)
    assert page.is_driven
    with_policy, _ = of_robot(in_charge=True, policies=("agent",))
    assert shown(with_policy)["drive"]["can_give_back"]
    with_policy._press("take_over", False)
    assert not with_policy.is_driven
    assert shown(of_robot()[0])["drive"]["can_give_back"]
    undriven, _ = of_robot(can_drive=False)
    for press in (("take_over", True), ("drive", [1.0])):
        undriven._press(*press)
    assert undriven.driver is None and not undriven.is_driven


# ---------------------------------------------------------------- several visitors


def visitors_of(page: LivePage) -> tuple[Visitor, Visitor]:
    return page.visitors.arrive("a", "Ada"), page.visitors.arrive("b", "Ben")


def test_one_visitor_drives_and_others_ask() -> None:
    page, _ = of_robot(policies=("agent",))
    ada, ben = visitors_of(page)
    page._press("take_over", True, ada)
    assert page.is_driven and shown(page)["holders"] == {"robot": "Ada"}
    page._press("drive", [1.0], ada)
    page._press("drive", [-1.0], ben)
    assert page.driver is not None and page.driver.pushes == [1.0] and not ben.note
    page._press("pause", None, ben)
    assert ben.note == "Ada drives this robot; ask first." and shown(page)["state"] == "running"
    page._press("ask", None, ben)
    assert shown(page)["questions"] == {"robot": "Ben"}
    page._press("answer", ["robot", "yes"], ada)
    assert shown(page)["holders"] == {"robot": "Ada"}, "only true is a yes"
    page._press("ask", None, ben)
    page._press("answer", ["robot", True], ada)
    assert shown(page)["holders"] == {"robot": "Ben"}
    assert page.driver.pushes == [0.0] and page.is_driven, "it rests until Ben drives"
    page._press("take_over", False, ben)
    assert not page.is_driven and shown(page)["holders"] == {}
    page._press("pause", None, ada)
    assert shown(page)["state"] == "paused", "a robot that nobody drives is everybody's"


def test_first_visitor_of_a_robot_that_is_only_driven_drives() -> None:
    page, _ = of_robot(in_charge=True)
    ada, ben = visitors_of(page)
    for visitor in (ada, ben):
        page._press("arrived", None, visitor)
    assert shown(page)["holders"] == {"robot": "Ada"}
    page._press("drive", [1.0], ada)
    page._press("left", None, ben)
    assert page.driver is not None and page.driver.pushes == [1.0]
    page._press("left", None, ada)
    assert page.driver.pushes == [0.0]
    given, _ = of_robot(policies=("agent",))
    given._press("arrived", None, ada)
    assert shown(given)["holders"] == {}, "who comes to a policy looks on"
    given._press("renamed", None, ada)
    assert not ada.note


def test_robot_of_somebody_who_is_away_is_given_back(monkeypatch: pytest.MonkeyPatch) -> None:
    now_s = [100.0]
    monkeypatch.setattr("bricksrl.page.visitors.time.monotonic", lambda: now_s[0])
    for policies in ((), ("agent",)):
        page, _ = of_robot(in_charge=True, policies=policies)
        ada, _ben = visitors_of(page)
        page._press("take_over", True, ada)
        page._press("drive", [1.0], ada)
        page.visitors.leave(ada, closed=True)
        now_s[0] += AWAY_S - 0.1
        page._tick()
        assert page.is_driven and shown(page)["holders"] == {"robot": "Ada"}
        now_s[0] += 0.2
        page._tick()
        assert page.driver is not None and page.driver.pushes == [0.0]
        assert page.is_driven == (not policies) and shown(page)["holders"] == {}
        page.visitors.arrive("a", "Ada")
        page._tick()
        assert page.is_driven and shown(page)["holders"] == {"robot": "Ada"}


# ---------------------------------------------------------------- the driver


def test_pushes_become_commands_in_their_units() -> None:
    commands = (
        Entry("turn_rate", -60.0, 60.0, "deg/s"),
        Entry("drive_speed", 50.0, 150.0, "mm/s"),
        Entry("back", -90.0, -30.0, "deg"),
    )
    driver = PageDriver(commands, in_charge=True)
    said = driver.described()
    assert said["moving"] == ["drive_speed is at least 50 mm/s", "back is at least 30 deg"]
    assert said["commands"][1] == {"name": "drive_speed", "unit": "mm/s"}
    assert said["in_charge"] is True and said["pushes"] == [0.0] * 3
    assert said["actions"] == driver.actions() == [0.0, 50.0, -30.0]
    assert driver.push([0.5, 7.0, -9.0])
    assert driver.pushes == [0.5, 1.0, -1.0] and driver.actions() == [30.0, 150.0, -90.0]
    driver.release()
    assert driver.pushes == [0.0] * 3
    resting = PageDriver((Entry("lift", 0.0, 90.0, "deg"), Entry("leg", -100.0, 0.0, "deg")))
    assert resting.described()["moving"] == []
    boundless = PageDriver((Entry("power", -math.inf, math.inf),))
    assert boundless.push([0.5]) and boundless.actions() == [0.5]
    assert not boundless.in_charge and boundless(torch.zeros(1)) is None
