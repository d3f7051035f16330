"""Teaching in a tab, with a page that is played: the same search on the same body, without a
browser."""

from __future__ import annotations

import json
import math
from dataclasses import replace
from pathlib import Path

import pytest

from brickhub.errors import DescriptionError
from brickhub.robot import HubKind, Motor, Robot
from brickhub.robot.line_edge import LineEdge
from bricktwin.robots import CART, EV3_DRIVER, ROBO_ARM, SCOUT, TWO_WHEELER, WALKER
from bricktwin.robots.as_drawn import robot_as_drawn
from bricktwin.site.tab import lessons, trial
from bricktwin.site.tab.lessons import (
    Record,
    ahead_mm,
    lesson_for,
    speed_at_edge,
    uprightness,
    walking_speed,
)
from bricktwin.site.tab.run import STOPPED_EXIT_CODE
from bricktwin.site.tab.teach import teach_in_tab
from bricktwin.twin.body import TwinBody
from bricktwin.twin.make_body import make_body
from bricktwin.twin.scene import Scene
from bricktwin.twin.standing import Pose
from bricktwin.worlds import world

TROT = (-0.9, 180.0)
EXAMPLES = Path(__file__).parents[4] / "examples"
BALANCER = robot_as_drawn(EXAMPLES / "drawings" / "balancer.ldr").robot


class TaughtPage:
    """A page that says stop after some frames."""

    def __init__(self, stop_at: int | None = None) -> None:
        self.stop_at = stop_at
        self.frames = 0
        self.events: list[dict[str, object]] = []

    def frame(self) -> None:
        self.frames += 1

    def post(self, events: str, rows: bytes) -> None:
        self.events += json.loads(events or "[]")

    def take(self) -> str:
        return '[{"kind": "stop"}]' if self.frames == self.stop_at else ""

    def may_go_on(self, time_ms: int) -> bool:
        raise AssertionError("nobody waits for a page")

    @property
    def trials(self) -> list[dict[str, object]]:
        return [event for event in self.events if event["kind"] == "trial"]


def teach(page: TaughtPage, trials: int, body: TwinBody | None = None, **request: object) -> int:
    content = {"goal": "walk", "seed": 3, "state": None, "numbers": None, "trials": trials}
    return teach_in_tab(json.dumps({**content, **request}), page, body or make_body(WALKER))


def test_a_trial_walks_and_is_the_same_each_time() -> None:
    """A person's numbers, before and after another trial on the same body."""
    page = TaughtPage()
    assert teach(page, 1, numbers=TROT) == 0
    (first,) = page.trials
    assert 65 < first["score"] < 85
    assert first["fell"] is False and first["seconds"] == 2.5
    assert first["numbers"] == list(TROT)
    # What acts is what can be taken away.
    assert "NUMBERS = (-0.9, 180,)" in str(first["source"])
    assert page.frames == 126
    again = TaughtPage()
    teach(again, 1, numbers=TROT, state=first["state"])
    assert again.trials[0]["score"] == first["score"]
    assert len(again.trials[0]["state"]["scores"]) == 2


def test_a_trial_does_not_begin_with_the_turn_of_the_last_one() -> None:
    body = make_body(SCOUT, scene=world("line-simple"))
    page = TaughtPage()
    for numbers in ((100.0, 1.0), (75.0, 4.5), (100.0, 1.0)):
        teach(page, 1, body, goal="follow", numbers=numbers)
    first, turns, again = (float(str(one["score"])) for one in page.trials)
    assert turns < 20 < first == again


def test_a_fall_ends_a_trial_and_is_told(monkeypatch: pytest.MonkeyPatch) -> None:
    # A Walker hardly ever falls: any tilt is one here.
    monkeypatch.setattr(trial, "TILT_DEG", 0.0)
    page = TaughtPage()
    teach(page, 1, numbers=TROT)
    assert page.trials[0]["fell"] is True
    # It had not moved yet, so nobody knows a speed.
    assert page.trials[0]["score"] is None


def test_stop_ends_it_within_a_trial_and_it_goes_on_from_there(
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    monkeypatch.setattr(lessons, "_STRIDE_STEPS", 4)
    stopped = TaughtPage(stop_at=70)
    assert teach(stopped, 5) == STOPPED_EXIT_CODE
    assert stopped.frames == 70 and len(stopped.trials) == 1
    rest = TaughtPage()
    teach(rest, 1, state=stopped.trials[0]["state"])
    whole = TaughtPage()
    teach(whole, 2)
    assert [one["score"] for one in stopped.trials + rest.trials] == [
        one["score"] for one in whole.trials
    ]


def test_who_can_learn_what() -> None:
    walk = lesson_for(WALKER, "open floor")
    assert walk is not None
    described = lessons.described(walk)
    assert described["goal"] == "walk"
    names = [number["name"] for number in described["numbers"]]
    assert names == ["turns of the legs", "left back lags by"]
    assert described["trial_s"] == 2.5
    assert lesson_for(ROBO_ARM, "open floor") is None
    assert lesson_for(TWO_WHEELER, "open floor") is None
    stop = lesson_for(TWO_WHEELER, "wall")
    assert stop is not None and stop.goal == "stop"
    kept = lesson_for(BALANCER, "wall", is_held=True)
    assert kept is not None and kept.goal == "upright"
    follow = lesson_for(SCOUT, "line-sharp")
    assert follow is not None and follow.goal == "follow"
    # It has no color sensor; and the devices of kits run no program of a hub.
    assert lesson_for(TWO_WHEELER, "line-sharp") is None
    assert lesson_for(CART, "line-sharp") is None
    assert lesson_for(EV3_DRIVER, "line-sharp") is not None


@pytest.mark.parametrize(("robot", "edge_pct"), [(SCOUT, 38), (EV3_DRIVER, 45)])
def test_a_robot_follows_the_edge_that_its_own_sensor_reads(robot: Robot, edge_pct: int) -> None:
    page = TaughtPage()
    body = make_body(robot, scene=world("line-simple"))
    teach(page, 1, body, goal="follow", numbers=(100.0, 0.5))
    (tried,) = page.trials
    assert f"follow_edge(observed[0], {edge_pct}, " in str(tried["source"])
    # Of 100 mm/s; where the other robot sees its edge, it would get half of them.
    assert tried["score"] > 60.0


@pytest.mark.parametrize(("gain", "stands"), [(25.0, True), (2.0, False)])
def test_a_try_to_keep_upright_is_worth_its_time(gain: float, stands: bool) -> None:
    page = TaughtPage()
    body = make_body(BALANCER, scene=Scene(held_deg=(1.0, 1.0)))
    numbers = (0.0, gain, 0.05 if stands else 0.0, 0.02, 0.015)
    assert teach(page, 1, body, goal="upright", numbers=numbers) == 0
    (tried,) = page.trials
    assert tried["fell"] is not stands
    assert (tried["score"] > 80.0) is stands
    assert tried["score"] > 1.0


def test_speed_counts_the_way_ahead_once_it_has_settled() -> None:
    start = Pose(1.0, 2.0, 90.0)
    # A heading of 90 degrees looks along -y.
    assert ahead_mm(start, Pose(1.5, 1.9, 0.0)) == pytest.approx(100.0)
    poses = [Pose(0.0, 0.0, 0.0)] * 4
    poses += [Pose(0.02 * step, 0.1, 0.0) for step in range(1, 8)]
    assert walking_speed(Record(poses=poses)) == pytest.approx(80.0)


def test_a_step_upright_is_worth_more_near_where_it_began() -> None:
    def score(*angles_deg: float) -> float:
        return uprightness(Record(observed=[(0.0, 0.0, angle, 0.0) for angle in angles_deg]))

    # All steps, at the place; wheels of a real robot have turned before.
    assert score(*[700.0] * 251) == pytest.approx(100.0)
    assert score(*[700.0] * 126) == pytest.approx(50.0), "those after a fall have no points"
    # Very far away, half of them; a turn away to either side, half and a third of the other half.
    assert score(0.0, *[1e6] * 250) == pytest.approx(50.0)
    for angle_deg in (360.0, -360.0):
        assert score(0.0, *[angle_deg] * 250) == pytest.approx(50.0 * (1 + math.exp(-1.0)))
    assert math.isnan(score(0.0)) and math.isnan(score())


def test_a_way_counts_as_far_as_the_sensor_is_near_the_edge() -> None:
    edge = LineEdge(10.0, 74.0)  # 42 on the edge, 30 beside it only line or floor

    def speed(*steps: tuple[float, float]) -> float:
        return speed_at_edge(Record(observed=list(steps)), edge)

    # 10 mm in each step of 50 ms are 200 mm/s.
    assert speed((0.0, 5.0), (42.0, 15.0), (42.0, 25.0)) == pytest.approx(200.0)
    assert speed((42.0, 0.0), (57.0, 10.0)) == pytest.approx(100.0)
    assert speed((42.0, 0.0), (27.0, 10.0)) == pytest.approx(100.0)
    assert speed((42.0, 0.0), (72.0, 10.0), (99.0, 20.0), (0.0, 30.0)) == 0.0
    # Backwards it loses what it had.
    assert speed((42.0, 0.0), (42.0, 10.0), (42.0, 0.0)) == pytest.approx(0.0)
    assert math.isnan(speed((42.0, 0.0))) and math.isnan(speed())


@pytest.mark.parametrize(
    ("robot", "where", "goal", "unit", "trial_s", "ends"),
    [
        (WALKER, "open floor", "walk", "mm/s", 2.5, [(-1.0, 1.0), (0.0, 360.0)]),
        (TWO_WHEELER, "wall", "stop", "points", 4.0, [(0.0, 800.0), (0.0, 6.0)]),
        (SCOUT, "line-gaps", "follow", "mm/s", 4.0, [(0.0, 250.0), (-5.0, 5.0)]),
        (SCOUT, "line-simple", "follow", "mm/s", 4.0, [(0.0, 250.0), (-5.0, 5.0)]),
    ],
)
def test_a_page_knows_what_is_learned_by_which_numbers(
    robot: Robot,
    where: str,
    goal: str,
    unit: str,
    trial_s: float,
    ends: list[tuple[float, float]],
) -> None:
    lesson = lesson_for(robot, where)
    assert lesson is not None
    described = lessons.described(lesson)
    assert (described["goal"], described["unit"], described["trial_s"]) == (goal, unit, trial_s)
    numbers = described["numbers"]
    assert [(number["low"], number["high"]) for number in numbers] == ends
    assert all(number["name"] for number in numbers)
    # Where they score more the later they fall, a fall is no worse than its score.
    assert not lesson.falls_late


def test_who_lacks_what_a_goal_needs_is_told() -> None:
    held = lesson_for(BALANCER, "wall", is_held=True)
    assert held is not None and held.falls_late and held.steps * held.step_ms == 5000
    assert len(held.labels) == len(held.structure.numbers) == 5
    blind = replace(TWO_WHEELER, sensors=())
    for make, robot, says in (
        (lessons.stop_before_wall, blind, "sees no wall; give it an ultrasonic sensor"),
        (lessons.keep_upright, replace(TWO_WHEELER, needs_imu=False), "does not measure how it"),
        (lessons.follow_line, blind, "follows no line by itself; give it a hub and a color sensor"),
        (lessons.follow_line, CART, "follows no line by itself"),
    ):
        with pytest.raises(DescriptionError, match=says):
            make(robot)
    # A motor with end stops turns not all around, and one that does beside it is a turntable.
    turntable = Robot(
        "crane", HubKind.PRIME, (Motor("table", "A"), Motor("boom", "B", end_stops_deg=(-9, 9)))
    )
    with pytest.raises(DescriptionError, match="need motors that turn"):
        lessons.walk(turntable)


@pytest.mark.slow
def test_it_learns_to_walk_faster_than_a_trot() -> None:
    """88 seconds of the robot."""
    page = TaughtPage()
    teach(page, 35)
    teach(page, 1, numbers=TROT)
    *tried, trot = page.trials
    scores = [float(str(one["score"])) for one in tried]
    assert max(scores) > 1.03 * float(str(trot["score"]))
    assert max(scores) > max(scores[:6])


@pytest.mark.slow
@pytest.mark.parametrize("seed", range(1, 4))
def test_it_learns_to_stop_at_the_wall_and_does_not_repeat_itself(seed: int) -> None:
    """140 seconds of the robot; a person's numbers get 75 points."""
    page = TaughtPage()
    body = make_body(TWO_WHEELER, scene=world("wall"))
    teach(page, 35, body, goal="stop", seed=seed)
    scores = [float(str(one["score"])) for one in page.trials]
    assert max(scores) > 65
    tried = [tuple(one["numbers"]) for one in page.trials]
    assert len(set(tried)) > 28


@pytest.mark.slow
@pytest.mark.parametrize("robot", [SCOUT, EV3_DRIVER])
@pytest.mark.parametrize("seed", range(1, 5))
def test_it_learns_to_follow_a_line_faster_than_the_example(seed: int, robot: Robot) -> None:
    """140 seconds of the robot."""
    page = TaughtPage()
    body = make_body(robot, scene=world("line-simple"))
    teach(page, 35, body, goal="follow", seed=seed)
    teach(page, 1, body, goal="follow", numbers=(120.0, 1.2))
    *scores, example = (float(str(one["score"])) for one in page.trials)
    assert max(scores) > 1.1 * example
