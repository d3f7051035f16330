"""Sensors on the computer: a serial port (a pseudo-terminal), failures, ages, cameras, and all who
know them."""

from __future__ import annotations

import math
import os
import re
import statistics
import sys
import threading
import time
from collections.abc import Iterator
from contextlib import closing
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
import pytest
import torch

import bricksrl
from brickhub.entry import Entry
from bricksrl.cli import main
from bricksrl.data import load
from bricksrl.envs.env import HubEnv
from bricksrl.envs.env_checker import check_env
from bricksrl.envs.host_sensors.devices import second_camera, serial_numbers
from bricksrl.envs.host_sensors.host_sensor import HostSensor, ThreadReader, World, reader_of
from bricksrl.envs.registry import get_task, register
from bricksrl.envs.tasks.spinning import SPINNING
from bricksrl.envs.vision.camera import CameraView
from bricksrl.errors import DescriptionError, SensorError
from bricksrl.interfaces.gymnasium import GymnasiumEnv
from bricksrl.page.live import LivePage
from bricksrl.policies import load_policy
from bricksrl.training import RunFolder, TrainConfig, train
from bricktwin.twin.scene import Scene

TASK = '''
"""The scout looks for the warm end of the room: a thermometer on a serial port."""
import os
from torch import Tensor
from brickhub.entry import Entry
from bricksrl.envs import Task
from bricksrl.envs.host_sensors.devices import serial_numbers
from bricksrl.envs.host_sensors.host_sensor import HostSensor, World
from bricksrl.hub.interface import DriveStraight, Heading, Interface, UntilDone
from bricksrl.robots import TWO_WHEELER

def in_twin(world: World) -> tuple[float, float]:
    pose = world.pose()
    return 20 + 10 * pose.x_m + world.rng.normal(0, 0.05), 48.0

def reward(previous: Tensor, action: Tensor, observation: Tensor) -> Tensor:
    return observation[..., 1:2] - previous[..., 1:2]

THERMOMETER = HostSensor(
    "thermometer",
    entries=(Entry("temperature", 0, 50, "C"), Entry("humidity", 0, 100, "%")),
    open=serial_numbers(os.environ.get("THERMOMETER", "/dev/ttyACM0")),
    twin=None if "THERMOMETER" in os.environ else in_twin,
    observes_age=True,
)
TASK = Task(
    id="Warm-v0",
    doc=__doc__,
    robot=TWO_WHEELER,
    interface=Interface((DriveStraight(-100, 100),), (Heading(),), UntilDone()),
    sensors=(THERMOMETER,),
    max_steps=10,
    reward=reward,
    success=lambda observations: observations[..., -1, 1] > 25,
    metrics=lambda observations: {"final_temperature_c": observations[..., -1, 1]},
)
'''


class Board:
    """A microcontroller at the other end of a pseudo-terminal, which writes a line every 20 ms."""

    def __init__(self) -> None:
        self.hand, self.port = os.openpty()
        self.address = os.ttyname(self.port)
        self.line = "21.5, 48"
        self._is_over = threading.Event()
        threading.Thread(target=self._write, daemon=True).start()

    def _write(self) -> None:
        while not self._is_over.wait(0.02):
            if self.line:
                os.write(self.hand, f"{self.line}\r\n".encode())

    def close(self) -> None:
        self._is_over.set()
        time.sleep(0.05)
        os.close(self.hand)
        os.close(self.port)


@pytest.fixture
def board() -> Iterator[Board]:
    if sys.platform == "win32":
        pytest.skip("pseudo-terminals are of POSIX")
    made = Board()
    yield made
    made.close()


class Clock:
    """A device that takes a time for each reading."""

    def __init__(self, reading_s: float = 0.0) -> None:
        self.reading_s, self.is_broken, self.opened, self.closed = reading_s, False, 0, 0

    def __call__(self) -> Clock:
        if self.is_broken:
            raise OSError("no such device")
        self.opened += 1
        return self

    def read(self) -> tuple[float, ...]:
        time.sleep(self.reading_s)
        if self.is_broken:
            raise OSError("it was unplugged")
        return (42.0,)

    def close(self) -> None:
        self.closed += 1


CLOCK = len(SPINNING.interface.channels)
"""Its place in the observation."""


def with_sensor(device: Any, name: str = "Clock-v0", **fields: Any) -> HubEnv:
    sensor = HostSensor("clock", (Entry("tick", 0, 100),), device, **fields)
    register(replace(SPINNING, id=name, max_steps=6, sensors=(sensor,)))
    env = bricksrl.make(name, seed=0)
    assert isinstance(env, HubEnv)
    return env


def action(env: HubEnv) -> torch.Tensor:
    return torch.zeros(env.action_spec.shape)


def test_lines_of_numbers_from_a_serial_port(board: Board) -> None:
    sensor = HostSensor(
        "board",
        (Entry("a", 0, 50), Entry("b", 0, 100)),
        serial_numbers(board.address),
        patience_s=2.0,
    )
    reader = ThreadReader(sensor)
    reader.open()
    assert reader.latest()[0] == (21.5, 48.0) and reader.latest()[1] < 0.5
    board.line = "22;49"
    time.sleep(0.3)
    assert reader.latest()[0] == (22.0, 49.0)
    board.line = "hello"
    time.sleep(0.2)
    board.line = "23 50"
    time.sleep(0.3)
    assert reader.latest()[0] == (23.0, 50.0), "lines without numbers are skipped"
    board.line = "1, 2, 3"
    time.sleep(0.3)
    with pytest.raises(
        SensorError, match=r"gives \[1.0, 2.0, 3.0\]; let it give a number each for a, b"
    ):
        reader.latest()
    board.line = ""
    with pytest.raises(SensorError, match="says nothing for 1.5 s|gave no reading"):
        reader.open()
    reader.close()


class Port:
    """A serial port with these lines, of which so many wait at first."""

    port = "COM3"

    def __init__(self, lines: list[bytes], waiting: int) -> None:
        self.lines, self.in_waiting = lines, waiting

    def readline(self) -> bytes:
        self.in_waiting = max(0, self.in_waiting - 1)
        return self.lines.pop(0) if self.lines else b""


@pytest.mark.parametrize(
    ("lines", "waiting", "read"),
    [
        ([b".5, 48\n", b"21.5, 48\n", b"22;49\n"], 2, (21.5, 48.0)),
        ([b".5, 48\n", b"21.5, 48\r\n", b"22;49\n", b"23 50\n"], 3, (22.0, 49.0)),
        ([b"", b"ready\n", b"\xff\xfe\n", b" -7.25e1 \n"], 0, (-72.5,)),
        ([b"x\n"], 0, "COM3 says nothing for 1.5 s; look whether its program runs"),
        ([b"x\n", b"1\n", b""], 9, "COM3 says nothing"),
        ([b"x\n", *[b"hello\n"] * 1000, b"1\n"], 0, "no lines of numbers but 'hello'; correct"),
        ([b"x\n", *[b"hello\n"] * 999, b"1\n"], 0, (1.0,)),
    ],
)
def test_the_newest_line_of_numbers_is_read_and_the_first_one_dropped(
    monkeypatch: pytest.MonkeyPatch, lines: list[bytes], waiting: int, read: tuple[float, ...] | str
) -> None:
    serial = pytest.importorskip("serial")
    asked = []

    def opened(address: str, baud: int, *, timeout: float) -> Port:
        asked.append((address, baud, timeout))
        return Port(list(lines), waiting)

    monkeypatch.setattr(serial, "serial_for_url", opened)
    device = serial_numbers("COM3", 9600)()
    assert asked == [("COM3", 9600, 1.5)]
    if isinstance(read, tuple):
        assert device.read() == read
        return
    with pytest.raises(SensorError, match=read):
        device.read()


@pytest.mark.realtime
def test_slow_sensor_makes_no_step_longer() -> None:
    medians: dict[float, list[float]] = {0.0: [], 1.0: []}
    for reading_s in (0.0, 1.0) * 3:
        with closing(with_sensor(Clock(reading_s), observes_age=True)) as env:
            seconds = []
            for _ in range(5):
                state = env.reset()
                for _ in range(6):
                    started_s = time.perf_counter()
                    state = env.step(state.set("action", action(env)))["next"]
                    seconds.append(time.perf_counter() - started_s)
            medians[reading_s].append(statistics.median(seconds))
            assert state["observation"][CLOCK + 1] < 2.0, "the age"
    assert min(medians[1.0]) - min(medians[0.0]) < 1e-3


def test_sensor_that_dies_ends_the_step_as_lost_and_may_come_back() -> None:
    device = Clock()
    with closing(with_sensor(device)) as env:
        state = env.reset()
        assert state["observation"][CLOCK] == 42.0
        device.is_broken = True
        time.sleep(0.1)
        lost = env.step(state.set("action", action(env)))["next"]
        assert bool(lost["link_lost"]) and lost["observation"].equal(state["observation"])
        told = (
            r"sensor 'clock' failed \(OSError: it was unplugged, test_host_sensors.py, line "
            r"\d+\); plug it in, or correct it"
        )
        assert re.fullmatch(told, str(env.link_error))
        with pytest.raises(SensorError, match="OSError: no such device"):
            env.reset()
        device.is_broken = False
        assert not bool(env.step(env.reset().set("action", action(env)))["next", "link_lost"])
    time.sleep(0.1)
    assert device.opened == device.closed == 2


def test_silent_sensor_is_lost_after_its_patience() -> None:
    device = Clock()
    with closing(with_sensor(device, patience_s=0.3)) as env:
        state = env.reset()
        device.reading_s = 2.0
        time.sleep(0.5)
        lost = env.step(state.set("action", action(env)))["next"]
        assert bool(lost["link_lost"]) and "gave no reading for 0.3 s; look at its cable" in str(
            env.link_error
        )


def test_run_goes_on_when_the_sensor_is_back(tmp_path: Path) -> None:
    device = Clock()
    env = with_sensor(device)

    class Unplug(bricksrl.training.Callback):
        lost = 0

        def on_step(self, episode: int, step: int, phase: Any) -> None:
            if (episode, step) == (2, 3) and not self.lost:
                device.is_broken = True
                time.sleep(0.1)

        def on_link_lost(self, episode: int, length: int, error: Any) -> None:
            self.lost += 1
            device.is_broken = self.lost < 3

    callback, run = Unplug(), tmp_path / "run"
    train(
        TrainConfig("Clock-v0", "random", episodes=4, run_dir=run, patience_s=60), callback, env=env
    )
    env.close()
    episodes = RunFolder(run).read_episodes()
    assert callback.lost == 3 and [(e.length, e.link_lost) for e in episodes] == [
        (6, False),
        (3, True),
        (6, False),
        (6, False),
    ]
    assert len(load(run)) == 21, "the steps before the loss are in the data"


@pytest.mark.slow
@pytest.mark.parametrize("is_real", [False, True])
def test_task_with_a_serial_sensor_is_trained(
    is_real: bool,
    board: Board,
    tmp_path: Path,
    monkeypatch: pytest.MonkeyPatch,
    capsys: pytest.CaptureFixture[str],
) -> None:
    assert len(TASK.strip().splitlines()) <= 40
    file, run = tmp_path / "warm.py", tmp_path / "run"
    file.write_text(TASK)
    if is_real:
        monkeypatch.setenv("THERMOMETER", board.address)
    assert main(["check", str(file)]) == 0
    assert (
        "sensors" in (text := capsys.readouterr().out)
        and f"temperature {'21.5' if is_real else '2'}" in text
    )
    assert (
        main(["train", str(file), "--episodes", "3" if is_real else "12", "--run", str(run)]) == 0
    )
    data = load(run)
    names = [entry.name for entry in data.description.observation]
    assert names == ["heading", "temperature", "humidity", "thermometer_age"]
    readings = data.observation.numpy()
    assert readings[:, 3].max() < 1.0 and (len(np.unique(readings[:, 1])) == 1) is is_real
    policy = load_policy(run)
    cold, warm = (
        policy.act(np.array([0.0, celsius, 48.0, 0.0], np.float32)) for celsius in (20.0, 25.0)
    )
    assert policy.shapes == {"observation": (4,)} and np.array_equal(cold, warm) is is_real, (
        "it reads what varied"
    )
    with LivePage("warm", task=get_task(str(file))) as page:
        assert page.board.series["channels"].names[1] == "temperature (C)"
    if not is_real:
        last = RunFolder(run).read_episodes()[-3:]
        assert sum(episode.return_ for episode in last) / 3 > 3, "it drives to where it is warm"


def test_reading_of_a_twin_is_repeatable_and_has_its_rate() -> None:
    def noise(world: World) -> tuple[float]:
        return (world.rng.normal(),)

    episodes = []
    for rate_hz in (50.0, 50.0, 2.0):
        with closing(with_sensor(Clock(), twin=noise, rate_hz=rate_hz)) as env:
            episodes.append(env.rollout(6)["next", "observation"][:, CLOCK].tolist())
    assert episodes[0] == episodes[1] and len(set(episodes[0])) == 6
    assert len(set(episodes[2])) < 5, "a reading stays until the next one is due"


def test_mistake_in_a_twin_is_no_lost_link() -> None:
    says = r"the twin of a sensor 'clock' gives 3\.0; let it give a number each for tick"
    with (
        closing(with_sensor(Clock(), twin=lambda _: 3.0)) as env,
        pytest.raises(DescriptionError, match=says),
    ):
        env.reset()


def test_second_camera_is_an_image_of_its_own() -> None:
    view = CameraView("chase", width_px=160, height_px=120, image_px=32)
    register(replace(SPINNING, id="Filmed-v0", max_steps=2, sensors=(second_camera(view),)))
    with closing(bricksrl.make("Filmed-v0", seed=0)) as env:
        episode = env.rollout(2)
        assert episode["chase"].shape == (2, 32, 32, 3) and episode["chase"].dtype == torch.uint8
        assert episode["chase"].float().std() > 5, "it shows something"
    gym = GymnasiumEnv("Filmed-v0")
    assert set(gym.observation_space.spaces) == {"observation", "chase"}
    gym.close()


def test_check_reads_the_sensors() -> None:
    with_sensor(Clock()).close()
    found = {finding.name: finding.detail for finding in check_env("Clock-v0")}
    assert (
        found["sensors"] == "tick 42"
        and found["determinism"] == "clock is a real sensor beside the virtual robot"
    )


@pytest.mark.parametrize(
    "reading", ["7", b"7", 7.0, None, (), (1.0, 2.0), ("warm",), (math.nan,), (1e300,)]
)
def test_what_is_no_number_each_is_refused(reading: Any) -> None:
    sensor = HostSensor("clock", (Entry("tick", 0, 1),), Clock())
    with pytest.raises(SensorError, match="let it give a number each for tick"):
        sensor.checked(reading)


def test_an_image_of_a_sensor_is_square_and_has_three_colors() -> None:
    sensor = HostSensor("eye", (), Clock(), image_px=4)
    image = np.zeros((4, 4, 3), np.uint8)
    assert sensor.checked(image) is image
    for wrong in (image[0], image[:, :3], image[..., :1], np.zeros((8, 8, 3)), (1.0,), None):
        with pytest.raises(SensorError, match="'eye' gives no image of 4 x 4 px in three colors"):
            sensor.checked(wrong)


def test_a_number_of_a_sensor_may_be_any_but_its_age_is_below_its_patience() -> None:
    entries = (Entry("tick", 0, 9, "s"), Entry("turn", -5, 5, limits=(-7, 7)))
    sensor = HostSensor("clock", entries, Clock(), observes_age=True, patience_s=2.5)
    assert sensor.checked(["-3.4e38", 3.4e38]) == (-3.4e38, 3.4e38)
    tick, turn, age = sensor.observed_entries
    assert (tick.low, tick.high, tick.bounds) == (0, 9, (-math.inf, math.inf))
    assert turn.bounds == (-7, 7)
    assert (age.name, age.bounds, age.unit) == ("clock_age", (0.0, 2.5), "s")
    assert len(replace(sensor, observes_age=False).observed_entries) == 2


def test_a_twin_is_read_at_most_as_often_as_its_rate() -> None:
    now_s, readings, device = [0.0], iter(range(9)), Clock()
    world = World(None, None, Scene(), np.random.default_rng(0), lambda: now_s[0], {"a": device})
    sensor = HostSensor(
        "clock", (Entry("tick", 0, 9),), Clock(), rate_hz=4.0, twin=lambda world: (next(readings),)
    )
    reader = reader_of(sensor, world)
    reader.open()
    seen = []
    for at_s in (0.0, 0.125, 0.25, 0.375, 0.5):
        now_s[0] = at_s
        seen.append(reader.latest())
    first, second, third = (0.0,), (1.0,), (2.0,)
    assert seen == [(first, 0.0), (first, 0.125), (second, 0.0), (second, 0.125), (third, 0.0)]
    reader.open()
    assert reader.latest() == ((3.0,), 0.0), "an episode begins with a reading of its own"
    reader.close()
    assert device.closed == 1
    assert isinstance(reader_of(sensor, None), ThreadReader)
    assert isinstance(reader_of(replace(sensor, twin=None), world), ThreadReader)


@pytest.mark.parametrize(
    ("fields", "problem"),
    [
        ({"entries": ()}, "give a name of letters and digits, and either entries or image_px"),
        ({"name": "my sensor"}, "give a name of letters"),
        ({"rate_hz": 0.0}, "give a rate and a patience above 0"),
        ({"patience_s": 0.0}, "give a rate and a patience above 0"),
        ({"image_px": 8}, "either entries or image_px"),
        ({"open": "COM3"}, "open is 'COM3'; give a function"),
        ({"open": lambda port: port}, "open of sensor 'clock' takes other arguments"),
        ({"twin": lambda: (1.0,)}, "twin of sensor 'clock' takes other arguments"),
    ],
)
def test_inconsistent_description_is_refused(fields: dict[str, Any], problem: str) -> None:
    with pytest.raises(DescriptionError, match=problem):
        HostSensor(
            **{"name": "clock", "entries": (Entry("tick", 0, 1),), "open": Clock(), **fields}
        )
