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
    # A robot goes across its axles.
    across = [abs(axle @ _AHEAD) > _ALIKE_COSINE for axle in axles]
    goes_sideways = sum(across) > len(axles) / 2
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
    wheels = [placed for placed in plan.parts if placed.part.wheel_mm and not _is_caster(placed)]
    # Wheels of the parts library turn about their z axis.
    axes = [placed.rotation[:, 2] for placed in wheels]
    if not axes:
        for placed in plan.devices(DeviceKind.MOTOR):
            axes.append(placed.rotation @ np.array(placed.electric.direction))
    return [axis for axis in axes if abs(axis @ _UP) < _ALIKE_COSINE]


def _is_caster(placed: Placed) -> bool:
    return any(solid.form is Form.BALL for solid in placed.part.solids)


def _sight(plan: Plan, ahead: Floats) -> float:
    """How much a robot sees ahead: a sensor that looks there counts one, a color sensor that
    looks down and is ahead of the middle a half."""
    middle = np.mean([placed.position for placed in plan.parts], axis=0)
    sight = 0.0
    for placed in plan.devices(DeviceKind.SENSOR):
        senses = SensorKind(placed.electric.name).model.senses
        looks = placed.rotation @ np.array(placed.electric.direction)
        if Sense.DISTANCE in senses and looks @ ahead > _ALIKE_COSINE:
            sight += 1.0
        elif Sense.SURFACE in senses and looks @ _UP < -_ALIKE_COSINE:
            is_ahead = (placed.position - middle) @ ahead > 0
            sight += 0.5 * is_ahead
    return sight
