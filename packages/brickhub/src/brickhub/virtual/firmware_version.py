"""Versions of Pybricks' firmware that the virtual hub plays, as a table."""

from __future__ import annotations

from dataclasses import dataclass

from brickhub.errors import UnknownNameError, hint


@dataclass(frozen=True)
class FirmwareVersion:
    """What distinguishes a version to a program.

    Attributes:
        version, build: what ``pybricks.version`` tells.
        takes_packets: whether the input buffer takes at least a whole packet (since 4.1: pybricks/support#2788).
        has_hub_network: whether ``pybricks.messaging`` has ``HubNetwork``.
    """

    version: str
    build: str
    takes_packets: bool = False
    has_hub_network: bool = False


FIRMWARE_VERSIONS = {
    "4.1": FirmwareVersion("4.1.0", "v4.1.0 on 2026-10-12", takes_packets=True, has_hub_network=True),
    "4.0": FirmwareVersion("4.0.1", "v4.0.1 on 2026-06-23"),
}
"""Stable versions, the newest first."""
NEWEST = "4.1"


def firmware_version(name: str) -> FirmwareVersion:
    """The version of that name. Raises UnknownNameError if it is not played."""
    if name not in FIRMWARE_VERSIONS:
        known = ", ".join(FIRMWARE_VERSIONS)
        raise UnknownNameError(f"the virtual hub plays no firmware '{name}'{hint(name, FIRMWARE_VERSIONS)}; choose {known}")
    return FIRMWARE_VERSIONS[name]
