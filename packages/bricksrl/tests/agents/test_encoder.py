"""Observation encoders."""

from __future__ import annotations

import math

import pytest
import torch
from hypothesis import given
from hypothesis import strategies as st
from small import ENV, LAYOUT, SIGHT, settings
from torchrl.data import Composite
from toys import Cart

from brickhub.entry import Entry
from bricksrl.agents.features.encoder import Encoder, encoder_keys, make_encoder
from bricksrl.agents.features.observed import PAST_SHARE, ObservationEncoder
from bricksrl.agents.image_networks import Convolutions, Keypoints, shift_images
from bricksrl.agents.networks import mlp
from bricksrl.envs.specs import ImageShape, NominalBounded, ObservationLayout
from bricksrl.envs.transforms import layout_of
from bricksrl.errors import DescriptionError

MIXED = ObservationLayout(
    (0.0, -90.0, 0.0, -math.inf), (360.0, 90.0, 2000.0, math.inf), (True, False, False, False)
)


def test_bounds_are_scaled_and_angles_split() -> None:
    encoder = ObservationEncoder(MIXED, "sincos")
    features = encoder(torch.tensor([90.0, -90.0, 2000.0, 7.0]))
    assert encoder.size == 5
    torch.testing.assert_close(
        features, torch.tensor([-1.0, 1.0, 7.0, 1.0, 0.0]), atol=1e-6, rtol=0
    )


def test_raw_angles_are_scaled_like_any_entry() -> None:
    encoder = ObservationEncoder(MIXED, "raw")
    features = encoder(torch.tensor([[90.0, 0.0, 1000.0, 7.0]]))
    assert encoder.size == 4
    torch.testing.assert_close(features, torch.tensor([[-0.5, 0.0, 0.0, 7.0]]))


@given(st.floats(0, 360), st.floats(-0.5, 0.5))
def test_sine_and_cosine_are_continuous_at_wrap(angle_deg: float, step_deg: float) -> None:
    encoder = ObservationEncoder(ObservationLayout((0.0,), (360.0,), (True,)), "sincos")
    there = (angle_deg + step_deg) % 360.0
    assert (encoder(torch.tensor([angle_deg])) - encoder(torch.tensor([there]))).norm() < 0.01


def test_phases_are_angle_differences_without_goals() -> None:
    layout = ObservationLayout((0.0,) * 3, (360.0,) * 3, (True,) * 3, goals=((2, 0),))
    encoder = ObservationEncoder(layout, "phases", "plain")
    features = encoder(torch.tensor([10.0, 280.0, 90.0]))
    assert encoder.size == 8
    # sine of 10 - 280, the only difference
    torch.testing.assert_close(features[3], torch.tensor(1.0), atol=1e-6, rtol=0)
    torch.testing.assert_close(features[7], torch.tensor(0.0), atol=1e-6, rtol=0)
    assert ObservationEncoder(layout, "sincos", "plain").size == 6


@given(st.floats(0, 360), st.floats(0, 360), st.floats(-50, 50), st.floats(-50, 50))
def test_goal_difference_takes_shorter_way(
    angle: float, goal: float, joint: float, joint_goal: float
) -> None:
    layout = ObservationLayout(
        (0.0, -50.0) * 2, (360.0, 50.0) * 2, (True, False) * 2, ((2, 0), (3, 1))
    )
    encoder = ObservationEncoder(layout, "raw", "difference")
    features = encoder(torch.tensor([[angle, joint, goal, joint_goal]]))
    assert encoder.size == features.shape[-1] == 6
    way = float(features[0, 4]) * 180.0
    assert abs(way) <= 180.001
    assert abs(((angle + way - goal) + 180.0) % 360.0 - 180.0) < 0.01
    assert float(features[0, 5]) * 50.0 == pytest.approx(joint_goal - joint, abs=0.01)


NAMES, FRAMES = ("angle", "tilt", "distance"), (2, 2, 2, 0, 0, 0)
STACKED = ObservationLayout(
    MIXED.low[:3] * 2,
    MIXED.high[:3] * 2,
    MIXED.wraps[:3] * 2,
    names=NAMES * 2,
    frames=(2,) * 3 + (0,) * 3,
)
"""An older frame of an angle, a tilt and a distance, then the newest one."""


def test_older_frames_are_differences_to_the_newest_which_is_as_if_alone() -> None:
    alone = ObservationLayout(MIXED.low[:3], MIXED.high[:3], MIXED.wraps[:3])
    before, now = torch.tensor([350.0, 9.0, 500.0]), torch.tensor([20.0, -9.0, 600.0])
    older, tilt, sine, cosine = ObservationEncoder(STACKED)(torch.cat((before, now))).split(
        (2, 2, 2, 2)
    )
    torch.testing.assert_close(older, PAST_SHARE * torch.tensor([0.2, -0.1]))
    torch.testing.assert_close(
        torch.cat((tilt, sine[1:], cosine[1:])), ObservationEncoder(alone)(now)
    )
    assert [math.degrees(math.atan2(sine[0], cosine[0]))] == pytest.approx([-30.0], abs=1e-3)
    still = ObservationEncoder(STACKED)(torch.cat((now, now)))
    # The sine of 0 is a difference of two products, each rounded to a float32 or not, as the
    # processor likes.
    assert still[:2].tolist() == pytest.approx([0.0, 0.0], abs=1e-6)
    assert still[[4, 6]].tolist() == pytest.approx([0.0, PAST_SHARE], abs=1e-6)


def test_a_hidden_speed_is_learned_from_stacked_frames() -> None:
    torch.manual_seed(0)
    encoder = ObservationEncoder(STACKED)
    network = mlp(encoder.size, 1, (32,))
    adam = torch.optim.Adam(network.parameters(), 1e-2)
    for _ in range(200):
        frame, speed = (
            torch.rand(256, 3) * torch.tensor([360.0, 90.0, 2000.0]),
            50.0 * torch.randn(256, 3),
        )
        target = speed[:, [2]] / 50.0  # mm in a step; one frame does not tell
        loss = (network(encoder(torch.cat((frame - speed, frame), -1))) - target).square().mean()
        adam.zero_grad()
        loss.backward()
        adam.step()
    assert loss < 0.05


@pytest.mark.parametrize("angles", ["phases", "sincos", "raw"])
@pytest.mark.parametrize("goals", ["difference", "plain"])
def test_batch_dimensions_do_not_change_features(angles: str, goals: str) -> None:
    encoder = ObservationEncoder(LAYOUT, angles, goals)  # type: ignore[arg-type]
    observations = torch.rand(2, 3, 8) * 300.0
    features = encoder(observations)
    assert features.shape == (2, 3, encoder.size)
    torch.testing.assert_close(features[1, 2], encoder(observations[1, 2]))
    assert features.abs().max() < 20.0
    assert not list(encoder.parameters())


def test_layouts_come_from_the_entries_or_from_the_bounds_of_the_spec() -> None:
    cart = layout_of(Cart())
    assert (cart.low, cart.high, cart.wraps, cart.vectors) == (
        (0.0, -1.0),
        (1000.0, 1.0),
        (False, False),
        (("observation", (2,)),),
    )
    seen = layout_of(SIGHT)
    assert (seen.low, seen.keys) == ((-1.0,) * 2, ["observation", "image"])
    assert seen.images == (ImageShape("image", 32, 3, True, 0.0, 255.0),)
    assert LAYOUT.goals == ((4, 0), (5, 1), (6, 2), (7, 3))
    own = Cart()
    entries = (Entry("turn_angle", 0.0, 360.0, wraps=True), Entry("speed"))
    own.observation_spec = Composite(observation=NominalBounded.of(entries))
    # an environment of one's own says what its numbers are
    assert layout_of(own).wraps == (True, False)


def test_images_and_observations_are_joined() -> None:
    keypoints = make_encoder(SIGHT, settings("sac", images=True))
    assert isinstance(keypoints, Encoder)
    assert encoder_keys(keypoints) == ["observation", "image"]
    assert encoder_keys(make_encoder(ENV, settings("sac"))) == ["observation"]
    images = torch.stack([SIGHT.shown(column)["image"] for column in (3, 9, 20, 4, 5, 6)]).view(
        2, 3, 32, 32, 3
    )
    features = keypoints(torch.zeros(2, 3, 2), images)
    assert features.shape == (2, 3, keypoints.size) == (2, 3, 32 + 2)
    torch.testing.assert_close(features[0, 2], keypoints(torch.zeros(2), images[0, 2]))


def test_paper_network_sizes() -> None:
    image, vectors = ImageShape("image", 64, 3, True), (("observation", (3,)),)
    layout = ObservationLayout((0.0,) * 3, (1.0,) * 3, (False,) * 3, (), (image,), vectors)
    made = Encoder(layout, settings("sac", encoder="convolutions"))
    shapes = [
        tuple(weight.shape) for name, weight in made.named_parameters() if name.endswith("weight")
    ]
    assert shapes == [
        (32, 3, 8, 8),
        (64, 32, 4, 4),
        (64, 64, 3, 3),
        (256, 1024),
        (128, 256),
        (128, 3),
        (32, 128),
    ]
    assert made.size == 160


def test_keypoint_follows_spot() -> None:
    network = Keypoints(32)
    images = torch.stack([SIGHT.shown(column)["image"] for column in (2, 12, 22)])
    with torch.no_grad():
        moved = network(images.permute(0, 3, 1, 2) / 255 - 0.5).view(3, -1, 2)
    assert ((moved[1:, :, 1] - moved[:-1, :, 1]) > 0.2).all(0).any()
    assert moved.abs().max() <= 1.0


@pytest.mark.parametrize(("network", "side_px"), [(Keypoints, 12), (Convolutions, 32)])
def test_too_small_images_raise(network: type, side_px: int) -> None:
    with pytest.raises(DescriptionError, match=f"images of {side_px} px are too small"):
        network(side_px)


@pytest.mark.parametrize(
    ("network", "side_px"),
    [(Keypoints, 16), (Keypoints, 45), (Convolutions, 36), (Convolutions, 84)],
)
def test_other_image_sizes_work(network: type, side_px: int) -> None:
    made = network(side_px)
    assert made(torch.zeros(2, 3, side_px, side_px)).shape == (2, made.size)


def test_shifted_images_repeat_edges() -> None:
    image = torch.arange(64 * 64).view(64, 64, 1).expand(64, 64, 3) % 251
    images = image.to(torch.uint8).expand(40, 64, 64, 3)
    moved = shift_images(images, 4)
    assert moved.dtype == torch.uint8
    channels_first = images.permute(0, 3, 1, 2).float()
    padded = (
        torch.nn.functional.pad(channels_first, (4, 4, 4, 4), mode="replicate")
        .permute(0, 2, 3, 1)
        .byte()
    )
    cuts = {(y, x): padded[0, y : y + 64, x : x + 64] for y in range(9) for x in range(9)}
    found = {next(place for place, cut in cuts.items() if torch.equal(cut, one)) for one in moved}
    assert len(found) > 20
    assert torch.equal(shift_images(images, 0), images)
