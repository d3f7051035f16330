"""Starter for a stick or one's own computer: serves this folder to the browsers of this computer.

python serve.py
"""

import contextlib
import functools
import http.server
import sys
import webbrowser
from pathlib import Path

FOLDER = Path(__file__).resolve().parent
# As some systems know no type of JavaScript, and browsers insist on it.
TYPES = {".js": "text/javascript", ".mjs": "text/javascript", ".json": "application/json"}


class Handler(http.server.SimpleHTTPRequestHandler):
    """Plain files, and what lets a page share memory with its worker."""

    def guess_type(self, path):
        return TYPES.get(Path(path).suffix) or super().guess_type(path)

    def end_headers(self):
        # The folder may have another version at the next start.
        self.send_header("Cache-Control", "no-cache")
        self.send_header("Cross-Origin-Opener-Policy", "same-origin")
        self.send_header("Cross-Origin-Embedder-Policy", "require-corp")
        super().end_headers()

    def log_message(self, *arguments):
        """Say nothing: who started it has the page to look at."""


def main():
    words = sys.argv[1:]
    ports = [int(word) for word in words if word.isdigit()]
    handler = functools.partial(Handler, directory=FOLDER)
    # Port 0 lets the system choose a free one.
    port = ports[0] if ports else 0
    try:
        server = http.server.ThreadingHTTPServer(("127.0.0.1", port), handler)
    except (OSError, OverflowError) as error:
        sys.exit(f"error: port {port} cannot be used ({error}); name another one, or none")
    address = f"http://127.0.0.1:{server.server_address[1]}/"
    print(address, flush=True)
    if "--no-browser" not in words:
        webbrowser.open(address)
    with contextlib.suppress(KeyboardInterrupt):
        server.serve_forever()


if __name__ == "__main__":
    main()
