"""Teaching in a tab, with a page that is played: the same search on the same body, without a
browser."""

from __future__ import annotations

import json
from pathlib import Path

import pytest

from brickhub.robot import Robot
from bricktwin.robots import CART, EV3_DRIVER, ROBO_ARM, SCOUT, TWO_WHEELER, WALKER
from bricktwin.robots.as_drawn import robot_as_drawn
from bricktwin.site.tab import lessons, trial
from bricktwin.site.tab.lessons import Record, ahead_mm, lesson_for, walking_speed
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
