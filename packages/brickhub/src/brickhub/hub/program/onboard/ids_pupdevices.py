"""MicroPython: the number of the device on a port, as it says itself."""
# mypy: ignore-errors
# ruff: noqa: F821
# --- the hub's part ---


def device_id(port):
    try:
        return PUPDevice(port).info()["id"]
    except OSError:
        return 0
