"""MicroPython on CPython: 32-bit floats, 31-bit integers, builtins, modules, texts and error
messages of a hub.

Reference: MicroPython 1.26 as configured by Pybricks 4 (single precision, no long integers, no
CPython compatibility).
"""
