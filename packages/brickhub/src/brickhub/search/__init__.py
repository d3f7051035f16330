"""Policy search: a few numbers of a structured policy, tried on a robot; pure Python, for a
computer and a browser's tab alike."""
