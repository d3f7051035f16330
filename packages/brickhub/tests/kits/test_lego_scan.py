"""Which virtual devices a scan of LEGO's package finds."""

from __future__ import annotations

import asyncio
from typing import Any

import pytest
from kit_world import ROBOT

from brickhub.kits.virtual_kit import VirtualKit
from brickhub.virtual.bench_body import BenchBody

pytest.importorskip("legoeducation")


@pytest.fixture
def kit(monkeypatch: pytest.MonkeyPatch) -> VirtualKit:
    """The only kit in reach."""
    from brickhub.kits.lego_transport import VirtualTransport

    kit = VirtualKit(BenchBody(ROBOT, readings={"light": lambda angles: 50.0}))
    monkeypatch.setattr(VirtualTransport, "in_reach", [kit])
    return kit


def found(**filters: Any) -> list[str]:
    """Addresses of the devices that a scan finds."""
    from brickhub.kits.lego_transport import VirtualTransport

    devices = asyncio.run(VirtualTransport().scan_devices(1.0, filters))
    return [device.address for device in devices]


ALL = ["virtual-AB", "virtual-C", "virtual-D", "virtual-controller"]


@pytest.mark.parametrize(
    ("filters", "addresses"),
    [
        ({}, ALL),
        ({"device_name": "any", "device_mac": "any"}, ALL),
        ({"device_name": None, "device_mac": "", "product_id": None}, ALL),
        ({"product_id": 512}, ["virtual-C"]),
        ({"product_id": 513}, ["virtual-AB"]),
        ({"product_id": 99}, []),
        ({"device_name": "motor"}, ["virtual-AB", "virtual-C"]),
        ({"device_name": "SINGLE motor"}, ["virtual-C"]),
        ({"device_name": "crane"}, []),
        ({"device_mac": "virtual-a"}, ["virtual-AB"]),
        ({"device_mac": "C0:01"}, []),
        # Name and address count together.
        ({"device_name": "motor", "device_mac": "virtual-d"}, []),
        ({"device_name": "color", "device_mac": "virtual-d"}, ["virtual-D"]),
        ({"device_name": "color", "device_mac": "virtual-c"}, []),
        ({"device_name": "motor", "device_mac": "virtual-c", "product_id": 513}, []),
    ],
)
def test_scan_finds_what_is_asked_for(
    kit: VirtualKit, filters: dict[str, Any], addresses: list[str]
) -> None:
    assert found(**filters) == addresses


def test_scan_finds_no_device_that_is_connected_or_out_of_reach(kit: VirtualKit) -> None:
    kit.peers[0].device.connect()
    assert found() == ALL[1:]
    kit.in_reach = lambda: False
    assert found() == []


def test_devices_have_the_name_on_their_box(kit: VirtualKit) -> None:
    assert [repr(peer) for peer in kit.peers] == [
        "virtual-AB: Double Motor",
        "virtual-C: Single Motor",
        "virtual-D: Color Sensor",
        "virtual-controller: Controller",
    ]
