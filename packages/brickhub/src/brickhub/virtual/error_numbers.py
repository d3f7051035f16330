"""Error numbers of a hub: those of MicroPython's ``py/mperrno.h``, on every computer.

Python's module ``errno`` has the numbers of the system that it runs on. Those of Linux are the same
as a hub's; macOS, Windows and a browser's tab have others.
"""

EPERM = 1
ENOENT = 2
EIO = 5
EAGAIN = 11
EBUSY = 16
ENODEV = 19
EINVAL = 22
EOPNOTSUPP = 95
ETIMEDOUT = 110
ECANCELED = 125
