"""Formulas of structured policies, as a hub and this computer calculate them: what is below the
line "the hub's part" of a file is Python and MicroPython alike, and becomes a part of hub
programs."""
