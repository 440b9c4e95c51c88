"""Small web servers on loopback, and the files that the tests read."""

from __future__ import annotations

import contextlib
import os
import pathlib
import re
import threading
from collections.abc import Iterator
from http.server import BaseHTTPRequestHandler, ThreadingHTTPServer

PACKAGE = pathlib.Path(__file__).resolve().parent.parent
VECTORS = PACKAGE.parent.parent / "format-spec" / "vectors"
# Roots of both fillings, groups, and four levels.
SMALL = VECTORS / "tree.lodpack"
if "LODPACK_TEST_SCAN" not in os.environ:
    raise SystemExit("set LODPACK_TEST_SCAN to a lodpack file of several levels, such as one of tests/data/snowden.ply")
# A scan of several levels, which whoever runs the tests has built.
SCAN = pathlib.Path(os.environ["LODPACK_TEST_SCAN"])
# The same on nginx, where whoever runs the tests has started it.
SCAN_URL = os.environ.get("LODPACK_SCAN_URL")


class Files(BaseHTTPRequestHandler):
    """Answers every request with a range of one file."""

    content: bytes
    ranges_work = True
    requests: list[str]
    protocol_version = "HTTP/1.1"

    def do_HEAD(self) -> None:
        self._answer(with_body=False)

    def do_GET(self) -> None:
        self._answer(with_body=True)

    def _answer(self, with_body: bool) -> None:
        asked = re.fullmatch(r"bytes=(\d+)-(\d+)", self.headers.get("Range", ""))
        self.requests.append(self.headers.get("Range", ""))
        body, size = self.content, len(self.content)
        if asked and self.ranges_work:
            first, last = int(asked[1]), min(int(asked[2]), size - 1)
            body = body[first : last + 1]
            self.send_response(206)
            self.send_header("Content-Range", f"bytes {first}-{last}/{size}")
        else:
            self.send_response(200)
        self.send_header("Accept-Ranges", "bytes" if self.ranges_work else "none")
        self.send_header("Content-Length", str(len(body)))
        self.end_headers()
        if with_body:
            self.wfile.write(body)

    def handle(self) -> None:
        # A client may leave at any time.
        with contextlib.suppress(ConnectionError):
            super().handle()

    def log_message(self, *_: object) -> None:
        pass


@contextlib.contextmanager
def served(content: bytes, *, ranges_work: bool = True) -> Iterator[tuple[str, list[str]]]:
    """Serves a file; gives its address and the list of ranges that are asked for."""
    requests: list[str] = []
    handler = type("Handler", (Files,), {"content": content, "ranges_work": ranges_work, "requests": requests})
    server = ThreadingHTTPServer(("127.0.0.1", 0), handler)
    server.daemon_threads = True
    threading.Thread(target=server.serve_forever, daemon=True).start()
    try:
        yield f"http://127.0.0.1:{server.server_port}/scan.lodpack", requests
    finally:
        server.shutdown()
        server.server_close()


@contextlib.contextmanager
def served_scan() -> Iterator[str]:
    """Gives an address of the scan: nginx's, or that of a server that sees to it that only ranges are asked for."""
    if SCAN_URL:
        yield SCAN_URL
        return
    with served(SCAN.read_bytes()) as (url, requests):
        yield url
    assert requests and all(requests), "not only ranges are asked for"
