"""System identification with hidden parameters."""

from __future__ import annotations

import dataclasses
from typing import Any

import numpy as np
import pytest
from described import RUN_AWAY

from brickhub.errors import TwinError
from brickhub.hub.interface import Interface
from brickhub.hub.link.lockstep import HubLink
from brickhub.hub.link.profiles import IDEAL
from brickhub.robot import HubKind, Motor, Robot
from brickhub.target import whole_interface
from brickhub.virtual.virtual_transport import VirtualHub
from bricktwin.robots import TWO_WHEELER
from bricktwin.twin import system_id
from bricktwin.twin.make_body import make_body
from bricktwin.twin.motion_log import RunLog, identification_commands, record
from bricktwin.twin.physics import PARAMETERS, Physics
from bricktwin.twin.scene import Scene
from bricktwin.twin.system_id import FITTED, _noise, fit, replay

HIDDEN = Physics(
    battery_v=7.3,
    friction_scale=0.8,
    motor_friction_scale=1.4,
    mass_scale=1.1,
    backlash_deg=1.2,
    gyro_noise_deg_s=0.8,
)
WHEEL = Robot("wheel", HubKind.CITY, motors=(Motor("wheel", "A"),))
# Recovered parameters are within this share of the range that randomisation draws from.
TOLERANCE = 0.25


def recorded(
    physics: Physics, steps: int, robot: Robot = TWO_WHEELER, interface: Interface | None = None
) -> RunLog:
    interface = interface or whole_interface(robot)
    commands = identification_commands(interface, steps, np.random.default_rng(0))
    with HubLink(VirtualHub(make_body(robot, physics=physics, seed=3)), robot, interface) as link:
        return record(link, robot, interface, commands)


@pytest.fixture(scope="module")
def log() -> RunLog:
    return recorded(HIDDEN, 160)  # as many steps as `bricktwin twin record` makes


def test_true_parameters_reproduce_motion(log: RunLog) -> None:
    """Replayed commands have recorded times: the noiseless angles match exactly."""

    def off_deg(physics: Physics) -> np.ndarray:
        return (replay(log, physics)[:, :2] - log.channels[:, :2] + 180.0) % 360.0 - 180.0

    assert not off_deg(HIDDEN).any()
    assert np.sqrt((off_deg(Physics()) ** 2).mean()) > 2.0


def test_drive_base_moves_are_replayed() -> None:
    physics = Physics(distance_noise_mm=0, distance_noise_ratio=0)
    scene = Scene(wall_distance_mm=(200.0, 300.0), heading_deg=(-5.0, 5.0))
    with HubLink(
        VirtualHub(make_body(TWO_WHEELER, scene=scene, physics=physics)), TWO_WHEELER, RUN_AWAY
    ) as link:
        log = record(link, TWO_WHEELER, RUN_AWAY, [[-80.0], [50.0], [-100.0]])
    assert np.abs(replay(log, physics)[:, 4] - log.channels[:, 4]).max() < 15.0


def test_a_worn_motor_on_the_bench_is_found() -> None:
    """Also beyond what randomization draws; what does not matter on a bench keeps its default."""
    hidden = Physics(motor_friction_scale=1.8)
    interface = whole_interface(WHEEL)
    with HubLink(VirtualHub(make_body(WHEEL, physics=hidden)), WHEEL, interface) as link:
        log = record(link, WHEEL, interface, [[180.0], [-180.0], [180.0], [180.0]])
    told: list[tuple[int, float]] = []
    found = fit(
        log,
        robot=WHEEL,
        names=("motor_friction_scale", "friction_scale"),
        on_replay=lambda *one: told.append(one),
    )
    assert set(found.identified) == {"motor_friction_scale"}
    assert found.unidentified == ("friction_scale",)
    assert found.physics.motor_friction_scale == pytest.approx(1.8, abs=0.05)
    assert found.physics == Physics(motor_friction_scale=found.physics.motor_friction_scale)
    assert found.error_before["wheel_angle"] > 1.0 > found.error_after["wheel_angle"]
    numbers, errors = zip(*told, strict=True)
    assert numbers == tuple(range(1, found.replays + 1))
    assert list(errors) == sorted(errors, reverse=True), "the smallest so far"
    assert errors[-1] < 0.1 < errors[0] < 100.0


@pytest.mark.slow
def test_hidden_parameters_are_found(log: RunLog) -> None:
    found = fit(log)
    for name in ("left_angle", "right_angle", "yaw_rate"):
        assert found.error_after[name] < found.error_before[name] / 2, name
    assert set(found.identified) | set(found.unidentified) == set(FITTED)
    assert {"battery_v", "motor_friction_scale", "mass_scale", "backlash_deg"} <= set(
        found.identified
    )
    for name in found.identified:
        off = abs(getattr(found.physics, name) - getattr(HIDDEN, name))
        assert off < TOLERANCE * np.ptp(PARAMETERS[name].random_range), name
    for name in found.unidentified:
        assert getattr(found.physics, name) == getattr(Physics(), name)


def test_noise_is_estimated_at_rest() -> None:
    noisy = Physics(gyro_noise_deg_s=2.0, tilt_noise_deg=1.0)
    commands = np.zeros((150, 2))
    interface = whole_interface(TWO_WHEELER)
    with HubLink(
        VirtualHub(make_body(TWO_WHEELER, physics=noisy, seed=1)), TWO_WHEELER, interface
    ) as link:
        found = fit(record(link, TWO_WHEELER, interface, commands), names=("battery_v",))
    assert found.physics.gyro_noise_deg_s == pytest.approx(2.0, rel=0.2)
    assert found.physics.tilt_noise_deg == pytest.approx(1.0, rel=0.2)
    assert found.identified == {}, "a robot at rest does not tell its battery"
    assert found.physics.battery_v == Physics().battery_v


def _at_rest(distances_mm: list[float]) -> RunLog:
    """A log of a robot that rests, with these readings of its distance."""
    interface = whole_interface(TWO_WHEELER)
    channels = np.zeros((len(distances_mm), len(interface.channels)))
    channels[:, interface.distance_index] = distances_mm
    steps = len(distances_mm) - 1
    return RunLog(
        "two-wheeler",
        interface,
        0,
        np.zeros((steps, 2)),
        np.zeros(steps),
        50 * np.arange(steps + 1),
        channels,
    )


def test_noise_of_distances_is_what_their_share_leaves() -> None:
    """Readings at 500 mm vary by 4.1 mm, of which 0.4 % of the distance are 2 mm."""
    found = _noise(_at_rest([496.0, 504.0] * 10))
    assert found["distance_noise_mm"] == pytest.approx(4.0 * np.sqrt(20 / 19) - 2.0)
    assert found["gyro_noise_deg_s"] == 0.0, "all its readings were alike"
    # At its largest reading the sensor has no noise to show, and four readings are too few.
    assert "distance_noise_mm" not in _noise(_at_rest([2000.0] * 20))
    assert _noise(_at_rest([496.0, 504.0] * 2)) == {}
    # No noise may be larger than that of any twin.
    assert _noise(_at_rest([200.0, 800.0] * 10))["distance_noise_mm"] == 50.0


def test_unidentifiable_parameters_are_reported(log: RunLog) -> None:
    with pytest.raises(TwinError, match="motion does not tell nothing; choose from battery_v"):
        fit(log, names=())
    with pytest.raises(TwinError, match="does not tell encoder_resolution_deg"):
        fit(log, names=("encoder_resolution_deg",))
    short = dataclasses.replace(log, commands=log.commands[:5], gaps_ms=log.gaps_ms[:5])
    with pytest.raises(TwinError, match="5 steps"):
        fit(short)


FREE = {"battery_v": 7.5, "motor_friction_scale": 1.2, "mass_scale": 0.95, "backlash_deg": 1.0}


def by_formula(monkeypatch: pytest.MonkeyPatch) -> RunLog:
    """The log of a robot whose channels depend on its physics linearly, so that replaying costs
    nothing; friction shows in none."""
    interface = whole_interface(TWO_WHEELER)
    rows, columns = 40, len(interface.channels)
    # Each parameter shows in steps of its own: by 30 units of a channel over all of its range.
    slopes = np.zeros((len(FREE), rows, columns))
    for number, name in enumerate(FREE):
        slopes[number, number + 1 :: len(FREE)] = 30.0 / np.ptp(PARAMETERS[name].random_range)

    def made(_log: Any, physics: Physics, *_robot_and_scene: Any) -> np.ndarray:
        changes = [getattr(physics, name) - value for name, value in FREE.items()]
        channels = 300.0 + np.tensordot(changes, slopes, 1)
        wraps = [channel.wraps for channel in interface.channels]
        return np.where(wraps, channels % 360.0, channels)

    monkeypatch.setattr(system_id, "replay", made)
    channels = made(None, Physics(**FREE))
    commands = np.ones((rows - 1, 2))
    times_ms = 50 * np.arange(rows)
    return RunLog("two-wheeler", interface, 0, commands, np.zeros(rows - 1), times_ms, channels)


def test_what_shows_in_a_log_is_fitted_and_what_does_not_keeps_its_default(
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    log = by_formula(monkeypatch)
    found = fit(log)
    for name, value in FREE.items():
        assert getattr(found.physics, name) == pytest.approx(
            value, abs=0.03 * np.ptp(PARAMETERS[name].random_range)
        )
    assert found.unidentified == ("friction_scale",) and found.physics.friction_scale == 1.0
    assert set(found.identified) == set(FREE)
    # Off by a quarter of its range, each makes the error many times larger.
    assert min(found.identified.values()) > 1.0
    for channel in log.interface.channels:
        assert found.error_after[channel.name] < 0.2 * found.error_before[channel.name]
    # As many replays as the log takes two minutes for.
    assert 200 < found.replays < 400
    assert fit(log) == found, "the same points each time"
    assert fit(log, seed=1) != found


def test_errors_are_root_mean_squares_of_the_shorter_way_round(
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    log = by_formula(monkeypatch)
    search = system_id._Search(log, None, None, {}, None)
    assert set(search.errors(Physics(**FREE)).values()) == {0.0}
    assert search.error(Physics(**FREE)) == 0.0
    off = dataclasses.replace(Physics(**FREE), battery_v=FREE["battery_v"] + 0.1)
    differences = system_id.replay(log, off)[1:] - log.channels[1:]
    differences = (differences + 180.0) % 360.0 - 180.0
    wanted = np.sqrt((differences**2).mean(axis=0))
    assert list(search.errors(off).values()) == pytest.approx(wanted.tolist())
    # Small differences count as squares of their roughness, large ones in proportion.
    scaled = differences / [channel.roughness for channel in log.interface.channels]
    losses = 2 * 9.0 * (np.sqrt(1 + scaled**2 / 9.0) - 1)
    assert search.error(off) == pytest.approx(np.sqrt(losses.mean()))
    assert search.replays == 4
    # An angle that is off by whole turns, or by as much from the start on, is no error.
    turned = dataclasses.replace(log, channels=log.channels.copy())
    wraps = [channel.wraps for channel in log.interface.channels]
    assert any(wraps)
    turned.channels[:, wraps] += 375.0
    turned.channels[9:, wraps] -= 720.0
    search = system_id._Search(turned, None, None, {}, None)
    assert max(search.errors(Physics(**FREE)).values()) == pytest.approx(0.0, abs=1e-9)


@pytest.mark.parametrize("name", FITTED)
def test_a_search_goes_half_a_range_beyond_what_is_drawn_but_not_beyond_what_can_be(
    name: str,
) -> None:
    low, high = PARAMETERS[name].random_range
    lowest, highest = PARAMETERS[name].allowed_range
    lower, upper = system_id._bounds(name)
    middle = (low + high) / 2
    assert lower == pytest.approx(max(middle - (high - low), lowest))
    assert upper == pytest.approx(min(middle + (high - low), highest))


def test_a_parameter_at_its_end_is_put_off_to_the_other_side_alone(
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    log = by_formula(monkeypatch)
    search = system_id._Search(log, None, None, {}, None)
    best = dataclasses.replace(Physics(**FREE), backlash_deg=0.0)
    lowest = search.error(best)
    (rise,) = search.rises(best, ("backlash_deg",)).values()
    # A quarter of 4 degrees.
    above = search.error(dataclasses.replace(best, backlash_deg=1.0))
    assert rise == pytest.approx(above / lowest - 1.0)
    middle = dataclasses.replace(best, backlash_deg=3.0)
    beside = [search.error(dataclasses.replace(best, backlash_deg=deg)) for deg in (2.0, 4.0)]
    (rise,) = search.rises(middle, ("backlash_deg",)).values()
    assert rise == pytest.approx(sum(beside) / 2 / search.error(middle) - 1.0)


@pytest.mark.parametrize(
    ("distance_mm", "has_wall"), [(40.0, False), (41.0, True), (1999.0, True), (2000.0, False)]
)
def test_a_wall_is_where_the_log_begins(distance_mm: float, has_wall: bool) -> None:
    scene = system_id._scene(_at_rest([distance_mm] * 9))
    wanted = Scene(wall_distance_mm=(distance_mm, distance_mm)) if has_wall else None
    assert scene == wanted


def test_a_command_starts_before_its_answer_or_after_the_time_of_the_host() -> None:
    log = _at_rest([500.0] * 4)
    log = dataclasses.replace(log, times_ms=np.array([7, 107, 230, 300]))
    step_ms = log.interface.settle.fixed_ms
    assert step_ms is not None
    starts = system_id._starts_ms(log, Physics())
    assert starts.tolist() == [107 - step_ms, 230 - step_ms, 300 - step_ms]
    moves = dataclasses.replace(log, interface=RUN_AWAY, gaps_ms=np.array([0.4, 10.0, 20.6]))
    starts = system_id._starts_ms(moves, Physics().with_link(IDEAL))
    assert starts.tolist() == [7, 117, 251]
    slow = dataclasses.replace(Physics(), link_interval_ms=30.0)
    assert system_id._starts_ms(moves, slow).tolist() == [37, 147, 281]
