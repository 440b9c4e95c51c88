#!/usr/bin/env python3
"""Measures reading over slow links that break: python tests/bench/slow_links.py [options] FILE.lodpack

A server of its own gives every answer after a delay, sends all answers together at a rate, and breaks a share of them
off at a random byte, long ones once more for each 64 KiB. `lodpack extract`, `verify` and `info` (Rust) read the finest
level, everything and the index from it, and `FetchSource` (JavaScript, in Node) the whole file. The ideal is the time
that the same program takes without breaks and at any rate, which counts its delays, and that of the bytes that it then
reads, at the rate; an answer that is broken off costs one more delay. Prints Markdown: the time over the ideal, the
bytes that were sent over those needed, and how many answers were broken off. Random numbers have a fixed seed.
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
# 10 MB/s to 30 kB/s, then with delays, then with breaks.
LINKS = "10000:0:0,300:0:0,30:0:0,1000:2:0,300:2:0,1000:0:0.05,300:2:0.05,30:2:0.05"
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
            for at in range(0, length, 1 << 16):
                if self.random.random() < self.broken:
                    self.breaks += 1
                    return self.random.randrange(at, min(length, at + (1 << 16)))
        return None


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
    parser.add_argument("--links", default=LINKS, help="kB/s:seconds of delay:share that breaks, separated by commas")
    parser.add_argument("--only", default="extract,verify,info,FetchSource", help="the readers")
    parser.add_argument("--seeds", type=int, default=3, help="repetitions of links that break")
    options = parser.parse_args()
    content = options.file.read_bytes()
    script = SCRIPT % (ROOT / "reader/wasm/js/source.js").as_uri()
    lodpack = str(options.lodpack.resolve())
    readers = {
        "extract": lambda url: [lodpack, "extract", url, "-o", "/dev/null", "--format", "ply", "--force"],
        "verify": lambda url: [lodpack, "verify", url],
        "info": lambda url: [lodpack, "info", url],
        "FetchSource": lambda url: ["node", "--input-type=module", "-e", script, "--", url, str(len(content))],
    }
    print(f"{len(content):,} bytes\n")
    print("| reader | rate | delay | breaks | ideal | time | over the ideal | bytes over those needed |")
    print("|---|---:|---:|---:|---:|---:|---:|---:|")
    links = [tuple(map(float, link.split(":"))) for link in options.links.split(",")]
    for name in options.only.split(","):
        command, needs = readers[name], {}
        for rate, delay, broken in links:
            if delay not in needs:
                needs[delay] = measure(command, content, delay, 0, 0, 0)
            base, needed, problem = needs[delay]
            if base is None:
                sys.exit(f"{name}: {problem}")
            for seed in range(options.seeds if broken else 1):
                seconds, link, problem = measure(command, content, delay, 1000 * rate, broken, seed)
                ideal = base + needed.sent / (1000 * rate) + link.breaks * delay
                shown = f"{seconds:.1f} s | {seconds / ideal:.2f}" if seconds else f"{problem} | -"
                breaks = f"{link.breaks} of {link.answers}"
                print(f"| {name} | {rate:,.0f} kB/s | {delay:g} s | {breaks} | {ideal:.1f} s | {shown} | {link.sent / needed.sent:.3f} |", flush=True)


if __name__ == "__main__":
    main()
