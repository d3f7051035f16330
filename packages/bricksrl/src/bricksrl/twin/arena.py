"""Arenas, of `bricktwin.twin.arena`."""

from bricktwin.twin.arena import *
