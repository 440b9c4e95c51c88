#!/usr/bin/env python3
"""Measures reading over slow links that break: python tests/bench/slow_links.py [options] FILE.lodpack

A server of its own gives every answer after a delay, sends all answers together at a rate, and breaks a share of them
off at a random byte. `lodpack extract ADDRESS` (Rust) reads the finest level from it, and `FetchSource` (JavaScript, in
Node) the whole file. The ideal is the time that the same program takes without breaks and at any rate, which counts its
delays, and that of the bytes that it then reads, at the rate. Prints Markdown: the time over the ideal, the bytes that
were sent over those needed, and how many answers were broken off. Random numbers have a fixed seed.
"""

import argparse
import pathlib
import random
import re
import socketserver
import subprocess
import sys
import threading
import time
from http.server import BaseHTTPRequestHandler

ROOT = pathlib.Path(__file__).resolve().parents[2]
# Bytes that are sent at once, and the share of a second that they may take.
PIECE, TICK = 4096, 0.05
SCRIPT = """
import { FetchSource } from '%s';
const [url, size] = process.argv.slice(1);
const source = new FetchSource(url);
for (let at = 0; at < Number(size); at += 16 << 20) {
  const { data } = await source.getBytes(at, Math.min(16 << 20, Number(size) - at));
  if (data.byteLength === 0) throw new Error('nothing came');
}
"""


class Link:
    """What all connections share."""

    def __init__(self, delay, rate, broken, seed):
        self.delay, self.rate, self.broken = delay, rate, broken
        self.random, self.lock = random.Random(seed), threading.Lock()
        self.free_at, self.sent, self.breaks, self.answers = 0.0, 0, 0, 0

    def send(self, out, piece):
        """Sends a piece when its turn comes."""
        with self.lock:
            now = time.monotonic()
            self.free_at = max(self.free_at, now - TICK) + (len(piece) / self.rate if self.rate else 0)
            wait = self.free_at - now
            self.sent += len(piece)
        if wait > 0:
            time.sleep(wait)
        out.write(piece)
        out.flush()

    def breaks_at(self, length):
        """Where an answer ends too early; none for most."""
        with self.lock:
            self.answers += 1
            if self.random.random() >= self.broken:
                return None
            self.breaks += 1
            return self.random.randrange(length)


class Handler(BaseHTTPRequestHandler):
    protocol_version = "HTTP/1.1"
    content, link = b"", None

    def do_HEAD(self):
        self.answer(with_body=False)

    def do_GET(self):
        self.answer(with_body=True)

    def answer(self, with_body):
        time.sleep(self.link.delay)
        asked = re.fullmatch(r"bytes=(\d+)-(\d+)", self.headers.get("Range", ""))
        first, last = map(int, asked.groups()) if asked else (0, len(self.content) - 1)
        body = self.content[first : last + 1]
        self.send_response(206 if asked else 200)
        self.send_header("ETag", '"1"')
        self.send_header("Content-Length", str(len(body)))
        if asked:
            self.send_header("Content-Range", f"bytes {first}-{first + len(body) - 1}/{len(self.content)}")
        self.end_headers()
        if not with_body:
            return
        end = self.link.breaks_at(len(body))
        body = body if end is None else body[:end]
        try:
            for at in range(0, len(body), PIECE):
                self.link.send(self.wfile, body[at : at + PIECE])
        except OSError:
            end = 0
        self.close_connection = end is not None

    def log_message(self, *_):
        pass


class Server(socketserver.ThreadingMixIn, socketserver.TCPServer):
    allow_reuse_address, daemon_threads = True, True

    def handle_error(self, request, client_address):
        pass


def measure(command, content, delay, rate, broken, seed):
    """Seconds, and the link afterwards."""
    link = Link(delay, rate, broken, seed)
    with Server(("127.0.0.1", 0), type("Bound", (Handler,), {"content": content, "link": link})) as server:
        threading.Thread(target=server.serve_forever, daemon=True).start()
        started = time.monotonic()
        done = subprocess.run(command(f"http://127.0.0.1:{server.server_address[1]}/file.lodpack"), capture_output=True, text=True)
        seconds = time.monotonic() - started
        server.shutdown()
    return (seconds if done.returncode == 0 else None), link, done.stderr.strip().splitlines()[-1:]


def main():
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("file", type=pathlib.Path)
    parser.add_argument("--lodpack", type=pathlib.Path, default=ROOT / "target/release/lodpack")
    parser.add_argument("--delay", type=float, default=2.0)
    parser.add_argument("--broken", type=float, default=0.05)
    parser.add_argument("--rates", default="10000,1000,300,100,30", help="kB/s")
    parser.add_argument("--seeds", type=int, default=3)
    options = parser.parse_args()
    content = options.file.read_bytes()
    script = SCRIPT % (ROOT / "reader/wasm/js/source.js").as_uri()
    readers = {
        "lodpack extract": lambda url: [options.lodpack.resolve(), "extract", url, "-o", "/dev/null", "--format", "ply", "--force"],
        "FetchSource": lambda url: ["node", "--input-type=module", "-e", script, "--", url, str(len(content))],
    }
    print(f"{len(content):,} bytes, {options.delay} s delay, {options.broken:.0%} of answers broken off\n")
    print("| reader | rate | breaks | ideal | time | over the ideal | bytes over those needed |")
    print("|---|---:|---:|---:|---:|---:|---:|")
    for name, command in readers.items():
        base, needed, problem = measure(command, content, options.delay, 0, 0, 0)
        if base is None:
            sys.exit(f"{name}: {problem}")
        for rate in (float(rate) * 1000 for rate in options.rates.split(",")):
            for seed in range(options.seeds):
                seconds, link, problem = measure(command, content, options.delay, rate, options.broken, seed)
                ideal = base + needed.sent / rate
                shown = f"{seconds:.1f} s | {seconds / ideal:.2f}" if seconds else f"{problem} | -"
                print(f"| {name} | {rate / 1000:,.0f} kB/s | {link.breaks} of {link.answers} | {ideal:.1f} s | {shown} | {link.sent / needed.sent:.3f} |", flush=True)


if __name__ == "__main__":
    main()
