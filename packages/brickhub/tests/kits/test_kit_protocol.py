"""Messages of LEGO's kits: bytes and back, and the same bytes as LEGO's own package."""

from __future__ import annotations

import struct

import pytest
from hypothesis import given
from hypothesis import strategies as st
from kit_world import encode, reports_in

from brickhub.errors import HubProtocolError
from brickhub.kits.kit_protocol import (
    COMMANDS,
    REPORTS,
    RPC_VERSION,
    Layout,
    Message,
    Product,
    decode,
    encode_info,
    encode_notification,
)

_LEGO_NAMES = {
    "run_for_degrees": "MotorRunForDegreesCommand",
    "run_for_time": "MotorRunForTimeCommand",
    "run_to_absolute": "MotorRunToAbsolutePositionCommand",
    "run_to_relative": "MotorRunToRelativePositionCommand",
    "reset_position": "MotorResetRelativePositionCommand",
    "run": "MotorRunCommand",
    "set_duty": "MotorSetDutyCycleCommand",
    "stop": "MotorStopCommand",
    "set_speed": "MotorSetSpeedCommand",
    "set_end_state": "MotorSetEndStateCommand",
    "set_acceleration": "MotorSetAccelerationCommand",
    "move": "MovementMoveCommand",
    "move_for_time": "MovementMoveForTimeCommand",
    "move_for_degrees": "MovementMoveForDegreesCommand",
    "tank": "MovementMoveTankCommand",
    "tank_for_degrees": "MovementMoveTankForDegreesCommand",
    "turn_for_degrees": "MovementTurnForDegreesCommand",
    "stop_moving": "MovementStopCommand",
    "set_move_speed": "MovementSetSpeedCommand",
    "set_move_end_state": "MovementSetEndStateCommand",
    "set_move_acceleration": "MovementSetAccelerationCommand",
    "set_steering": "MovementSetTurnSteeringCommand",
    "set_yaw_face": "ImuSetYawFaceCommand",
    "reset_yaw": "ImuResetYawAxisCommand",
    "set_color_mode": "SetColorSensorModeRequest",
    "info": "InfoRequest",
    "uuid": "DeviceUuidRequest",
    "program_flow": "ProgramFlowNotification",
    "notifications": "DeviceNotificationRequest",
    "light": "LightColorCommand",
    "beep": "PlayBeepCommand",
    "stop_sound": "StopSoundCommand",
}
_LEGO_REPORTS = {
    "info": "InfoDeviceNotification",
    "imu": "ImuDeviceNotification",
    "card": "CardNotification",
    "button": "ButtonStateNotification",
    "motor": "MotorNotification",
    "color": "ColorSensorNotification",
    "controller": "ControllerNotification",
    "gesture": "ImuGestureNotification",
}


def _fields(layout: Layout) -> st.SearchStrategy[tuple[int, ...]]:
    """Values of all fields."""
    ranges = []
    for letter in layout.struct.format[2:]:
        bits = 8 * struct.calcsize("<" + letter)
        low, high = (
            (0, 2**bits - 1) if letter.isupper() else (-(2 ** (bits - 1)), 2 ** (bits - 1) - 1)
        )
        ranges.append(st.integers(low, high))
    return st.tuples(*ranges)


_message = st.sampled_from(list(COMMANDS)).flatmap(
    lambda name: st.tuples(st.just(name), _fields(COMMANDS[name]))
)
_report = st.sampled_from(list(REPORTS)).flatmap(
    lambda name: st.tuples(st.just(name), _fields(REPORTS[name]))
)


@given(st.lists(_message, max_size=6))
def test_several_commands_travel_in_a_packet(messages: list[tuple[str, tuple[int, ...]]]) -> None:
    packet = b"".join(encode(name, *values) for name, values in messages)
    named = [
        (name, dict(zip(COMMANDS[name].fields, values, strict=True))) for name, values in messages
    ]
    assert list(decode(packet)) == [
        Message(name, values, COMMANDS[name].number + 1) for name, values in named
    ]


@given(st.lists(_report, max_size=6))
def test_several_reports_travel_in_a_notification(
    reports: list[tuple[str, tuple[int, ...]]],
) -> None:
    found = reports_in(encode_notification(reports))
    assert [(name, tuple(values.values())) for name, values in found] == reports


@pytest.mark.parametrize("packet", [b"\xff", encode("run", 1, 0)[:-1], encode("info") + b"\x05"])
def test_unknown_or_cut_off_message_is_an_error(packet: bytes) -> None:
    with pytest.raises(HubProtocolError):
        list(decode(packet))


@given(_message)
def test_commands_are_those_of_legos_package(message: tuple[str, tuple[int, ...]]) -> None:
    rpc = pytest.importorskip("legoeducation.rpc_message")
    name, values = message
    assert bytes(getattr(rpc, _LEGO_NAMES[name])(*values).Serialize()) == encode(name, *values)
    assert RPC_VERSION == rpc.RPC_VERSION


@given(st.lists(_report, max_size=6))
def test_legos_package_reads_our_reports(reports: list[tuple[str, tuple[int, ...]]]) -> None:
    rpc = pytest.importorskip("legoeducation.rpc_message")
    found = rpc.device_notification_parser(
        rpc.DeviceNotification.Deserialize(encode_notification(reports)[1:])
    )
    seen = [
        (type(item).__name__, tuple(value for key, value in vars(item).items() if key != "header"))
        for item in found
    ]
    assert seen == [(_LEGO_REPORTS[name], values) for name, values in reports]


def test_legos_package_reads_our_info() -> None:
    rpc = pytest.importorskip("legoeducation.rpc_message")
    info = rpc.InfoResponse.Deserialize(encode_info(Product.DOUBLE_MOTOR)[1:])
    assert (info.rpcMajor, info.rpcMinor, info.productGroupDevice) == (*rpc.RPC_VERSION[:2], 513)
