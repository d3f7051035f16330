"""Kept models: compiled MuJoCo models of robots in their scenes, in MuJoCo's binary form, which
loads in milliseconds."""

import os
from collections.abc import Callable, Iterator, Sequence
from pathlib import Path

import mujoco
import numpy as np

from brickhub.errors import TwinError, message_of
from brickhub.robot import Robot
from bricktwin.kept import UnkeptError, described, kept
from bricktwin.plans import ldraw_library
from bricktwin.plans.ldraw_text import sources_of
from bricktwin.robots.planned import plan_file
from bricktwin.twin.scene import Scene

_SPARSE_FROM_DOFS = 60
"""Number of degrees of freedom from which on MuJoCo chooses sparse matrices, whose factor is wrong
until version 4.0.1 (its changelog)."""


def robot_model(robot: Robot, scene: Scene) -> mujoco.MjModel:
    """Compiled model of a robot in its scene. Raises TwinError if there is none, see
    ``load_model``, or it does not compile."""

    def build() -> mujoco.MjSpec:
        # This import takes longer than loading a kept model, so it is done only to make one.
        from bricktwin.twin.models.load import load_model

        return load_model(robot, scene)

    return kept_model(build, [robot], scene)


def kept_model(
    build: Callable[[], mujoco.MjSpec],
    robots: Sequence[Robot],
    surroundings: object,
) -> mujoco.MjModel:
    """Compiled model, or the equal one that an earlier process kept. It is not kept if a function
    of the user makes a robot's model. Raises TwinError if it does not compile.

    Args:
        build: makes the model, from these robots and surroundings only.
        surroundings: a scene or an arena.
    """

    def compiled() -> mujoco.MjModel:
        spec = build()
        try:
            return spec.compile()
        except ValueError as error:
            raise TwinError(
                f"the model of '{spec.modelname}' does not compile ({message_of(error)}); "
                "correct it"
            ) from error

    def sources() -> Iterator[bytes]:
        yield described((robots, surroundings, mujoco.mj_versionString()))
        for robot in robots:
            yield from _model_sources(robot)
        yield from _library()

    model = kept(sources, compiled, _encoded, _decoded)
    # This is set after loading, so that it holds for new models and for kept ones.
    if model.nv >= _SPARSE_FROM_DOFS:
        model.opt.jacobian = mujoco.mjtJacobian.mjJAC_DENSE
    return model


def _model_sources(robot: Robot) -> Iterator[bytes]:
    """Names and contents of the files of a robot's model: its plan with the files beside it, or its
    MJCF file with all that this includes."""
    source = robot.model
    if source is None:
        return
    plan = plan_file(source)
    if plan is not None:
        yield from sources_of(plan)
        return
    if not source.endswith(".xml"):
        raise UnkeptError(f"the function {source} may do anything")
    try:
        paths = sorted(map(Path, mujoco.mju_getXMLDependencies(source)))
    except mujoco.FatalError as error:
        raise UnkeptError(str(error)) from error
    # Names go into the digest and paths do not, so that two copies of a model are one.
    for path in paths:
        yield path.name.encode()
        yield path.read_bytes()


def model_stamps(robot: Robot) -> tuple[tuple[str, int, int], ...]:
    """Names, times (ns) and sizes (bytes) of a robot's model file and of what lies beside it with
    the same suffix: they differ once somebody has changed its drawing."""
    source = robot.model
    path = None if source is None else plan_file(source) or Path(source)
    if path is None or not path.is_file():
        return ()
    stamps: list[tuple[str, int, int]] = []
    with os.scandir(path.parent) as entries:
        for entry in entries:
            if entry.name.endswith(path.suffix):
                state = entry.stat()
                stamps.append((entry.name, state.st_mtime_ns, state.st_size))
    return tuple(sorted(stamps))


def _library() -> Iterator[bytes]:
    """The installed LDraw library, which parts are drawn from: its folders, with the times of their
    last changes."""
    root = ldraw_library.folder()
    if root is None:
        return
    # The folders' times stand for their files: reading tens of thousands of files would take longer
    # than building the model.
    for name in ("LDConfig.ldr", "parts", "parts/s", "p", "p/48", "p/8"):
        path = root / name
        if path.exists():
            yield f"{path} {path.stat().st_mtime_ns}".encode()


def _encoded(model: mujoco.MjModel) -> bytes:
    buffer = np.empty(mujoco.mj_sizeModel(model), np.uint8)
    mujoco.mj_saveModel(model, None, buffer)
    return buffer.tobytes()


def _decoded(data: bytes) -> mujoco.MjModel:
    return mujoco.MjModel.from_binary_path("kept.mjb", {"kept.mjb": data})
