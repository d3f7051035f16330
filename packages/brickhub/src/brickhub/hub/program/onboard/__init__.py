"""MicroPython sources that run on the hub. ``generate.py`` reads them as text; nothing on the host
imports them."""
