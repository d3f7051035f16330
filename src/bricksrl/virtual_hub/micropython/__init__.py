"""The language of a hub on CPython: 32-bit floats, 31-bit integers, its builtins, modules, texts and error messages.

Facts: MicroPython 1.26 as Pybricks 4 configures it (single precision, no long integers, no CPython compatibility).
"""
