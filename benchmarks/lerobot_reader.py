"""LeRobot's own reader, run in the environment where it is installed by `record_kill.py --lerobot`.

Each line of its standard input is the folder of a dataset. It answers with a line of JSON: digests
of all frames that `LeRobotDataset` read, or the error that it raised.
"""

from __future__ import annotations

import argparse
import hashlib
import json
import sys
from typing import Any

import numpy as np
import torch

NUMBERS = ("observation.state", "action", "next.reward")


def declare_operators() -> None:
    """Declare torchvision's operators, so that one built for another torch can be imported; none is
    used here."""
    try:
        import torchvision  # noqa: F401
    except RuntimeError:
        for name in [name for name in sys.modules if name.startswith("torchvision")]:
            del sys.modules[name]
        for name in ("nms", "qnms"):
            torch.library.define(
                f"torchvision::{name}",
                "(Tensor dets, Tensor scores, float iou_threshold) -> Tensor",
            )


def digest(values: Any) -> str:
    """SHA-256 of the bytes of an array."""
    return hashlib.sha256(np.ascontiguousarray(values).tobytes()).hexdigest()


def read(root: str) -> dict[str, Any]:
    """Digests of the states, actions, rewards (if any) and images of all frames, by episode."""
    from lerobot.datasets.lerobot_dataset import LeRobotDataset

    dataset = LeRobotDataset("local/dataset", root=root)
    episodes: dict[int, list[Any]] = {}
    for index in range(len(dataset)):
        frame = dataset[index]
        episodes.setdefault(int(frame["episode_index"]), []).append(frame)
    digests = []
    for frames in episodes.values():
        episode = {
            name: digest(torch.stack([frame[name] for frame in frames]))
            for name in NUMBERS
            if name in frames[0]
        }
        for camera in dataset.meta.camera_keys:
            images = torch.stack([frame[camera] for frame in frames])
            episode["image"] = digest((images * 255).round().byte().permute(0, 2, 3, 1))
        digests.append(episode)
    return {"counted": dataset.num_episodes, "episodes": digests}


def main() -> None:
    """Answer until the input ends."""
    argparse.ArgumentParser(
        description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter
    ).parse_args()
    declare_operators()
    from importlib import metadata

    print(
        json.dumps(
            {"lerobot": metadata.version("lerobot"), "torchvision": metadata.version("torchvision")}
        ),
        flush=True,
    )
    for line in sys.stdin:
        try:
            answer = read(line.strip())
        except Exception as error:  # noqa: BLE001 whatever it raises is the answer
            answer = {"error": f"{type(error).__name__}: {error}"}
        print(json.dumps(answer), flush=True)


if __name__ == "__main__":
    main()
