"""Scenes, of `bricktwin.twin.scene`."""

from bricktwin.twin.scene import *
