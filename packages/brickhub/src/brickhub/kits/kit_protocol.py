"""Protocol of LEGO's kits of 2026: messages of Double Motor, Single Motor, Color Sensor and
Controller as bytes, and back.

A message is a byte with its number, and packed little-endian fields. A packet to a device holds
several messages; a device sends one at a time, whose number is that of the command plus 1, or a
notification, which holds several reports. Facts read in version 1.2.0 of LEGO's package
``legoeducation`` (RPC 2.3.0), which is BUSL-1.1; the code is our own. What LEGO publishes nowhere
is estimated, as docs/kits.md tells.
"""

import enum
import struct
from collections.abc import Iterable, Iterator
from dataclasses import dataclass

from brickhub.errors import HubProtocolError

RPC_VERSION = (2, 3, 0)
"""Version of the protocol: major and minor must be those of LEGO's package."""
NOTIFICATION = 60
"""Number of a message with the reports of a device."""
FULL_SPEED_DEG_S = 1000
"""Speed of 100 %."""
SUPERVISION_S = 24.0
"""Silence after which a device takes its link for lost: a comment in LEGO's package names it, for
the device's side."""


class Product(enum.IntEnum):
    """Devices, by the number that they advertise."""

    SINGLE_MOTOR = 512
    DOUBLE_MOTOR = 513
    COLOR_SENSOR = 514
    CONTROLLER = 515

    @property
    def title(self) -> str:
        """Name on its box, and in its advertisement."""
        return self.name.replace("_", " ").title()


class Done(enum.IntEnum):
    """Outcome of a command."""

    COMPLETED = 0
    INTERRUPTED = 1
    REFUSED = 2


class MotorState(enum.IntEnum):
    """States of a motor, as far as a virtual one tells them."""

    READY = 0
    RUNNING = 1
    STALLED = 2
    HOLDING = 6
    DUTY = 7


FACES = ("up", "ahead", "right", "down", "back", "left")
"""Faces of a Double Motor in the order of their numbers, as the sides of a robot on which it lies
flat."""
NO_COLOR = -1
"""Number of no color; those of the others are LEGO's usual ones, 0 (black) to 10 (white)."""


@dataclass(frozen=True)
class Layout:
    """Kind of a message or report: its number, the ``struct`` of its number and its fields, and
    their names."""

    number: int
    struct: struct.Struct
    fields: tuple[str, ...]


def _layouts(text: str) -> dict[str, Layout]:
    layouts = {}
    for line in text.strip().splitlines():
        name, number, types, *fields = line.split()
        # A message without fields has a hyphen in place of their types.
        types = types.strip("-")
        layouts[name] = Layout(int(number), struct.Struct(f"<B{types}"), tuple(fields))
    return layouts


COMMANDS = _layouts("""
    info                  0   -
    uuid                  26  -
    program_flow          32  B    action
    notifications         40  H    delay_ms
    light                 110 bBB  color pattern intensity
    beep                  112 BHB  pattern frequency repetitions
    stop_sound            114 -
    reset_position        120 Bi   motors position
    run                   122 BB   motors direction
    run_for_degrees       124 BiB  motors degrees direction
    run_for_time          126 BIB  motors time_ms direction
    run_to_absolute       128 BHB  motors position direction
    run_to_relative       130 Bi   motors position
    set_duty              132 Bh   motors duty
    stop                  138 B    motors
    set_speed             140 Bb   motors speed
    set_end_state         142 Bb   motors end_state
    set_acceleration      144 BBB  motors acceleration deceleration
    move                  150 B    direction
    move_for_time         152 IB   time_ms direction
    move_for_degrees      154 iB   degrees direction
    tank                  156 bb   left right
    tank_for_degrees      158 ibb  degrees left right
    turn_for_degrees      160 iB   degrees direction
    stop_moving           168 -
    set_move_speed        170 b    speed
    set_move_end_state    172 b    end_state
    set_move_acceleration 174 BB   acceleration deceleration
    set_steering          176 B    steering
    set_yaw_face          190 B    face
    reset_yaw             192 h    yaw
    set_color_mode        200 b    mode
""")
"""Commands by our names for them. Those with ``motors`` are of single motors, a bit each, and so
are their answers."""
REPORTS = _layouts("""
    info       0  BB         battery_pct usb
    imu        1  BBhhhhhhhhh face yaw_face yaw pitch roll ax ay az gx gy gz
    card       3  bH         color serial
    button     4  B          is_pressed
    motor      10 BBHhbib    motors state absolute power speed position gesture
    color      12 bBHHHHBBb  color reflection red green blue hue saturation value mode
    controller 15 bbhh       left_pct right_pct left_deg right_deg
    gesture    16 b          gesture
""")
"""Reports in a notification."""
_INFO = "BBHBBHBBHHH"
"""Fields of the answer to ``info``: three versions, the largest packet, the product."""
_BY_NUMBER = {layout.number: (name, layout) for name, layout in COMMANDS.items()}


@dataclass(frozen=True)
class Message:
    """One command to a device: its name in :data:`COMMANDS`, its fields by name, and the number of
    the answer to it."""

    name: str
    values: dict[str, int]
    answer_number: int


def decode(packet: bytes) -> Iterator[Message]:
    """The commands in a packet, in order. Raises HubProtocolError if a message is unknown or cut
    off."""
    # Messages are read one after the other, because only its number tells where a message ends.
    while packet:
        name, layout = _BY_NUMBER.get(packet[0], ("", None))
        if layout is None or len(packet) < layout.struct.size:
            raise HubProtocolError(
                f"message {packet.hex()} of LEGO's kits is unknown or cut off; update brickhub"
            )
        number, *fields = layout.struct.unpack_from(packet)
        yield Message(name, dict(zip(layout.fields, fields, strict=True)), number + 1)
        packet = packet[layout.struct.size :]


def encode_info(product: Product, packet_bytes: int = 244) -> bytes:
    """Answer to ``info``: versions of protocol, firmware and bootloader, the largest packet, and
    the product."""
    number = COMMANDS["info"].number + 1
    firmware = (1, 0, 0)
    bootloader = (1, 0, 0)
    return struct.pack(
        f"<B{_INFO}",
        number,
        *RPC_VERSION,
        *firmware,
        *bootloader,
        packet_bytes,
        product,
    )


def encode_answer(
    number: int,
    status: int,
    motors: int | None = None,
) -> bytes:
    """Answer of a command that ended, with its motors if it has any."""
    return bytes((number, status) if motors is None else (number, motors, status))


def encode_notification(reports: Iterable[tuple[str, tuple[int, ...]]]) -> bytes:
    """Notification with some reports, each a name in :data:`REPORTS` and its fields in order."""
    body = b"".join(
        REPORTS[name].struct.pack(REPORTS[name].number, *values) for name, values in reports
    )
    return struct.pack("<BH", NOTIFICATION, len(body)) + body
