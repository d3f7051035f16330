"""Commands, channels and interfaces, of `brickhub.hub.interface`."""

from brickhub.hub.interface import *
