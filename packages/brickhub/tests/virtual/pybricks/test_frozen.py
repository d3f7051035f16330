"""Modules that are frozen into the firmware, and ``pybricks.experimental``."""

from __future__ import annotations

import pytest

from brickhub.pytest_plugin import PybricksHub
from brickhub.robot import HubKind

WITH_IMU = [kind for kind in HubKind if kind.model.has_imu]


def ends(hub: PybricksHub, kind: HubKind, line: str) -> tuple[str, str]:
    """What a program prints, and the last line of its errors."""
    run = hub.run(f"from pybricks.hubs import {kind.model.class_name}\n{line}\n", time_limit_s=2)
    return run.output, (run.errors.splitlines() or [""])[-1]


@pytest.mark.parametrize("kind", HubKind)
def test_the_calibration_of_the_imu_begins_on_hubs_that_have_one(
    pybricks_hub: PybricksHub, kind: HubKind
) -> None:
    output, error = ends(pybricks_hub, kind, "import _imu_calibrate")
    if kind in WITH_IMU:
        assert (
            "Going to calibrate X now!\n- Put the hub on the table in front of you.\n"
            "- top side (display) facing up\n"
        ) in output
        assert (
            output.endswith("Roll it towards you, without lifting the hub up!\n")
            and "time limit of 2 s" in error
        )
    else:
        assert (output, error) == ("", "ImportError: no module named '_imu_calibrate'")


def test_the_view_of_the_ports_runs_until_it_is_stopped(pybricks_hub: PybricksHub) -> None:
    assert ends(pybricks_hub, HubKind.TECHNIC, "import _builtin_port_view") == (
        "",
        "The program was stopped at the time limit of 2 s.",
    )
    assert "no module named" in ends(pybricks_hub, HubKind.MOVE, "import _builtin_port_view")[1]


@pytest.mark.parametrize(
    ("kind", "line", "printed", "error"),
    [
        (
            HubKind.CITY,
            "from pybricks.experimental import hello_world\nprint(hello_world(foo=5))",
            "25\n",
            "",
        ),
        (
            HubKind.PRIME,
            "from pybricks.experimental import *\nprint(hello_world(-3, 1))",
            "9\n",
            "",
        ),
        (HubKind.PRIME, "from pybricks.experimental import restore_firmware", "", ""),
        (
            HubKind.CITY,
            "from pybricks.experimental import getchar",
            "",
            "ImportError: can't import name getchar",
        ),
        (
            HubKind.CITY,
            "from pybricks.experimental import restore_firmware",
            "",
            "ImportError: can't import name restore_firmware",
        ),
        (
            HubKind.MOVE,
            "import pybricks.experimental",
            "",
            "ImportError: no module named 'pybricks.experimental'",
        ),
    ],
)
def test_experimental(
    pybricks_hub: PybricksHub, kind: HubKind, line: str, printed: str, error: str
) -> None:
    assert ends(pybricks_hub, kind, line) == (printed, error)
