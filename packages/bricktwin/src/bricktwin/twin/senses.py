"""Stimuli of a robot's sensors in a scene: colour, ambient light and distance, computed from the world around a sensor.

Estimates, where LEGO gives no data: the spot that a colour sensor sees widens with its distance, and beyond 20 mm less of its
light is reflected (LEGO's technical sheet gives 16 mm as the best distance).
"""

from __future__ import annotations

import colorsys
import math

import mujoco
import numpy as np

from bricktwin.plans.geometry import Floats
from bricktwin.twin.models.mjcf import OBSTACLE_GROUP
from bricktwin.twin.objects import COLORS, Field, Lamp, Line, Solid
from bricktwin.twin.scene import FLOOR, Scene

_SPOT_MM, _SPOT_RATIO = 1.0, 0.3
"""Radius of the spot that a colour sensor sees: at zero distance, and its increase per millimetre."""
_POINTS = 19
_FULL_LIGHT_MM = 20.0
_LAMP_MM = 300.0
_MAX_DISTANCE_M = 3.0
_WALL_COLOR = (0.78, 0.16, 0.12)


class WorldSenses:
    """Stimuli in the world, from the position and direction of a sensor.

    Args:
        model, data: MuJoCo's model and data of the robot in its scene.
        scene: scene with the objects.
    """

    def __init__(self, model: mujoco.MjModel, data: mujoco.MjData, scene: Scene) -> None:
        self._model, self._data, self._scene = model, data, scene
        self._marks = [item for item in reversed(scene.objects) if isinstance(item, (Line, Field))]
        self._lamps = [item for item in scene.objects if isinstance(item, Lamp)]
        solids = [item for item in scene.objects if isinstance(item, Solid)]
        self._colors = {int(model.geom(f"object_{number}").id): COLORS[solid.color] for number, solid in enumerate(solids)}
        self._obstacles = np.zeros(6, np.uint8)
        self._obstacles[OBSTACLE_GROUP] = 1
        # Sunflower pattern: points that fill a disc evenly (Vogel 1979).
        number = np.arange(_POINTS) + 0.5
        angle, radius = number * math.pi * (3.0 - math.sqrt(5.0)), np.sqrt(number / _POINTS)
        self._disc = np.stack([radius * np.cos(angle), radius * np.sin(angle)], -1)

    def surface(self, eye_m: Floats, gaze: Floats) -> tuple[float, float, float]:
        """Colour (hue in deg, saturation and value in %) that a sensor at ``eye_m`` sees along ``gaze`` in its light."""
        distance_m, geom = self._ray(eye_m, gaze)
        floor_m = -eye_m[2] / gaze[2] if gaze[2] < -1e-6 else math.inf
        if floor_m < distance_m:
            rgb, distance_m = self._floor(eye_m + floor_m * gaze, floor_m), floor_m
        elif geom >= 0:
            rgb = np.array(self._colors.get(geom, _WALL_COLOR))
        else:
            return 0.0, 0.0, 0.0
        brightness = min(1.0, (_FULL_LIGHT_MM / max(distance_m * 1000.0, 1e-6)) ** 2)
        hue, saturation, value = colorsys.rgb_to_hsv(*np.clip(rgb * brightness, 0.0, 1.0).tolist())
        return hue * 360.0, saturation * 100.0, value * 100.0

    def ambient(self, eye_m: Floats, gaze: Floats) -> float:
        """Ambient light at a sensor, %: that of the room, and that of each visible lamp."""
        light_pct = self._scene.light_pct
        for lamp in self._lamps:
            offset_m = np.array(lamp.at_mm) / 1000.0 - eye_m
            distance_m = float(np.linalg.norm(offset_m))
            cosine = float(offset_m @ gaze) / max(distance_m, 1e-9)
            if cosine > 0.0 and self._ray(eye_m, offset_m / distance_m)[0] >= distance_m:
                light_pct += lamp.light_pct * cosine * (_LAMP_MM / max(distance_m * 1000.0, _LAMP_MM / 10)) ** 2
        return min(light_pct, 100.0)

    def distance_mm(self, eye_m: Floats, gaze: Floats) -> float:
        """Distance to the nearest surface along ``gaze``, including the floor; infinite if there is none."""
        distance_m, _ = self._ray(eye_m, gaze)
        floor_m = -eye_m[2] / gaze[2] if gaze[2] < -1e-6 else math.inf
        nearest_m = min(distance_m, floor_m)
        return nearest_m * 1000.0 if nearest_m < _MAX_DISTANCE_M else math.inf

    def _ray(self, eye_m: Floats, gaze: Floats) -> tuple[float, int]:
        """Distance (m) and geometry of the first obstacle along a ray; infinite and -1 if there is none."""
        geom = np.full(1, -1, np.int32)
        distance_m = mujoco.mj_ray(self._model, self._data, eye_m, gaze, self._obstacles, True, -1, geom)
        return (math.inf, -1) if distance_m < 0 else (float(distance_m), int(geom[0]))

    def _floor(self, point_m: Floats, distance_m: float) -> Floats:
        """Mean colour of the spot on the floor at ``point_m`` that is seen from a distance."""
        radius_mm = _SPOT_MM + _SPOT_RATIO * distance_m * 1000.0
        points_mm = point_m[:2] * 1000.0 + radius_mm * self._disc
        rgb, open_points = np.tile(np.array(FLOOR), (_POINTS, 1)), np.ones(_POINTS, bool)
        for mark in self._marks:  # the uppermost first
            covered = open_points & mark.covers(points_mm)
            rgb[covered] = COLORS[mark.color]
            open_points &= ~covered
            if not open_points.any():
                break
        mean: Floats = rgb.mean(0)
        return mean


def percent(distance_mm: float, max_mm: float) -> float:
    """Distance as a percentage of the largest one that is detected, at most 100."""
    return 100.0 * min(distance_mm / max_mm, 1.0)
