"""AppData and streaming on the virtual hub."""

from __future__ import annotations

import dataclasses
import itertools

import numpy as np
import pytest
import torch
from tensordict import TensorDict

import bricksrl
from brickhub.hub.interface import Interface, MotorAngle, RunAngle, Wait
from brickhub.hub.link.lockstep import HubLink
from brickhub.hub.link.profiles import LinkProfile
from brickhub.hub.link.streaming import StreamingLink
from brickhub.hub.program.generate import WATCHDOG_MS
from brickhub.hub.transport import HubProgram, Pipe
from brickhub.virtual.virtual_transport import VirtualHub
from bricksrl.envs.env import HubEnv
from bricksrl.envs.tasks.spinning import SPINNING
from bricksrl.errors import DescriptionError, HubError
from bricktwin.robots import TWO_WHEELER
from bricktwin.twin.make_body import make_body
from bricktwin.twin.physics import Physics

STEP_S = 0.1
STEADY = LinkProfile(15.0)


def stream(interval_ms: float = 15.0, **options: object) -> StreamingLink:
    hub = VirtualHub(make_body(TWO_WHEELER, seed=1), link=LinkProfile(interval_ms))
    return StreamingLink(hub, TWO_WHEELER, SPINNING.interface, **options)


def test_app_data_equals_standard_input() -> None:
    readings = {}
    for pipe in Pipe:
        hub = VirtualHub(make_body(TWO_WHEELER, seed=1), link=STEADY)
        with HubLink(hub, TWO_WHEELER, SPINNING.interface, pipe=pipe) as link:
            assert ("pybricks.messaging" in link.program.source) is (pipe is Pipe.APP_DATA)
            readings[pipe] = np.array([link.act([50, -50]).values[:2] for _ in range(5)])
            assert link.statistics.resends == 0
    difference = (readings[Pipe.STDIN] - readings[Pipe.APP_DATA] + 180) % 360 - 180
    assert np.abs(difference).max() < 5


def test_app_data_without_buffer_raises() -> None:
    hub = VirtualHub(make_body(TWO_WHEELER))
    hub.start(HubProgram("from pybricks.tools import wait\nwait(1000)\n", 1, Pipe.APP_DATA))
    with pytest.raises(HubError, match="no AppData buffer"):
        hub.write(b"hello")
    hub.close()


def test_watchdog_over_app_data_keeps_time_when_waits_take_longer() -> None:
    hub = VirtualHub(make_body(TWO_WHEELER))
    interface = Interface((RunAngle("left", -3000, 3000, 400),), (MotorAngle("left"),), Wait(10))
    link = HubLink(hub, TWO_WHEELER, interface, pipe=Pipe.APP_DATA)
    assert "wait(1)" in link.program.source
    link.program = dataclasses.replace(
        link.program, source=link.program.source.replace("wait(1)", "wait(2)")
    )
    with link:
        link.act([3000])
        hub.run_on_until(hub.machine.time_ms + WATCHDOG_MS)
        assert not hub.machine.servos["E"].control.is_active


@pytest.mark.parametrize("interval_ms", [7.5, 15.0, 30.0, 45.0])
def test_streaming_steps_are_periodic_and_fresh(interval_ms: float) -> None:
    with stream(interval_ms) as link:
        link.act([50, 50])
        before = link.now_s()
        readings = [link.act([50, 50]) for _ in range(20)]
        assert link.now_s() - before == pytest.approx(20 * STEP_S, abs=0.002)
        ages = [reading.age_s for reading in readings]
        assert min(ages) > 0 and max(ages) < 0.010 + 2 * interval_ms / 1000 + 0.005
        assert link.statistics.age_p99_s == pytest.approx(max(ages), abs=0.01)
        assert link.statistics.resends == 0 == link.statistics.stale_answers


def test_observation_age_is_accurate_to_half_round_trip() -> None:
    """The simulation knows the true age: the program's clock starts with the program."""
    with stream() as link:
        hub = link._transport
        # too late by the way back
        started_s = min(link.now_s() - link.read().hub_time_ms / 1000 for _ in range(3))
        for _ in range(20):
            reading = link.act([30, 30])
            assert reading.age_s == pytest.approx(
                hub.now_s() - started_s - reading.hub_time_ms / 1000, abs=0.016
            )


def test_lockstep_is_slower_and_older_than_streaming() -> None:
    with HubLink(
        VirtualHub(make_body(TWO_WHEELER, seed=1), link=STEADY), TWO_WHEELER, SPINNING.interface
    ) as link:
        readings = [link.act([50, 50]) for _ in range(10)]
        assert np.diff([reading.hub_time_ms for reading in readings]).mean() > 1000 * STEP_S + 10
        assert all(0 <= reading.age_s < 0.03 for reading in readings)
        assert readings[-1].age_s > 0.003


def test_latest_command_counts() -> None:
    with stream() as link:
        for angle in (100, -100, 100):
            link.act([angle, angle])
        assert len(link.act([0, 0]).values) == 5


def test_reading_between_steps_is_fresh() -> None:
    with stream() as link:
        link.act([50, 50])
        # a hand takes a second, and the hub streams on
        link._transport.reset(np.random.default_rng(0))
        first = link.read()
        assert first.age_s < 0.03
        second = link.read()
        assert second.hub_time_ms - first.hub_time_ms < 60
        link.act([50, 50])


def test_long_step_keeps_motors_powered() -> None:
    slow = dataclasses.replace(SPINNING.interface, settle=Wait(1500))
    hub = VirtualHub(make_body(TWO_WHEELER, seed=1))
    with StreamingLink(hub, TWO_WHEELER, slow) as link:
        link.act([100, 100])
        servos = list(hub.machine.servos.values())
        assert all(servo.control.is_active for servo in servos), "the hub has let go of its motors"


def test_silence_stops_streaming_reading_restarts() -> None:
    with stream() as link:
        hub = link._transport
        link.act([100, 100])
        hub.run_on_until(hub.machine.time_ms + 450)
        assert not any(servo.control.is_active for servo in hub.machine.servos.values())
        hub.run_on_until(hub.machine.time_ms + 11_000)
        assert link.read().hub_time_ms < 1000
        link.act([100, 100])


def test_streaming_resumes_after_pause() -> None:
    with stream() as link:
        link.act([100, 100])
        link.rest()
        assert link.act([50, 50]).age_s < 0.05


def test_streaming_over_app_data() -> None:
    with stream(pipe=Pipe.APP_DATA) as link:
        readings = [link.act([50, 50]) for _ in range(10)]
        assert max(reading.age_s for reading in readings) < 0.05


def test_untimed_step_cannot_be_streamed() -> None:
    env = bricksrl.make("RunAway-v0", streaming=True)
    with pytest.raises(DescriptionError, match="cannot be streamed; omit streaming"):
        env.reset()


@pytest.mark.parametrize("app_data", [False, True])
def test_environment_with_streaming(app_data: bool) -> None:
    env = bricksrl.make(
        "Spinning-v0",
        seed=0,
        streaming=True,
        app_data=app_data,
        physics=Physics().with_link(STEADY),
    )
    assert isinstance(env, HubEnv)
    env.reset()
    started_s, ages = env.twin.now_s(), []
    angles = []
    for _ in range(10):
        state = env.step(TensorDict({"action": torch.ones(2)}))
        angles.append(state["next", "observation"][0].item())
        ages.append(env.timing.age_s)
    assert env.twin.now_s() - started_s == pytest.approx(10 * STEP_S, abs=0.005)
    turned = [(after - before) % 360 for before, after in itertools.pairwise(angles)]
    assert np.mean(turned) > 20
    assert all(0 < age < 0.05 for age in ages), "age of the observation that each action answered"
    assert len(set(ages)) > 1
    env.close()


def test_streaming_episode_is_reproducible() -> None:
    returns = []
    for _ in range(2):
        env = bricksrl.make("Spinning-v0", seed=3, streaming=True)
        torch.manual_seed(0)
        returns.append(env.rollout(20)["next", "observation"])
        env.close()
    assert torch.equal(*returns)


def test_streaming_returns_the_newest_of_several_observations() -> None:
    """A step of 60 ms ends at a connection event, which brings two observations."""
    env = bricksrl.make("LineFollow-v0", seed=0, physics=Physics().with_link(STEADY))
    env.rollout(10)
    assert env._connection.link.statistics.age_p50_s == pytest.approx(0.005, abs=0.001)
    env.close()
