"""End of a running program that comes from its host: Ctrl-C, a time limit, output that cannot be written."""


class HostStop(BaseException):
    """Ends a program past its exception handlers and reaches the caller; derive the host's own ends from it. Whatever else is
    raised while a program runs is an error of the program, but for a failing scene and a film that cannot be written."""
