"""Facing of a plan that says no ports, as strangers draw: ours drive along their z axis, others
along any."""

from dataclasses import replace

import numpy as np

from brickhub.robot import Sense, SensorKind
from bricktwin.plans.geometry import Floats, Form
from bricktwin.plans.part import DeviceKind
from bricktwin.plans.plan import Placed, Plan

_AHEAD = np.array([0.0, 0.0, 1.0])
_SIDE = np.array([1.0, 0.0, 0.0])
_UP = np.array([0.0, -1.0, 0.0])
_ALIKE_COSINE = 0.8
"""Least cosine of two directions that count as one: 37 degrees apart."""


def turned_ahead(plan: Plan) -> Plan:
    """The plan, turned about the upright so that its robot drives or walks along z, and what it
    sees with lies ahead; unchanged if nothing shows where it is going."""
    axles = _axles(plan)
    if not axles:
        return plan
    # A robot goes across its axles: where most of them point ahead, it goes sideways.
    pointing_ahead = 0
    for axle in axles:
        along = abs(float(axle @ _AHEAD))
        pointing_ahead += along > _ALIKE_COSINE
    goes_sideways = pointing_ahead > len(axles) / 2
    ahead = _SIDE if goes_sideways else _AHEAD
    if _sight(plan, ahead) < _sight(plan, -ahead):
        ahead = -ahead
    if ahead is _AHEAD:
        return plan
    # The rows of a rotation are the directions that become x, y and z.
    turn = np.array([np.cross(-_UP, ahead), -_UP, ahead])
    parts = tuple(
        replace(
            placed,
            rotation=turn @ placed.rotation,
            position=turn @ placed.position,
        )
        for placed in plan.parts
    )
    return replace(plan, parts=parts)


def _axles(plan: Plan) -> list[Floats]:
    """Level axes of wheels; of a robot without them, those of motors' shafts."""
    axes: list[Floats] = []
    for placed in plan.parts:
        if placed.part.wheel_mm and not _is_caster(placed):
            # Wheels of the parts library turn about their z axis.
            axes.append(placed.rotation[:, 2])
    if not axes:
        axes = [_direction(placed) for placed in plan.devices(DeviceKind.MOTOR)]
    level: list[Floats] = []
    for axis in axes:
        upright = abs(float(axis @ _UP))
        if upright < _ALIKE_COSINE:
            level.append(axis)
    return level


def _direction(placed: Placed) -> Floats:
    """Where a motor's shaft points, or a sensor looks, in the plan's frame."""
    outwards = np.array(placed.electric.direction)
    return np.asarray(placed.rotation @ outwards)


def _is_caster(placed: Placed) -> bool:
    return any(solid.form is Form.BALL for solid in placed.part.solids)


def _sight(plan: Plan, ahead: Floats) -> float:
    """How much a robot sees ahead: a sensor that looks there counts one, a color sensor that
    looks down and is ahead of the middle a half."""
    positions = [placed.position for placed in plan.parts]
    middle = np.mean(positions, axis=0)
    sight = 0.0
    for placed in plan.devices(DeviceKind.SENSOR):
        senses = SensorKind(placed.electric.name).model.senses
        looks = _direction(placed)
        looks_ahead = looks @ ahead > _ALIKE_COSINE
        looks_down = looks @ _UP < -_ALIKE_COSINE
        offset = placed.position - middle
        is_in_front = offset @ ahead > 0
        if Sense.DISTANCE in senses and looks_ahead:
            sight += 1.0
        elif Sense.SURFACE in senses and looks_down and is_in_front:
            sight += 0.5
    return sight
