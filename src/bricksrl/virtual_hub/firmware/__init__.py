"""The firmware's motor control in Python: how a Pybricks hub turns commands into motor voltages.

Written from the behaviour of the firmware's control library (pbio, Pybricks v4; trajectories, PID with
anti-windup, state observer, drive base). It computes with the same integer units and truncations, because the
rounding decides on which 5 ms tick a move is over. Units inside: position mdeg, speed mdeg/s, acceleration
mdeg/s2, torque uNm, voltage mV, time in ticks of 0.1 ms. ``trunc(a / b)`` is C's division, exact below 2**53 (and
computed faster than ``int(a / b)``).
"""
