"""Test server of the Hugging Face hub on 127.0.0.1, with the interface that sharing needs."""

from __future__ import annotations

import base64
import hashlib
import json
import re
import threading
from collections.abc import Iterator
from contextlib import contextmanager
from http.server import BaseHTTPRequestHandler, ThreadingHTTPServer
from typing import Any

TOKEN = "hf_known"  # noqa: S105


def _oid(data: bytes) -> str:
    return hashlib.sha256(data).hexdigest()[:40]


class Hub(ThreadingHTTPServer):
    daemon_threads = True

    def __init__(self) -> None:
        super().__init__(("127.0.0.1", 0), _Handler)
        self.files: dict[str, dict[str, bytes]] = {}
        self.tags: list[str] = []

    @property
    def address(self) -> str:
        return f"http://127.0.0.1:{self.server_address[1]}"


class _Handler(BaseHTTPRequestHandler):
    server: Hub

    def log_message(self, format: str, *args: object) -> None:  # noqa: A002
        pass

    def answer(self, value: Any, status: int = 200, **headers: str) -> None:
        data = value if isinstance(value, bytes) else json.dumps(value).encode()
        self.send_response(status)
        for name, text in {
            "Content-Length": str(len(data)),
            "X-Repo-Commit": "0" * 40,
            **headers,
        }.items():
            self.send_header(name.replace("_", "-"), text)
        self.end_headers()
        if self.command != "HEAD":
            self.wfile.write(data)

    def do_POST(self) -> None:
        body = self.rfile.read(int(self.headers.get("Content-Length", 0)))
        if self.headers.get("Authorization") != f"Bearer {TOKEN}":
            self.answer({"error": "who are you"}, 401)
        elif self.path == "/api/validate-yaml":
            self.answer({"errors": [], "warnings": []})
        elif self.path == "/api/repos/create":
            wanted = json.loads(body)
            repo = f"{wanted.get('type', 'model')}s/{wanted['organization']}/{wanted['name']}"
            self.server.files.setdefault(repo, {})
            self.answer({"url": f"{self.server.address}/{repo}"})
        elif found := re.match(r"/api/(\w+/[^/]+/[^/]+)/(preupload|commit|tag)/", self.path):
            getattr(self, found[2])(found[1], body)
        else:
            self.answer({}, 404)

    def preupload(self, repo: str, body: bytes) -> None:
        names = [file["path"] for file in json.loads(body)["files"]]
        self.answer(
            {
                "files": [
                    {"path": name, "uploadMode": "regular", "shouldIgnore": False} for name in names
                ]
            }
        )

    def commit(self, repo: str, body: bytes) -> None:
        for line in body.decode().splitlines():
            entry = json.loads(line)
            if entry["key"] == "file":
                self.server.files[repo][entry["value"]["path"]] = base64.b64decode(
                    entry["value"]["content"]
                )
        self.answer(
            {
                "commitUrl": f"{self.server.address}/{repo}/commit/{'0' * 40}",
                "commitOid": "0" * 40,
                "pullRequestUrl": None,
            }
        )

    def tag(self, repo: str, body: bytes) -> None:
        self.server.tags.append(json.loads(body)["tag"])
        self.answer({})

    def do_GET(self) -> None:
        path = self.path.partition("?")[0]
        if found := re.match(r"/api/(\w+/[^/]+/[^/]+)(?:/(revision|tree)/.*)?$", path):
            files = self.server.files.get(found[1])
            if files is None:
                self.answer({"error": "Repository not found"}, 404, X_Error_Code="RepoNotFound")
            elif found[2] == "tree":
                entries = [
                    {"type": "file", "path": name, "size": len(d), "oid": _oid(d)}
                    for name, d in files.items()
                ]
                self.answer(entries)
            else:
                name = found[1].partition("/")[2]
                siblings = [{"rfilename": file} for file in files]
                self.answer(
                    {
                        "id": name,
                        "modelId": name,
                        "sha": "0" * 40,
                        "siblings": siblings,
                        "private": False,
                        "tags": [],
                    }
                )
        elif found := re.match(r"/(?:(datasets)/)?([^/]+/[^/]+)/resolve/[^/]+/(.+)$", path):
            data = self.server.files.get(f"{found[1] or 'models'}/{found[2]}", {}).get(found[3])
            if data is None:
                self.answer({}, 404, X_Error_Code="EntryNotFound")
            else:
                self.answer(data, ETag=f'"{_oid(data)}"')
        else:
            self.answer({}, 404)

    do_HEAD = do_GET  # noqa: N815


@contextmanager
def serving() -> Iterator[Hub]:
    """An initially empty hub."""
    with Hub() as hub:
        thread = threading.Thread(target=hub.serve_forever, kwargs={"poll_interval": 0.05})
        thread.start()
        try:
            yield hub
        finally:
            hub.shutdown()
            thread.join()
