"""LEGO's motors in the twins: curves of the data sheets, current limit."""

from __future__ import annotations

import pytest

from brickhub.robot import HubKind, Motor, MotorKind, Robot
from bricktwin.robots import TWO_WHEELER
from bricktwin.twin.models.motors import LIMIT_A, RAD_S_PER_RPM, SHEET_V, SHEETS, motor_constants
from bricktwin.twin.mujoco_body import MujocoBody
from bricktwin.twin.physics import Physics
from bricktwin.twin.scene import OPEN_FLOOR

LEGO = {  # free rpm; loaded rpm at Ncm; stall Ncm, at 7.2 V
    MotorKind.SPIKE_MEDIUM: (185, (135, 3.5), 18),
    MotorKind.TECHNIC_M_ANGULAR: (185, (135, 3.5), 18),
    MotorKind.SPIKE_LARGE: (175, (135, 8), 25),
    MotorKind.TECHNIC_L_ANGULAR: (175, (135, 8), 25),
}


@pytest.mark.parametrize("kind", LEGO)
def test_the_curve_meets_the_sheet_within_6_percent(kind: MotorKind) -> None:
    motor, (free_rpm, (loaded_rpm, load_ncm), stall_ncm) = motor_constants(kind), LEGO[kind]
    stall_nm = motor.torque_nm_v * SHEET_V - motor.friction_nm
    assert 100 * stall_nm == pytest.approx(stall_ncm, rel=0.06)
    assert stall_nm / motor.drag_nm_s / RAD_S_PER_RPM == pytest.approx(free_rpm, rel=0.06)
    assert (stall_nm - load_ncm / 100) / motor.drag_nm_s / RAD_S_PER_RPM == pytest.approx(
        loaded_rpm, rel=0.06
    )


@pytest.mark.parametrize("sheet", SHEETS.values())
def test_the_line_misses_all_three_points_by_the_same_share(sheet) -> None:
    free_rad_s, stall_nm = sheet.line()
    loaded = free_rad_s * (1 - sheet.load_nm / stall_nm) / RAD_S_PER_RPM / sheet.loaded_rpm
    assert (
        free_rad_s / RAD_S_PER_RPM / sheet.free_rpm
        == pytest.approx(stall_nm / sheet.stall_nm)
        == pytest.approx(2 - loaded)
    )


def test_resistances_are_those_of_pybricks_curves() -> None:
    """7.2 V by the current of a blocked shaft, from the firmware's own rows: 0.395 A, 0.958 A,
    0.861 A."""
    for kind, stall_a in (
        (MotorKind.INTERACTIVE, 0.395),
        (MotorKind.TECHNIC_L, 0.958),
        (MotorKind.MOVE_HUB, 0.861),
    ):
        assert motor_constants(kind).ohm == pytest.approx(7.2 / stall_a, rel=0.002)


def test_no_port_gives_more_than_its_current() -> None:
    """A large motor that is reversed at full speed would draw twice its current at a stall."""
    robot = Robot(
        "strong",
        HubKind.PRIME,
        motors=tuple(
            Motor(motor.name, motor.port, MotorKind.SPIKE_LARGE, motor.direction)
            for motor in TWO_WHEELER.motors
        ),
        drive_base=TWO_WHEELER.drive_base,
    )
    body, port = MujocoBody(robot, OPEN_FLOOR, Physics(), 0), robot.motors[0].port
    body.model.opt.gravity[:], body.data.qpos[2] = 0.0, 1.0
    body.set_voltage(port, 8000)
    body.advance_to(1000)
    body.set_voltage(port, -8000)
    body.advance_to(1005)
    torque_nm = LIMIT_A * motor_constants(MotorKind.SPIKE_LARGE).torque_nm_a
    assert body.data.actuator_force[body.actuator(port)] == pytest.approx(-torque_nm)
