"""Serial ports that do not answer as a hub with Pybricks does: the error names the likely cause."""

from __future__ import annotations

import contextlib
import os
import sys
import threading
from collections.abc import Callable, Iterator

import pytest

from brickhub.errors import HubTimeoutError
from brickhub.hub.transports.usb import UsbHub, UsbTransport

pytestmark = pytest.mark.skipif(sys.platform == "win32", reason="needs a pseudo-terminal")


@contextlib.contextmanager
def port(answer: Callable[[bytes], bytes]) -> Iterator[str]:
    """A serial port whose other end answers."""
    import pty
    import tty

    other, own = pty.openpty()
    tty.setraw(own)

    def serve() -> None:
        with contextlib.suppress(OSError):
            while True:
                if told := answer(os.read(other, 256)):
                    os.write(other, told)

    threading.Thread(target=serve, daemon=True).start()
    yield os.ttyname(own)
    os.close(own)
    os.close(other)


@pytest.mark.parametrize(
    "answer",
    [
        lambda _: b"",
        lambda _: (
            b'>>> \r\nTraceback (most recent call last):\r\n  File "<stdin>", line 1\r\n'
            b"SyntaxError: invalid syntax\r\n>>> "
        ),
        lambda _: bytes([0x07, 0x03, 0x12, 0x55, 0x02]),
    ],
    ids=["silent", "LEGO's Python", "LEGO's frames"],
)
def test_error_names_the_firmware(answer):
    with port(answer) as name:
        transport = UsbTransport(name, timeout_s=0.5, find_hubs=lambda: [UsbHub(name, name)])
        with pytest.raises(
            HubTimeoutError, match=r"LEGO's own firmware, or Pybricks before 4\.1"
        ) as caught:
            transport.open()
        assert "near" not in str(caught.value)
