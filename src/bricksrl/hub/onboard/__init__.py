"""MicroPython sources that run on the hub. ``program.py`` reads them as text; nothing on the host imports them."""
