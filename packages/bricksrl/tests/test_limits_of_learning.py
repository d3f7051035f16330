"""Limits of what can be asked of learning: what is just within is taken, what is just beyond is
refused with one line."""

from __future__ import annotations

import math
from collections.abc import Callable
from dataclasses import replace
from typing import Any

import numpy as np
import pytest
import torch
from limits import assert_kept

from brickhub.entry import Entry
from brickhub.errors import BricksError
from bricksrl.agents.image_networks import Convolutions, Keypoints
from bricksrl.agents.networks import make_body
from bricksrl.agents.offline.act import ACTSettings
from bricksrl.agents.sac import SACSettings
from bricksrl.agents.search.gait import GaitSettings
from bricksrl.agents.settings import MAX_UNITS, MAX_WEIGHTS, Settings
from bricksrl.agents.tqc import TQCSettings
from bricksrl.data.selection import Selection, _numbers_of
from bricksrl.envs.host_sensors.host_sensor import HostSensor
from bricksrl.envs.options import parse_option
from bricksrl.envs.simulation import batch_shape
from bricksrl.envs.specs import ImageShape
from bricksrl.envs.tasks.spinning import SPINNING
from bricksrl.envs.vision.camera import CameraView
from bricksrl.envs.vision.frames import RedWindow
from bricksrl.evaluation.multi_seed import MAX_SEEDS, check_count
from bricksrl.evaluation.statistics import wilson_interval
from bricksrl.teleoperation import KEY_PAIRS, KeyboardDriver

TINY = 1e-6


def body(**change: Any) -> torch.nn.Module:
    norm = change.pop("norm", "batch")
    return make_body(Settings(**change), 3, 2, norm=norm)


def sensor(**change: Any) -> HostSensor:
    fields = {"name": "scale", "entries": (Entry("weight", 0.0, 5.0),), "open": lambda: None}
    return HostSensor(**{**fields, **change})


def image(*shape: int) -> Any:
    class Spec:
        space = None

    spec = Spec()
    spec.shape = shape  # type: ignore[attr-defined]
    return ImageShape.of("pixels", spec)


def driver(count: int) -> KeyboardDriver:
    return KeyboardDriver([Entry(f"c{i}", -1.0, 1.0) for i in range(count)], source=object())


LIMITS: dict[str, tuple[Callable[[Any], Any], list[Any], list[Any]]] = {
    "layers": (
        lambda hidden: Settings(hidden=hidden),
        [(1,), (MAX_UNITS,), (2**13, 2**13)],
        [(), (0,), (MAX_UNITS + 1,), (2**13, 2**13 + 1), (1.5,)],
    ),
    "goals of a batch": (
        lambda shares: SACSettings(hindsight=shares[0], new_goals=shares[1]),
        [(0.5, 0.5), (1.0, 0.0), (0.0, 1.0)],
        [(0.5, 0.51), (1.0, TINY)],
    ),
    "least critics": (lambda n: SACSettings(num_qs=3, num_min_qs=n), [1, 3], [0, 4]),
    "dropped quantiles": (lambda n: TQCSettings(quantiles=5, dropped=n), [0, 4], [-1, 5]),
    "executed actions": (lambda n: ACTSettings(chunk=4, executed=n), [1, 4], [0, 5]),
    "steps to settle": (lambda n: GaitSettings(trial_steps=8, settle_steps=n), [0, 7], [8]),
    "batch of a normalised network": (lambda n: body(batch_size=n), [2], [1]),
    "batch of another": (lambda n: body(batch_size=n, norm="layer"), [1, 2], [0]),
    "image of keypoints": (Keypoints, [16, 17], [15]),
    "image of convolutions": (Convolutions, [36, 37], [35]),
    "image of a view": (lambda px: CameraView(image_px=px), [1, 480], [0, 481]),
    "spots of a view": (lambda px: CameraView(spot_px=px), [1], [0]),
    "hues of red": (
        lambda hues: RedWindow(hue_deg=hues),
        [(-60.0, 60.0), (0.0, 0.0)],
        [(-60.1, 0.0), (0.0, 60.1), (1.0, 0.0)],
    ),
    "saturation": (lambda s: RedWindow(saturation=s), [TINY, 1.0], [0.0, 1.01]),
    "brightness": (lambda v: RedWindow(value=v), [TINY, 1.0], [0.0, 1.01]),
    "area": (lambda px: RedWindow(area_px=px), [0], [-1]),
    "seeds": (check_count, [2, MAX_SEEDS], [1, MAX_SEEDS + 1]),
    "rate": (
        lambda counts: wilson_interval(*counts),
        [(0, 1), (1, 1)],
        [(0, 0), (-1, 1), (2, 1)],
    ),
    "copies": (batch_shape, [0, 1, [3], (), np.int64(2)], [-1, 1.5, [0], [1, 2]]),
    "steps of a task": (lambda n: replace(SPINNING, max_steps=n), [1], [0]),
    "id of a task": (
        lambda name: replace(SPINNING, id=name),
        ["My_Task-v0", "A-v12"],
        ["Mine", "My-Task-v0", "A-v", "A-v0 "],
    ),
    "rate of a sensor": (lambda hz: sensor(rate_hz=hz), [TINY], [0.0, -1.0, math.nan]),
    "patience of a sensor": (lambda s: sensor(patience_s=s), [TINY], [0.0]),
    "name of a sensor": (lambda name: sensor(name=name), ["scale_2"], ["", "a scale", "2"]),
    "image of a sensor": (lambda px: sensor(entries=(), image_px=px), [1], [0]),
    "image of a sensor with numbers": (lambda px: sensor(image_px=px), [0], [1]),
    "shape of an image": (
        lambda shape: image(*shape),
        [(8, 8, 3), (3, 8, 8), (8, 8, 1)],
        [(8, 9, 3), (3, 8, 9)],
    ),
    "commands of a keyboard": (driver, [1, len(KEY_PAIRS)], [len(KEY_PAIRS) + 1]),
    "numbers of episodes": (
        lambda text: list(_numbers_of(text, 10)),
        ["", "0", "9", "0-9", "3-3", " 1 - 2 , 5"],
        ["10", "8-10", "3-2", "x", "1-", "-1", "1,,2"],
    ),
    "condition": (lambda s: s.choose([]), [Selection(success=False)], [Selection()]),
    "option": (
        parse_option,
        ["a=", "a=1", "a=b=c"],
        ["a", "=1", "1=a", "a b=1", ""],
    ),
}


@pytest.mark.parametrize("name", LIMITS)
def test_what_is_within_is_taken_and_what_is_beyond_is_refused(name: str) -> None:
    assert_kept(LIMITS[name], BricksError)


def test_what_is_within_is_what_was_meant() -> None:
    assert MAX_UNITS**2 // 4 == MAX_WEIGHTS, "two layers of half of the units are the most"
    assert list(_numbers_of("0-2, 7,9-9", 10)) == [0, 1, 2, 7, 9]
    assert [batch_shape(size) for size in (0, 5, [3], ())] == [
        torch.Size(shape) for shape in ([], [5], [3], [])
    ]
    values = [parse_option(text) for text in ("a=1.5", "b=[1]", "c=true", "d=x y", "e=")]
    assert values == [("a", 1.5), ("b", [1]), ("c", True), ("d", "x y"), ("e", "")]
    first, last = image(3, 8, 8), image(8, 8, 3)
    assert (first.side_px, first.channels, first.is_channels_last) == (8, 3, False)
    assert (last.side_px, last.channels, last.is_channels_last) == (8, 3, True)


def test_a_sensor_s_entries_may_be_anything_and_have_an_age() -> None:
    bounded = Entry("force", 0.0, 1.0, "N", limits=(-5.0, 5.0))
    (weight, force) = sensor(entries=(Entry("weight", 0.0, 5.0), bounded)).observed_entries
    assert (weight.limits, force.limits) == ((-math.inf, math.inf), (-5.0, 5.0))
    *_, age = sensor(observes_age=True, patience_s=2.5).observed_entries
    assert (age.name, age.low, age.high, age.unit) == ("scale_age", 0.0, 2.5, "s")


def test_images_of_a_spec_have_its_black_and_white() -> None:
    from torchrl.data import Bounded, Unbounded

    as_bytes = ImageShape.of("p", Bounded(0, 255, (8, 8, 3), dtype=torch.uint8))
    assert (as_bytes.low, as_bytes.high) == (0.0, 255.0)
    free = ImageShape.of("p", Unbounded((8, 8, 3)))
    assert (free.low, free.high) == (0.0, 1.0)
    half = ImageShape.of("p", Bounded(-0.5, 0.5, (3, 8, 8)))
    assert (half.low, half.high) == (-0.5, 0.5)


def test_an_unbounded_number_has_no_range_and_stays_as_it_is() -> None:
    """TorchRL's own unbounded specs end at the largest float."""
    from torchrl.data import Unbounded

    from bricksrl.agents.features.observed import _unit_scaling
    from bricksrl.envs.specs import spec_entries

    entries = spec_entries(Unbounded((2,)), "embedding")
    assert [(entry.low, entry.high) for entry in entries] == [(-math.inf, math.inf)] * 2
    assert [entry.name for entry in spec_entries(Unbounded((1,)), ("a", "b"))] == ["a.b_0"]

    class Layout:
        low = (0.0, -math.inf, 3.0)
        high = (10.0, math.inf, 3.0)

    scale, offset = _unit_scaling(Layout())  # type: ignore[arg-type]
    assert scale.tolist() == pytest.approx([0.2, 1.0, 1.0])
    assert offset.tolist() == [-1.0, 0.0, 0.0]
