"""Objects of scenes, of `bricktwin.twin.objects`."""

from bricktwin.twin.objects import *
