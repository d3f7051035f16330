"""Physics of virtual robots, of `bricktwin.twin.physics`."""

from bricktwin.twin.physics import *
