"""Configuration of an environment, as LeRobot's command line has it."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any

from lerobot.configs.types import FeatureType, PolicyFeature
from lerobot.envs.configs import EnvConfig
from lerobot.utils.constants import ACTION, OBS_IMAGES, OBS_STATE

from bricksrl.envs import get_task

GYM_ID = "lerobot_env_bricksrl/BricksEnv-v0"


@EnvConfig.register_subclass("bricksrl")
@dataclass(kw_only=True)
class BricksEnvConfig(EnvConfig):
    """An environment of BricksRL. ``fps`` and the features are those of its task.

    Attributes:
        task: id of the environment, or a task of your own: ``my_task.py:TASK``.
        hub: "virtual", "ble", "ble:NAME", "usb".
        render_mode: "rgb_array", so that LeRobot films a virtual robot; ``None`` without OpenGL,
            for a real robot or a kinematic simulation.
    """

    task: str = "RoboArm_mixed-v0"
    hub: str = "virtual"
    render_mode: str | None = "rgb_array"

    def __post_init__(self) -> None:
        task = get_task(self.task)
        self.fps = max(1, round(task.rate_hz))
        self.features = {
            ACTION: PolicyFeature(FeatureType.ACTION, (len(task.interface.commands),)),
            "agent_pos": PolicyFeature(FeatureType.STATE, (len(task.entries),)),
            **{
                f"pixels/{key}": PolicyFeature(FeatureType.VISUAL, (px, px, 3))
                for key, px in task.images.items()
            },
        }
        images = {f"pixels/{key}": f"{OBS_IMAGES}.{key}" for key in task.images}
        self.features_map = {ACTION: ACTION, "agent_pos": OBS_STATE, **images}

    @property
    def package_name(self) -> str:
        return "lerobot_env_bricksrl"

    @property
    def gym_id(self) -> str:
        return GYM_ID

    @property
    def gym_kwargs(self) -> dict[str, Any]:
        return {"env_id": self.task, "hub": self.hub, "render_mode": self.render_mode}
