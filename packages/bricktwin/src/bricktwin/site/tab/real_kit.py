"""Real devices of LEGO's kits from a tab: LEGO's own package and its own Web Bluetooth transport,
unchanged, before a browser that is played.

The package expects to run where a page runs. Here Python runs in a worker, which has no Bluetooth:
what the transport asks of the browser is asked of the page by messages, and it waits in a loop of
its own, as not every browser has Pyodide's ``run_sync``.
"""

import asyncio
import itertools
import json
import sys
from collections.abc import Callable, Coroutine, Iterator, Mapping
from contextlib import contextmanager, redirect_stderr, redirect_stdout, suppress
from types import ModuleType, SimpleNamespace
from typing import Any, BinaryIO, Protocol, TextIO, TypeVar, cast

from brickhub.errors import BricksError
from brickhub.kits.kit_protocol import COMMANDS, Product
from brickhub.kits.kit_run import beside, run_source
from brickhub.kits.radio import lego_package
from brickhub.virtual.run import ProgramStopped
from bricktwin.site.tab.kit_in_tab import waiting_by
from bricktwin.site.tab.mailbox_loop import Mailbox, MailboxLoop, Message, alone
from bricktwin.site.tab.recorder import Page, Recorder
from bricktwin.site.tab.run import (
    FOLDER,
    REFUSED_EXIT_CODE,
    STOPPED_EXIT_CODE,
    ProgramOutput,
    TextOutput,
    tell_written,
    write_programs,
)

_T = TypeVar("_T")
_NUMBERS = itertools.count(1)
_LAST_S = 1.0
"""Longest time in which motors are stopped at the end."""
_ALL_MOTORS = 3
_STOPS: dict[int, bytes] = {
    Product.DOUBLE_MOTOR: bytes([COMMANDS["stop_moving"].number]),
    Product.SINGLE_MOTOR: bytes([COMMANDS["stop"].number, _ALL_MOTORS]),
}
"""Packets that stop the motors of a device."""
_TITLES: dict[int, str] = {product: product.title for product in Product}


class KitPage(Mailbox, Protocol):
    """The page before real devices, as Python in the worker sees it."""

    def ask_kit(
        self,
        number: int,
        operation: str,
        device: int,
        characteristic: str,
        data: str,
    ) -> None:
        """Begin an operation: ``choose`` (``data``: JSON of the ``title`` of a device and the
        browser's ``filters``), ``connect``, ``subscribe``, ``send`` or ``close``. A message
        ``answer`` with its number comes, with the ``device``, ``name`` and ``id`` of the one that
        was chosen, or the browser's ``error`` and its ``message``. Bytes are hexadecimal
        digits."""


class BrowserError(Exception):
    """An error of the browser, with its ``name``, as LEGO's transport reads it."""

    def __init__(self, name: str, message: str) -> None:
        super().__init__(f"{name}: {message}")
        self.name = name


class _Target:
    """What events happen to."""

    def __init__(self) -> None:
        self._listeners: dict[str, list[Callable[[Any], object]]] = {}

    def addEventListener(self, kind: str, listener: Callable[[Any], object]) -> None:  # noqa: N802
        self._listeners.setdefault(kind, []).append(listener)

    def removeEventListener(self, kind: str, listener: Callable[[Any], object]) -> None:  # noqa: N802
        listeners = self._listeners.get(kind, [])
        if listener in listeners:
            listeners.remove(listener)

    def dispatch(self, kind: str) -> None:
        """Tell all listeners of an event of this kind."""
        for listener in list(self._listeners.get(kind, [])):
            listener(SimpleNamespace(target=self))


class _Characteristic(_Target):
    """Characteristic of a device."""

    def __init__(self, device: "_Device", uuid: str) -> None:
        super().__init__()
        self._device = device
        self.uuid = uuid
        self.value = _view(b"")

    async def startNotifications(self) -> None:  # noqa: N802
        self._device.notifies = self
        await self._device.do("subscribe", self.uuid)

    async def writeValueWithoutResponse(self, data: "_Bytes") -> None:  # noqa: N802
        await self._device.do("send", self.uuid, data.to_py())


class _Device(_Target):
    """A device that a person has chosen, with its GATT server and its only service.

    Attributes:
        product: number of the kind that was looked for, if any.
        connected: whether it is.
        notifies: characteristic whose notifications come.
    """

    def __init__(self, browser: "_Browser", answer: Message, product: int | None) -> None:
        super().__init__()
        self._browser = browser
        self._number: int = answer["device"]
        self.name: str = answer["name"]
        self.id: str = answer["id"]
        self.product = product
        self.connected = False
        self.notifies: _Characteristic | None = None

    @property
    def stop(self) -> bytes:
        """Packet that stops its motors; empty for a device that has none."""
        return b"" if self.product is None else _STOPS.get(self.product, b"")

    @property
    def gatt(self) -> "_Device":
        return self

    async def do(
        self,
        operation: str,
        characteristic: str = "",
        data: bytes = b"",
    ) -> Message:
        """Let the page do something with this device."""
        return await self._browser.do(
            operation,
            self._number,
            characteristic,
            data.hex(),
        )

    async def connect(self) -> "_Device":
        await self.do("connect")
        self.connected = True
        stop = self.stop.hex()
        self._browser.tell("kit", device=self._number, name=self.name, stop=stop)
        return self

    def disconnect(self) -> None:
        self.connected = False
        self._browser.begin("close", self._number)

    async def getPrimaryService(self, _uuid: str) -> "_Device":  # noqa: N802
        return self

    async def getCharacteristic(self, uuid: str) -> _Characteristic:  # noqa: N802
        return _Characteristic(self, uuid)

    def hear(self, data: bytes) -> None:
        """Take a notification."""
        if self.notifies is not None:
            self.notifies.value = _view(data)
            self.notifies.dispatch("characteristicvaluechanged")

    def lose(self) -> None:
        """The link is lost."""
        self.connected = False
        self.dispatch("gattserverdisconnected")


class _Browser:
    """``navigator.bluetooth`` of a page."""

    def __init__(self, page: KitPage, tell: Callable[..., None]) -> None:
        self._page = page
        self.tell = tell
        self._waiting: dict[int, asyncio.Future[Message]] = {}
        self.devices: dict[int, _Device] = {}

    async def requestDevice(self, options: Mapping[str, Any]) -> _Device:  # noqa: N802
        (filters,) = options["filters"]
        product = None
        for data in filters.get("manufacturerData", ()):
            # The first two bytes are the product's, if it is asked for.
            if data["mask"][:2] == b"\xff\xff":
                product = int.from_bytes(data["dataPrefix"][:2], "big")
        title = "device" if product is None else _TITLES.get(product, "device")
        asked = {"title": title, "filters": _for_json(options["filters"])}
        answer = await self.do("choose", data=json.dumps(asked))
        device = _Device(self, answer, product)
        self.devices[answer["device"]] = device
        return device

    def begin(
        self,
        operation: str,
        device: int,
        characteristic: str = "",
        data: str = "",
    ) -> int:
        """Begin an operation; returns its number."""
        number = next(_NUMBERS)
        self._page.ask_kit(
            number,
            operation,
            device,
            characteristic,
            data,
        )
        return number

    async def do(
        self,
        operation: str,
        device: int = -1,
        characteristic: str = "",
        data: str = "",
    ) -> Message:
        """Answer to an operation. Raises BrowserError if the browser refuses it."""
        number = self.begin(
            operation,
            device,
            characteristic,
            data,
        )
        waiting = self._waiting[number] = asyncio.get_running_loop().create_future()
        try:
            answer: Message = await waiting
        finally:
            del self._waiting[number]
        if answer.get("error"):
            raise BrowserError(answer["error"], answer["message"])
        return answer

    def take(self, message: Message) -> None:
        """Take a message of the page. Raises ProgramStopped when the person says stop."""
        match message["kind"]:
            case "stop":
                raise ProgramStopped
            case "answer":
                waiting = self._waiting.get(message["number"])
                # Nobody waits for the end of a connection.
                if waiting is not None and not waiting.done():
                    waiting.set_result(message)
            case "event":
                self.devices[message["device"]].hear(bytes.fromhex(message["data"]))
            case "lost":
                self.devices[message["device"]].lose()

    async def stop_motors(self) -> None:
        """Stop the motors of all devices, and leave them."""
        for device in self.devices.values():
            if not device.connected:
                continue
            if device.stop and device.notifies is not None:
                written = device.notifies.uuid.replace("-0002-", "-0001-", 1)
                await device.do("send", written, device.stop)
            device.disconnect()
            device.lose()


class _Bytes:
    """Bytes as JavaScript has them."""

    def __init__(self, data: bytes) -> None:
        self._data = data

    @staticmethod
    def new(
        buffer: bytes,
        offset: int = 0,
        length: int | None = None,
    ) -> "_Bytes":
        end = None if length is None else offset + length
        return _Bytes(bytes(buffer[offset:end]))

    def to_py(self) -> bytes:
        return self._data


class _Proxy:
    """A function that JavaScript could call."""

    def __init__(self, function: Callable[..., object]) -> None:
        self._function = function

    def __call__(self, *arguments: object) -> object:
        return self._function(*arguments)

    def destroy(self) -> None:
        """Nothing holds it."""


def _view(data: bytes) -> SimpleNamespace:
    return SimpleNamespace(buffer=data, byteOffset=0, byteLength=len(data))


def _for_json(value: Any) -> Any:
    """A value whose bytes are lists of numbers."""
    if isinstance(value, Mapping):
        return {name: _for_json(part) for name, part in value.items()}
    if isinstance(value, bytes | list):
        return [_for_json(part) for part in value]
    return value


class _OutputAtOnce(ProgramOutput):
    """Output of which the page is told line by line: a program may wait for nothing any more."""

    def write(self, data: bytes | str, /) -> int:
        written = super().write(data)
        if data[-1:] in (b"\n", "\n"):
            self.recorder.post()
        return written


@contextmanager
def _played(browser: _Browser) -> Iterator[None]:
    """Context in which Pyodide's modules show this browser."""
    ffi: Any = sys.modules["pyodide.ffi"]
    before = sys.modules.get("js"), ffi.to_js, ffi.create_proxy
    js: Any = ModuleType("js")
    js.navigator = SimpleNamespace(bluetooth=browser)
    js.Object = SimpleNamespace(fromEntries=dict)
    js.Uint8Array = _Bytes
    sys.modules["js"] = js
    ffi.to_js = lambda value, dict_converter=None: value
    ffi.create_proxy = _Proxy
    try:
        yield
    finally:
        js_before, ffi.to_js, ffi.create_proxy = before
        del sys.modules["js"]
        if js_before is not None:
            sys.modules["js"] = js_before


def run_on_kit(
    request_text: str,
    kit_page: KitPage,
    page: Page,
) -> int:
    """Run one of the page's programs on real devices of LEGO's kits; returns the exit code.

    Args:
        request_text: JSON with ``files`` (text by name) and the ``name`` of the one to run.
        kit_page: has the devices.
        page: told what is printed, and of each device that is connected (``kit``, with the bytes
            that stop it).
    """
    request = json.loads(request_text)
    recorder = Recorder(page)
    browser = _Browser(kit_page, recorder.tell)
    write_programs(request["files"])
    try:
        _use_bluetooth()
        return _run(request, browser, recorder, kit_page)
    except BricksError as error:
        recorder.tell("err", text=f"error: {error}\n")
        return REFUSED_EXIT_CODE
    finally:
        tell_written(request["files"], recorder)
        recorder.post()


def _use_bluetooth() -> None:
    """Let LEGO's package use Bluetooth, also after virtual devices. Raises MediumUnavailableError
    if this site lacks the package."""
    lego_package()
    from legoeducation.ble_transport import register_transport

    from brickhub.kits.lego_transport import VirtualTransport

    register_transport(VirtualTransport)


def _run(
    request: Mapping[str, Any],
    browser: _Browser,
    recorder: Recorder,
    mailbox: Mailbox,
) -> int:
    path = FOLDER / request["name"]
    errors = cast("TextIO", ProgramOutput(recorder, "err"))
    loop = MailboxLoop(mailbox, browser.take)
    is_stopped = False

    def until(coroutine: Coroutine[Any, Any, _T]) -> _T | None:
        """Run a coroutine of the package to its end."""
        nonlocal is_stopped
        recorder.post()
        # Within a notification nothing else can happen.
        if loop.is_running():
            coroutine.close()
            return None
        with alone():
            try:
                return loop.run_until_complete(coroutine)
            except ProgramStopped:
                is_stopped = True
                raise

    output = TextOutput(cast("BinaryIO", _OutputAtOnce(recorder, "out")))
    # What LEGO's package logs is for the person, too: a device that was not found.
    logged = TextOutput(cast("BinaryIO", _OutputAtOnce(recorder, "err")))
    with beside(path), _played(browser), waiting_by(until):
        source = request["files"][request["name"]]
        with redirect_stdout(output), redirect_stderr(logged):
            try:
                code = run_source(source, path, lambda program: program(), errors)
            finally:
                _leave(loop, browser)
    return STOPPED_EXIT_CODE if is_stopped else code


def _leave(loop: MailboxLoop, browser: _Browser) -> None:
    """Stop all motors, whatever the program has left, and end the loop."""
    with alone():
        for task in asyncio.all_tasks(loop):
            task.cancel()
        # What it cannot do, the page does itself.
        with suppress(TimeoutError, BrowserError, ProgramStopped):
            loop.run_until_complete(asyncio.wait_for(browser.stop_motors(), _LAST_S))
        loop.close()
