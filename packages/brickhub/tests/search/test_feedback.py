"""Linear feedback: on a computer and on a hub."""

from __future__ import annotations

import math
from typing import Any

import pytest

from brickhub.entry import Entry
from brickhub.search.feedback import Feature, Feedback, feature_of


@pytest.mark.parametrize(
    ("entry", "observed", "read"),
    [
        (Entry("distance", 40.0, 2000.0), 40.0, -1.0),
        (Entry("distance", 40.0, 2000.0), 2000.0, 1.0),
        (Entry("tilt", -90.0, 30.0), -30.0, 0.0),
        (Entry("tilt", -90.0, 30.0), 0.0, 0.5),
        (Entry("any"), 17.0, 17.0),
        (Entry("any", low=0.0), 17.0, 17.0),
        (Entry("leg", 0.0, 360.0, wraps=True), 90.0, math.pi / 2),
    ],
)
def test_a_bounded_number_is_read_from_minus_1_to_1(
    entry: Entry, observed: float, read: float
) -> None:
    feature = feature_of(entry, 3)
    assert (feature.index, feature.is_angle) == (3, entry.wraps)
    assert observed * feature.factor + feature.offset == pytest.approx(read)


FEATURES = (Feature(2, 0.5, -1.0), Feature(0, math.pi / 180, is_angle=True), Feature(1))


def test_actions_are_the_matrix_times_the_features_and_the_hub_computes_the_same() -> None:
    feedback = Feedback(FEATURES, 2)
    assert feedback.features == FEATURES and feedback.size == 2
    # A row has a column for a number, two for an angle, and one for the offset.
    assert [entry.name for entry in feedback.numbers] == [
        f"weight_{row}_{column}" for row in range(2) for column in range(5)
    ]
    assert {(entry.low, entry.high) for entry in feedback.numbers} == {(-1.0, 1.0)}
    weights = (0.1, 0.2, 0.3, -0.4, 0.05, 0.0, 0.0, 0.0, 0.9, 0.5)
    on_hub: dict[str, Any] = {"umath": math}
    exec(feedback.hub_source().replace("import umath", ""), on_hub)  # noqa: S102  our own program
    for observed in ((30.0, -0.2, 1.0), (200.0, 0.3, 5.0), (0.0, 2.0, 0.0)):
        angle_deg, plain, scaled = observed
        first = 0.1 * (scaled / 2 - 1) - 0.4 * plain + 0.05
        first += 0.2 * math.sin(math.radians(angle_deg)) + 0.3 * math.cos(math.radians(angle_deg))
        # No action is beyond -1 or 1.
        wanted = [min(max(first, -1.0), 1.0), min(0.9 * plain + 0.5, 1.0)]
        assert feedback.act(observed, weights) == pytest.approx(wanted)
        assert on_hub["act_by"](observed, weights) == pytest.approx(wanted, abs=1e-5)
