"""Devices of the user's own, by the name of their file: ``A=my_device.py:GAUGE``."""

import inspect

from brickhub.errors import DescriptionError
from brickhub.user_files import is_reference, load_object
from brickhub.virtual.own_devices import AnyOwnDevice, OwnDeviceOf


def is_own_device(text: str) -> bool:
    """Whether ``A=my_device.py:GAUGE`` names an object of the user's."""
    return is_reference(text.partition("=")[2].strip())


def load_own_device(text: str) -> tuple[str, AnyOwnDevice | OwnDeviceOf]:
    """Port and device of ``A=my_device.py:GAUGE``, which may be a function that makes it for the
    robot. Raises as `load_object`, and DescriptionError if there is no port, or the object is no
    device."""
    port, _, reference = (part.strip() for part in text.partition("="))
    kinds = "OwnDevice, OwnUart or OwnI2c"
    device = load_object(
        reference,
        AnyOwnDevice,
        missing=f"write an {kinds} there",
        noun="device",
    )
    is_function = inspect.isfunction(device)
    if not (is_function or isinstance(device, AnyOwnDevice)):
        raise DescriptionError(f"{reference} is no {kinds}; name one")
    if not port:
        raise DescriptionError(f"'{text}' names no port; give one such as A=my_device.py:GAUGE")
    return port.upper().removeprefix("S"), device
