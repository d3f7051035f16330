"""Forward kinematics of an articulation: chains, gears, rods and closed loops. Metres, the twin's axes.

A motion maps points of the plan's position to the current one. Loops are closed by Gauss-Newton on the angles without motors.
"""

from __future__ import annotations

import math
from collections.abc import Mapping
from dataclasses import dataclass, replace

import numpy as np

from bricktwin.plans.geometry import Floats, rotation
from bricktwin.plans.mechanism.articulation import Articulation, Joint

_MAX_STEPS, _TOLERANCE_M, _ANGLE_STEP = 30, 1e-7, 1e-6
_REGULARIZATION_M = 0.01
"""Regularization towards the previous angles, for angles that no loop determines."""


@dataclass(frozen=True, eq=False)
class Motion:
    """A rigid motion: ``turn`` [3, 3] and ``shift`` [3]."""

    turn: Floats
    shift: Floats

    def of(self, points: Floats) -> Floats:
        """Moved points [..., 3]."""
        return np.asarray(points @ self.turn.T + self.shift)

    def after(self, other: Motion) -> Motion:
        """The composition: ``other`` first, then this."""
        return Motion(self.turn @ other.turn, self.turn @ other.shift + self.shift)


STILL = Motion(np.eye(3), np.zeros(3))


def turning(axis: Floats, point: Floats, angle: float) -> Motion:
    """A rotation about a unit axis through a point; radians."""
    turn = rotation(axis, angle)
    return Motion(turn, point - turn @ point)


class Poser:
    """Poses of the bodies of an articulation. ``free``: indices of the swings outside of loops; a ball joint is three swings."""

    def __init__(self, articulation: Articulation) -> None:
        self._articulation = articulation
        # The three hinges of a ball joint, which moves by less than the quarter turn at which two of them align.
        hinges = [
            [replace(swing, axis=axis) for axis in np.eye(3)] if swing.is_ball else [swing] for swing in articulation.swings
        ]
        self._swings = [hinge for swing in hinges for hinge in swing]
        self._angles = np.zeros(len(self._swings))
        slopes = np.zeros(0)
        if (articulation.rods or articulation.loops) and len(self._angles):
            slopes = np.abs(self._jacobian({}, self._angles)).max(axis=0)
        self._constrained = np.flatnonzero(slopes > 1e-5).tolist()
        """The swings that affect rods and loops."""
        self.free = tuple(number for number in range(len(self._swings)) if number not in self._constrained)

    def motions(self, shafts: Mapping[str, float], swings: Mapping[int, float] | None = None) -> tuple[Motion, ...]:
        """The motion of each body.

        Args:
            shafts: angle of each motor's shaft from the plan's position by port, clockwise, rad.
            swings: angles of free swings by index, rad.
        """
        for number, angle in (swings or {}).items():
            if number not in self._constrained:
                self._angles[number] = angle
        if self._constrained:
            self._close(shafts)
        return self._forward(shafts, self._angles)

    def of_parts(self, shafts: Mapping[str, float], motions: tuple[Motion, ...]) -> dict[int, Motion]:
        """The motion of each part by index, from the motions of the bodies."""
        articulation, result = self._articulation, dict[int, Motion]()
        for number, body in enumerate(articulation.bodies):
            result |= dict.fromkeys(body.parts, motions[number])
        gears = {drive.port: drive.gear for drive in articulation.drives}
        for follower in articulation.followers:
            angle = follower.ratio * shafts.get(follower.port, 0.0) / gears[follower.port]
            spin = turning(-follower.axis, follower.point_m, angle)
            result |= dict.fromkeys(follower.parts, motions[follower.body].after(spin))
        for rod in articulation.rods:
            near, far = motions[rod.near].of(rod.near_m), motions[rod.far].of(rod.far_m)
            result |= dict.fromkeys(rod.parts, _rod_motion(rod.near_m, rod.far_m, near, far))
        return result

    def _forward(self, shafts: Mapping[str, float], angles: Floats) -> tuple[Motion, ...]:
        articulation = self._articulation
        joints: list[tuple[Joint, float]] = list(zip(self._swings, (float(angle) for angle in angles), strict=True))
        drives = {drive.port: shafts.get(drive.port, 0.0) / drive.gear for drive in articulation.drives}
        joints += [(drive.joint, drives[drive.port]) for drive in articulation.drives]
        joints += [(geared.joint, geared.ratio * drives[geared.port]) for geared in articulation.geared]
        motions = {0: STILL}
        for joint, angle in sorted(joints, key=lambda item: item[0].child):
            parent = motions.get(joint.child, motions[joint.parent])
            motions[joint.child] = parent.after(turning(joint.axis, joint.point_m, angle))
        return tuple(motions[number] for number in range(len(articulation.bodies)))

    def _residuals(self, shafts: Mapping[str, float], angles: Floats) -> Floats:
        """Residuals of rods and loops [n], m."""
        motions, gaps = self._forward(shafts, angles), []
        for rod in self._articulation.rods:
            length = np.linalg.norm(rod.far_m - rod.near_m)
            distance = motions[rod.far].of(rod.far_m) - motions[rod.near].of(rod.near_m)
            gaps.append(float(np.linalg.norm(distance) - length))
        for loop in self._articulation.loops:
            gaps += (motions[loop.parent].of(loop.point_m) - motions[loop.child].of(loop.point_m)).tolist()
        return np.array(gaps)

    def _jacobian(self, shafts: Mapping[str, float], angles: Floats) -> Floats:
        """Jacobian of the residuals [gaps, angles], by finite differences."""
        steps = [np.eye(len(angles))[number] * _ANGLE_STEP for number in range(len(angles))]
        changes = [self._residuals(shafts, angles + step) - self._residuals(shafts, angles - step) for step in steps]
        return np.stack([change / (2 * _ANGLE_STEP) for change in changes], axis=1)

    def _close(self, shafts: Mapping[str, float]) -> None:
        """Turn the swings until rods and loops are closed, as far as possible."""
        constrained, start = self._constrained, self._angles.copy()
        for _ in range(_MAX_STEPS):
            gaps = self._residuals(shafts, self._angles)
            if np.abs(gaps).max() < _TOLERANCE_M:
                return
            slopes = self._jacobian(shafts, self._angles)[:, constrained]
            weight = (_REGULARIZATION_M * 1e-3) ** 2
            matrix = slopes.T @ slopes + weight * np.eye(len(constrained))
            change = np.linalg.solve(matrix, slopes.T @ gaps)
            self._angles[constrained] -= np.clip(change, -0.3, 0.3)
        if np.abs(self._residuals(shafts, self._angles)).max() > 1e-3:
            self._angles = start


def _rod_motion(old_near: Floats, old_far: Floats, near: Floats, far: Floats) -> Motion:
    """The motion of a rod between two positions of its pins, by the shortest rotation."""
    before, now = old_far - old_near, far - near
    before, now = before / np.linalg.norm(before), now / np.linalg.norm(now)
    cross = np.cross(before, now)
    sine = float(np.linalg.norm(cross))
    if sine < 1e-9:
        return Motion(np.eye(3), near - old_near)
    turn = turning(cross / sine, np.zeros(3), math.atan2(sine, float(before @ now))).turn
    return Motion(turn, near - turn @ old_near)
