"""What a tab's run tells its page, and what a trial takes from its program, piece by piece."""

from __future__ import annotations

import json
import math
from array import array
from types import SimpleNamespace
from typing import Any

import pytest

from brickhub.hub.program.generate import TILT_DEG
from brickhub.robot import HubKind
from brickhub.virtual.bench_body import FittedBench
from bricktwin.site.tab import recorder as recorder_module
from bricktwin.site.tab.recorder import Recorder
from bricktwin.site.tab.trial import _Console, _Over


class KeptPage:
    """A page that keeps what comes."""

    def __init__(self) -> None:
        self.posts: list[tuple[list[dict[str, Any]], list[float]]] = []
        self.frames = 0

    def frame(self) -> None:
        self.frames += 1

    def post(self, events: str, rows: bytes) -> None:
        self.posts.append((json.loads(events or "[]"), array("f", rows).tolist()))

    def take(self) -> str:
        return ""

    def may_go_on(self, time_ms: int) -> bool:
        return True


class Clock:
    """Real time, which goes on when it is told to."""

    def __init__(self) -> None:
        self.now_s = 100.0

    def monotonic(self) -> float:
        return self.now_s


@pytest.fixture
def clock(monkeypatch: pytest.MonkeyPatch) -> Clock:
    clock = Clock()
    monkeypatch.setattr(recorder_module, "time", clock)
    return clock


@pytest.fixture
def page() -> KeptPage:
    return KeptPage()


def machine_of(body: Any, *ports: str) -> Any:
    """A machine at 40 ms with motors on these ports."""
    panel = SimpleNamespace(on_change=None)
    robot = SimpleNamespace(hub=HubKind.PRIME)
    return SimpleNamespace(
        time_ms=40, servos=dict.fromkeys(ports), body=body, panel=panel, robot=robot
    )


def body_of(heading_deg: float = 12.5) -> Any:
    """A body whose motor on port B stands at 2 degrees, the one on C at 3, and so on."""
    return SimpleNamespace(
        angle_mdeg=lambda port: 1000 * (ord(port) - ord("A") + 1), heading_deg=lambda: heading_deg
    )


def test_a_frame_has_the_time_the_angles_and_the_heading(clock: Clock, page: KeptPage) -> None:
    recorder = Recorder(page)
    recorder.frame()
    assert page.frames == 0 and page.posts == []
    recorder.begin(machine_of(body_of(), "B", "E"))
    assert page.frames == 1 and page.posts == []
    recorder.post()
    ((events, row),) = page.posts
    assert events == [] and row[0] == 40.0 and row[-1] == 12.5
    angles = dict(zip("ABCDEF", row[1:-1], strict=True))
    assert {port for port, angle in angles.items() if not math.isnan(angle)} == {"B", "E"}
    assert (angles["B"], angles["E"]) == (2.0, 5.0)


def test_what_has_gathered_is_posted_once_and_nothing_is_not_posted(
    clock: Clock, page: KeptPage
) -> None:
    recorder = Recorder(page)
    recorder.post()
    assert page.posts == []
    recorder.tell("note", text="a")
    recorder.post()
    recorder.post()
    assert page.posts == [([{"kind": "note", "ms": 0, "text": "a"}], [])]


def test_posts_are_as_far_apart_as_pictures_of_a_screen(clock: Clock, page: KeptPage) -> None:
    recorder = Recorder(page)
    recorder.tell("note")
    for now_s, posts in ((100.010, 0), (100.0149, 0), (100.0151, 1)):
        clock.now_s = now_s
        recorder.post_in_time()
        assert len(page.posts) == posts
    # The next one is counted from that one.
    recorder.tell("note")
    for now_s, posts in ((100.020, 1), (100.0295, 1), (100.0305, 2)):
        clock.now_s = now_s
        recorder.post_in_time()
        assert len(page.posts) == posts
    # A frame looks at the clock too.
    recorder.begin(machine_of(body_of()))
    assert len(page.posts) == 2
    clock.now_s += 0.016
    recorder.frame()
    assert len(page.posts) == 3 and len(page.posts[-1][1]) == 2 * 8


def test_pieces_of_one_print_are_one_event(clock: Clock, page: KeptPage) -> None:
    recorder = Recorder(page)
    machine = machine_of(body_of())
    recorder.begin(machine)
    for kind, text in (("out", "a"), ("out", "b"), ("err", "c"), ("err", "d"), ("out", "e")):
        recorder.tell(kind, text=text)
    machine.time_ms = 60
    recorder.tell("out", text="f")
    # Only what is printed has pieces.
    recorder.tell("note", text="g")
    recorder.tell("note", text="h")
    recorder.post()
    ((events, _),) = page.posts
    assert [(event["kind"], event["ms"], event["text"]) for event in events] == [
        ("out", 40, "ab"),
        ("err", 40, "cd"),
        ("out", 40, "e"),
        ("out", 60, "f"),
        ("note", 60, "g"),
        ("note", 60, "h"),
    ]
    # What is printed after a post is an event of its own.
    recorder.tell("out", text="i")
    recorder.post()
    assert [event["text"] for event in page.posts[-1][0]] == ["i"]


def test_a_program_that_tells_without_end_is_posted_in_pieces(clock: Clock, page: KeptPage) -> None:
    recorder = Recorder(page)
    for number in range(499):
        recorder.tell("note", number=number)
    assert page.posts == []
    recorder.tell("note", number=499)
    assert [event["number"] for event in page.posts[0][0]] == list(range(500))
    recorder.tell("note", number=500)
    assert len(page.posts) == 1


class Bench(FittedBench):
    """A bench on which a test plugs devices."""

    def __init__(self) -> None:
        self.plugged: dict[str, str] = {}

    def device(self, port: str) -> str | None:
        return self.plugged.get(port)

    def heading_deg(self) -> float:
        return 0.0


def test_devices_of_a_bench_are_told_when_there_are_others(clock: Clock, page: KeptPage) -> None:
    recorder = Recorder(page)
    bench = Bench()
    recorder.begin(machine_of(bench))
    recorder.frame()
    for port, device in (("A", "motor"), ("C", "eyes")):
        bench.plugged[port] = device
        recorder.frame()
        recorder.frame()
    recorder.post()
    ((events, _),) = page.posts
    assert [event["devices"] for event in events] == [{"A": "motor"}, {"A": "motor", "C": "eyes"}]
    assert {event["kind"] for event in events} == {"devices"}


def test_a_robot_that_is_no_bench_has_its_devices_from_its_description(
    clock: Clock, page: KeptPage
) -> None:
    recorder = Recorder(page)
    recorder.begin(machine_of(body_of(), "A"))
    recorder.frame()
    recorder.post()
    assert page.posts[0][0] == []


def test_a_change_of_the_panel_is_told_in_full(clock: Clock, page: KeptPage) -> None:
    recorder = Recorder(page)
    machine = machine_of(body_of())
    recorder.begin(machine)
    machine.panel.on_change(
        SimpleNamespace(
            light="red",
            display=[1],
            text="hi",
            quarter_turns=3,
            sound_hz=440,
            lamps={"A": 1},
            packed_screen=lambda: "screen",
        )
    )
    recorder.post()
    assert page.posts[0][0] == [
        {
            "kind": "panel",
            "ms": 40,
            "light": "red",
            "display": [1],
            "text": "hi",
            "turns": 3,
            "hz": 440,
            "lamps": {"A": 1},
            "screen": "screen",
        }
    ]


def console_of(steps: int, count: int = 3, tilts: tuple[int, ...] = (1, 2)) -> _Console:
    body: Any = SimpleNamespace(pose=lambda: "here")
    return _Console(body, count, steps, tilts)


def test_a_line_of_a_trial_is_its_time_its_channels_and_its_commands() -> None:
    console = console_of(steps=5)
    for piece in (b"20 1.5", b" -2 3 7 8\r", b"\n40 ", b"2 0 0 9 9\r\n60 3"):
        console.write(piece)
    assert console.record.observed == [[1.5, -2.0, 3.0], [2.0, 0.0, 0.0]]
    assert console.record.poses == ["here", "here"] and not console.record.has_fallen
    # Nobody types.
    assert console.available() == 0
    with pytest.raises(EOFError, match="nobody types"):
        console.read(1)


def test_a_trial_ends_after_its_last_step() -> None:
    console = console_of(steps=2)
    console.write(b"0 1 0 0\r\n20 1 0 0\r\n")
    with pytest.raises(_Over):
        console.write(b"40 1 0 0\r\n")
    # Before each step and after the last one.
    assert len(console.record.poses) == len(console.record.observed) == 3
    assert not console.record.has_fallen


@pytest.mark.parametrize(
    ("pitch_deg", "roll_deg", "has_fallen"),
    [
        (TILT_DEG, -TILT_DEG, False),
        (TILT_DEG + 0.1, 0.0, True),
        (-TILT_DEG - 0.1, 0.0, True),
        (0.0, -TILT_DEG - 0.1, True),
    ],
)
def test_a_trial_ends_when_the_robot_falls(
    pitch_deg: float, roll_deg: float, has_fallen: bool
) -> None:
    console = console_of(steps=9)
    line = f"0 999 {pitch_deg} {roll_deg}\r\n".encode()
    if not has_fallen:
        console.write(line)
        assert not console.record.has_fallen
        return
    with pytest.raises(_Over):
        console.write(line)
    assert console.record.has_fallen and len(console.record.observed) == 1
