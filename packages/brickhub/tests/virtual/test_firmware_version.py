"""Versions of the firmware that the virtual hub plays."""

from __future__ import annotations

import io
from pathlib import Path

import pytest
from described import TWO_WHEELER

from brickhub.errors import HubError, UnknownNameError
from brickhub.hub.transport import HubProgram
from brickhub.virtual.bench_body import BenchBody
from brickhub.virtual.machine import FIRMWARE_VERSIONS
from brickhub.virtual.run import Operation, run_file
from brickhub.virtual.virtual_transport import VirtualHub

PROGRAM = (
    "from pybricks import version\nprint(version[1])\n"
    "from pybricks.messaging import HubNetwork\nHubNetwork()\n"
)


def ran(tmp_path: Path, program: str, **options: str) -> tuple[str, str]:
    (tmp_path / "main.py").write_text(program)
    out, err = io.BytesIO(), io.StringIO()
    run_file(tmp_path / "main.py", stdout=out, stderr=err, operation=Operation(**options))
    return out.getvalue().decode(), err.getvalue()


def test_newest_version_is_played_and_an_older_one_can_be(tmp_path: Path) -> None:
    out, err = ran(tmp_path, PROGRAM)
    assert (
        out == "4.1.0\n" and "NotImplementedError: the virtual hub does not play HubNetwork" in err
    )
    out, err = ran(tmp_path, PROGRAM, firmware="4.0")
    assert out == "4.0.1\n" and "can't import name HubNetwork" in err


def test_small_hubs_have_no_hub_network(tmp_path: Path) -> None:
    _, err = ran(tmp_path, f"from pybricks.hubs import CityHub\n{PROGRAM}")
    assert "can't import name HubNetwork" in err


def test_unknown_version_is_told(tmp_path: Path) -> None:
    with pytest.raises(UnknownNameError, match=r"no firmware '5.0'.*choose 4.1, 4.0"):
        ran(tmp_path, PROGRAM, firmware="5.0")


@pytest.mark.parametrize(("firmware", "writes"), [("4.0", 3), ("4.1", 25)])
def test_input_buffer_takes_a_packet_since_4_1(firmware: str, writes: int) -> None:
    hub = VirtualHub(BenchBody(TWO_WHEELER))
    hub.machine.firmware = FIRMWARE_VERSIONS[firmware]
    hub.start(HubProgram("from pybricks.tools import wait\nwait(100000)\n", 0))
    for _ in range(writes):
        hub.write(bytes(20))
    with pytest.raises(HubError, match="buffer is full"):
        hub.write(bytes(20))
