"""Bluetooth: devices, messages between hubs, and AppData for the host (``pybricks.messaging`` of
Pybricks 4).

Only a remote control and an Xbox controller can be near: searches for others time out. Names and
errors: ``pybricks`` on PyPI,
``pb_type_iodevices_lwp3device.c``, ``pb_type_iodevices_xbox_controller.c``, v4.
"""

from collections.abc import Callable
from types import ModuleType
from typing import Any

from brickhub.robot.hardware import REMOTE_BUTTONS
from brickhub.virtual import error_numbers
from brickhub.virtual.micropython.numbers import module
from brickhub.virtual.micropython.streams import as_bytes
from brickhub.virtual.pybricks.arguments import (
    expect,
    expect_type,
    get_array,
    get_exact_int,
    get_int,
    get_text,
    os_error,
)
from brickhub.virtual.pybricks.ble_radio import BLERadio
from brickhub.virtual.pybricks.context import Context, Native, bind
from brickhub.virtual.pybricks.parameters import Color, buttons
from brickhub.virtual.pybricks.pupsensors import ColorLight

_MAX_NAME_BYTES = 14
_SEARCH_MS = 500
"""Time until a device that is switched on and near is found."""
_XBOX_BUTTONS = (
    "a",
    "b",
    "",
    "x",
    "y",
    "",
    "lb",
    "rb",
    "",
    "",
    "view",
    "menu",
    "guide",
    "lj",
    "rj",
)
"""Buttons by their bit in the controller's report; empty for bits without a button."""
_XBOX_EXTRAS = ("upload", "p1", "p2", "p3", "p4")
_RUMBLE_MOTORS = 4
_STICK_MAX = 2**15 - 1
_TRIGGER_MAX = 1023
_MESSAGE_BYTES = range(3, 21)
"""Length of a message of LEGO's wireless protocol 3: a header, and what fits a notification."""
_MAX_EVENT_BYTES = 19
"""Room in a notification of 20 bytes behind the kind of event."""
# AppData begins what it tells the host itself with this byte.
_SET_UP = 0
_CONFIGURE = 1


def _unavailable(name: str) -> Callable[..., Any]:
    """A method that needs the device."""

    def method(self: Any, *values: Any) -> Any:
        raise os_error(error_numbers.ENODEV)

    method.__name__ = method.__qualname__ = name
    return method


class Wireless(Native):
    """Bluetooth device."""

    _kind = ""
    """Name of the device among those that can be near; empty for one that never is."""
    _wanted: str | None = None
    """The name that is looked for."""
    _is_connected = False
    _connected_ms = 0
    _pause_ms: int | None = None
    """Pause before the second search; ``None`` if there is none."""

    def __init__(
        self,
        name: Any = None,
        timeout: Any = 10000,
        connect: Any = True,
    ) -> None:
        self._context.assert_blocking()
        if name is not None and len(get_text(name).encode()) > _MAX_NAME_BYTES:
            raise ValueError("Name too long")
        self._timeout_ms = None if timeout is None else max(0, get_int(timeout)) + 1
        if connect:
            self.connect()

    def connect(self) -> Any:
        peripherals = self._context.peripherals
        if len(peripherals) >= self._machine.robot.hub.model.peripherals:
            raise os_error(error_numbers.EBUSY)
        # A connected device does not advertise itself, so another search does not find it.
        is_taken = any(device._is_found(self) for device in peripherals)
        is_near = self._is_near() and not is_taken
        peripherals.append(self)
        start_ms = self._machine.time_ms
        longest_ms = self._timeout_ms
        # The second search takes as long as the first one.
        if longest_ms is not None and self._pause_ms is not None:
            longest_ms = 2 * longest_ms + self._pause_ms

        def is_done() -> bool:
            now_ms = self._machine.time_ms
            # It answers a search when it has been on for a while; the search may begin before.
            since_ms = max(start_ms, now_ms - _SEARCH_MS)
            is_on = not self._machine.panel.was_off(self._kind, since_ms, now_ms)
            waited_ms = now_ms - start_ms
            is_late = longest_ms is not None and waited_ms >= longest_ms
            if not (is_near and is_on):
                if is_late:
                    self._release()
                    raise os_error(error_numbers.ETIMEDOUT)
                return False
            if waited_ms < _SEARCH_MS:
                return False
            self._is_connected = True
            self._connected_ms = now_ms
            return True

        return self._context.finish(is_done, on_close=self._release, poll_ms=1)

    def _release(self) -> None:
        """Give the hub's place for a device back."""
        if self in self._context.peripherals:
            self._context.peripherals.remove(self)

    def _is_found(self, other: "Wireless") -> bool:
        """Whether this is the connection to the device that another one looks for: one of the same
        kind and name."""
        is_same = (self._kind, self._wanted) == (other._kind, other._wanted)
        return self._is_connected and is_same

    def _is_near(self) -> bool:
        return self._kind in self._machine.panel.near

    def _done(self) -> Any:
        """A command that completes immediately. Raises OSError, ENODEV, while it is not
        connected."""
        self._down()
        return self._context.done()

    def disconnect(self) -> Any:
        self._is_connected = False
        self._release()
        return self._context.done()

    name = _unavailable("name")

    def _down(self) -> frozenset[str]:
        """Names of the buttons that are down. Raises OSError, ENODEV, while the device is not
        connected."""
        panel = self._machine.panel
        now_ms = self._machine.time_ms
        # A connection that broke stays lost, also when the device is back: `connect()` finds it.
        if self._is_connected and panel.was_off(self._kind, self._connected_ms, now_ms):
            self._is_connected = False
            self._release()
        if not self._is_connected:
            raise os_error(error_numbers.ENODEV)
        return panel.pressed_on(self._kind, now_ms)


class _Buttons(Native):
    """Buttons of a device in the firmware's order, pressed by the panel."""

    def __init__(
        self,
        device: Wireless,
        names: tuple[str, ...],
    ) -> None:
        self._device = device
        self._machine = device._machine
        self._names = names

    def pressed(self) -> Any:
        down = self._device._down()
        names = [name for name in self._names if name in down]
        return buttons(names, self._machine.robot.hub.model)


class LWP3Device(Wireless):
    def __init__(
        self,
        hub_kind: Any,
        name: Any = None,
        timeout: Any = 10000,
        pair: Any = False,
        num_notifications: Any = 8,
        connect: Any = True,
    ) -> None:
        # The numbers are only checked, because such a device is never near.
        for number in (num_notifications, hub_kind):
            get_exact_int(number)
        super().__init__(name, timeout, connect)

    def write(self, buf: Any, /) -> Any:
        message = as_bytes(buf)
        if len(message) not in _MESSAGE_BYTES:
            raise ValueError("bad length")
        if message[0] != len(message):
            raise ValueError("length in header wrong")
        raise os_error(error_numbers.ENODEV)

    read = _unavailable("read")


class Remote(Wireless):
    """The remote control, near if the panel has one."""

    _kind = "remote"

    def __init__(
        self,
        name: Any = None,
        timeout: Any = 10000,
        connect: Any = True,
    ) -> None:
        self.buttons = _Buttons(self, REMOTE_BUTTONS)
        self.light = ColorLight(self, self._done)
        self._wanted = None if name is None else get_text(name)
        super().__init__(name, timeout, connect)

    def _is_near(self) -> bool:
        """Whether one of that name is near; before a program has named it, it has the name that is
        looked for."""
        if not super()._is_near():
            return False
        present_name = self._machine.panel.remote_name or self._wanted
        return self._wanted is None or self._wanted == present_name

    def name(self, *name: Any) -> Any:
        panel = self._machine.panel
        # LEGO's own name of the remote is "Handset".
        present_name = panel.remote_name or self._wanted or "Handset"
        text = get_text(name[0]) if name else present_name
        if not 1 <= len(text.encode()) <= _MAX_NAME_BYTES:
            raise ValueError("bad name length")
        self._down()
        if not name:
            return text
        panel.remote_name = text
        return self._context.done()


class TechnicMoveHub(Wireless):
    drive = _unavailable("drive")


class DuploTrain(Wireless):
    drive = _unavailable("drive")
    headlights = _unavailable("headlights")
    sound = _unavailable("sound")
    speed = _unavailable("speed")
    color = _unavailable("color")


class MarioHub(Wireless):
    color = _unavailable("color")
    hsv = _unavailable("hsv")

    def detectable_colors(self, colors: Any = None) -> None:
        for color in colors or ():
            expect_type(color, Color)


class XboxController(Wireless):
    """The game controller, near if the panel has one."""

    _kind = "xbox"
    _pause_ms = 2000

    def __init__(
        self,
        joystick_deadzone: Any = 10,
        name: Any = None,
        timeout: Any = 10000,
        connect: Any = True,
    ) -> None:
        # This is only checked, because a stick on the panel is either at rest or all the way out.
        get_int(joystick_deadzone)
        with_button = [button for button in _XBOX_BUTTONS if button]
        names = (*with_button, *_XBOX_EXTRAS, "up", "right", "down", "left")
        self.buttons = _Buttons(self, names)
        super().__init__(name, timeout, connect)

    def name(self, name: Any = None) -> str:
        self._down()
        return "Xbox Wireless Controller"

    def state(self) -> tuple[int, ...]:
        """Raw values, as the controller sends them."""
        down = self._down()
        axes: list[int] = []
        for side in ("left", "right"):
            # The controller counts downwards, so y is reversed.
            x, y = _stick(down, side, _STICK_MAX)
            axes += [_raw_axis(x), _raw_axis(-y)]
        triggers = [_TRIGGER_MAX * (f"{side}_trigger" in down) for side in ("left", "right")]
        bits = 0
        for bit, name in enumerate(_XBOX_BUTTONS):
            if name in down:
                bits |= 1 << bit
        upload, *paddles = _XBOX_EXTRAS
        paddle_bits = 0
        for bit, name in enumerate(paddles):
            if name in down:
                paddle_bits |= 1 << bit
        # The two zeros are the profile and the positions of the trigger switches.
        extras = int(upload in down), 0, 0, paddle_bits
        return *axes, *triggers, _dpad(down), bits, *extras

    def dpad(self) -> int:
        return _dpad(self._down())

    def profile(self) -> int:
        self._down()
        return 0

    def joystick_left(self) -> tuple[int, int]:
        return _stick(self._down(), "left", 100)

    def joystick_right(self) -> tuple[int, int]:
        return _stick(self._down(), "right", 100)

    def triggers(self) -> tuple[int, int]:
        down = self._down()
        return 100 * ("left_trigger" in down), 100 * ("right_trigger" in down)

    def rumble(
        self,
        power: Any = 100,
        duration: Any = 200,
        count: Any = 1,
        delay: Any = 100,
    ) -> Any:
        powers = power if isinstance(power, list | tuple) else (power,) * _RUMBLE_MOTORS
        if len(powers) != _RUMBLE_MOTORS:
            raise ValueError(f"expected 1 number or tuple of {_RUMBLE_MOTORS} values")
        # These are only checked, because nobody feels the rumble.
        for number in (duration, delay, count, *powers):
            get_int(number)
        return self._done()


def _raw_axis(value: int) -> int:
    """Position of a stick on one axis. The controller sends 0 to 65535, with 32767 for the middle:
    one more to one side than to the other."""
    return value + 1 if value == _STICK_MAX else value


def _stick(
    down: frozenset[str],
    side: str,
    limit: int,
) -> tuple[int, int]:
    """Position of a stick of the Xbox controller: to the right, and up."""
    # Opposite directions cancel out if they are pressed at the same time.
    left = f"joystick_{side}_left" in down
    right = f"joystick_{side}_right" in down
    back = f"joystick_{side}_down" in down
    ahead = f"joystick_{side}_up" in down
    return limit * (right - left), limit * (ahead - back)


def _dpad(down: frozenset[str]) -> int:
    """Direction of the pad: 0 for none, 1 for up, then clockwise."""
    x = ("right" in down) - ("left" in down)
    y = ("up" in down) - ("down" in down)
    numbers = {
        (0, 1): 1,
        (1, 1): 2,
        (1, 0): 3,
        (1, -1): 4,
        (0, -1): 5,
        (-1, -1): 6,
        (-1, 0): 7,
        (-1, 1): 8,
    }
    return numbers.get((x, y), 0)


class HubNetwork:
    """Network of hubs, of Pybricks 4.1, which is not played: neither the sources up to 4.1.0b2 nor
    the type stubs have it."""

    def __init__(
        self,
        *values: Any,
        **options: Any,
    ) -> None:
        raise NotImplementedError(
            "the virtual hub does not play HubNetwork; use BLERadio, or a real hub"
        )


def _payload(data: Any) -> bytes:
    """Bytes of text or bytes; unlike elsewhere, a bytearray is neither."""
    if not isinstance(data, str | bytes):
        raise TypeError(f"can't convert '{type(data).__name__}' object to str implicitly")
    return as_bytes(data)


def _scan(context: Context) -> Callable[..., Any]:
    """``bluetooth_scan``, for devices of classic Bluetooth."""
    machine = context.machine

    def bluetooth_scan(timeout: Any = 10_000, num_results: Any = 5) -> Any:
        get_exact_int(num_results)
        end_ms = machine.time_ms + get_exact_int(timeout)
        # No such device is ever near.
        return context.finish(lambda: machine.time_ms >= end_ms, list)

    return bluetooth_scan


def messaging_module(context: Context) -> ModuleType:
    console = context.console
    machine = context.machine

    class AppData:
        """A byte buffer besides the standard streams; the host overwrites it."""

        def __init__(self, modes: Any) -> None:
            context.assert_blocking()
            if console.inbox:
                raise RuntimeError("host rx_buffer already allocated")
            expect_type(get_array(modes), list)
            # A program gets slices of one buffer, in which all modes follow each other in the order
            # of their numbers.
            self._slices: dict[int, tuple[int, int]] = {}
            start = 0
            for pair in sorted(modes):
                if len(get_array(pair)) != 2 or get_exact_int(pair[0]) > 255:
                    raise TypeError("modes must be a list of (mode, size) tuples")
                mode = pair[0] & 0xFF
                size = get_exact_int(pair[1])
                if mode in self._slices:
                    raise ValueError("mode numbers must be unique")
                self._slices[mode] = (start, size)
                start += size
            console.inbox = bytearray(start)
            self.write_bytes(bytes((_SET_UP, *self._slices)))

        def get_bytes(
            self,
            mode: int,
            index: int | None = None,
        ) -> bytes | int:
            machine.charge_call()
            if get_exact_int(mode) not in self._slices:
                raise ValueError("invalid mode")
            start, size = self._slices[mode]
            if index is None:
                return bytes(console.inbox[start : start + size])
            if not 0 <= get_exact_int(index) < size:
                raise ValueError("index out of range")
            return console.inbox[start + index]

        def write_bytes(self, data: Any, /) -> Any:
            payload = _payload(data)
            expect(len(payload) <= _MAX_EVENT_BYTES)
            console.write_app_data(payload)
            return context.done()

        def configure(
            self,
            mode: Any,
            parameter: Any,
            value: Any,
        ) -> Any:
            mode_number = get_exact_int(mode) & 0xFF
            parameter_number = get_exact_int(parameter) & 0xFF
            header = bytes((_CONFIGURE, mode_number, parameter_number))
            return self.write_bytes(header + _payload(value))

        def close(self) -> None:
            console.inbox = bytearray()

    names: dict[str, Any] = {"AppData": AppData}
    if not machine.robot.hub.model.has_bluetooth:
        return module("messaging", names, _scan(context))
    names["BLERadio"] = bind(context, BLERadio)
    if machine.firmware.has_hub_network and machine.robot.hub.model.has_hub_network:
        names["HubNetwork"] = HubNetwork
    return module("messaging", names)
