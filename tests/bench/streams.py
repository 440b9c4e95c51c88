#!/usr/bin/env python3
"""Measures what it takes to draw files from disk, from a web server (nginx) and from an S3 server (moto); prints Markdown.

usage: streams.py [--nginx PROGRAM] [--share PERCENT] FILE.lodpack...

Per file and source: the coarsest cut of everything, opening included (the first picture; a file with an overview has one after
the first request already), and a column through the middle of the model, at the finest level and at ten times its error.
Requests and bytes are those that `lodpack extract --json` counts; for nginx the server's own log is counted too, headers included.

Needs `cargo build --release -p lodpack-cli --features object-store` (S3 is left out without that feature), nginx, and
`pip install 'moto[s3,server]' boto3`. What is missing is named and left out. Nexus is not compared: its tools read whole files."""
import argparse, contextlib, json, os, resource, shutil, socket, subprocess, sys, tempfile, time, urllib.request

ROOT = os.path.dirname(os.path.dirname(os.path.dirname(os.path.abspath(__file__))))
BIN = os.path.join(os.environ.get("CARGO_TARGET_DIR", os.path.join(ROOT, "target")), "release", "lodpack")


def run(*command, env=None):
    """stdout, CPU seconds and elapsed seconds of a program; its error as an exception."""
    before, start = resource.getrusage(resource.RUSAGE_CHILDREN), time.time()
    done = subprocess.run(command, capture_output=True, text=True, env={**os.environ, **(env or {})})
    after = resource.getrusage(resource.RUSAGE_CHILDREN)
    if done.returncode:
        raise RuntimeError(done.stderr.strip()[-300:])
    cpu = after.ru_utime + after.ru_stime - before.ru_utime - before.ru_stime
    return done.stdout, cpu, time.time() - start


def free_port():
    with socket.socket() as s:
        s.bind(("127.0.0.1", 0))
        return s.getsockname()[1]


def wait_for(url):
    for _ in range(100):
        with contextlib.suppress(OSError):
            urllib.request.urlopen(url, timeout=1).close()
            return
        time.sleep(0.1)
    raise RuntimeError(f"{url} does not answer")


@contextlib.contextmanager
def nginx(program, folder, work):
    """Serves a folder; yields its address and a function that counts requests and bytes sent since its last call."""
    port, log = free_port(), os.path.join(work, "access.log")
    conf = os.path.join(work, "nginx.conf")
    temp = "".join(f"{kind}_temp_path {work}/{kind};" for kind in ("client_body", "proxy", "fastcgi", "uwsgi", "scgi"))
    with open(conf, "w") as f:
        f.write(
            f"daemon off; pid {work}/pid; error_log {work}/error.log; events {{}}\n"
            f"http {{ {temp} log_format sent '$status $bytes_sent'; access_log {log} sent;\n"
            f"server {{ listen 127.0.0.1:{port}; root {folder}; }} }}\n"
        )
    os.chmod(work, 0o755)
    server = subprocess.Popen([program, "-c", conf, "-p", work], stderr=subprocess.DEVNULL)
    seen = 0

    def count():
        nonlocal seen
        time.sleep(0.05)
        lines = open(log).read().splitlines() if os.path.exists(log) else []
        new, seen = lines[seen:], len(lines)
        return len(new), sum(int(line.split()[1]) for line in new)

    try:
        wait_for(f"http://127.0.0.1:{port}/{os.listdir(folder)[0]}")
        count()
        yield f"http://127.0.0.1:{port}", count
    finally:
        server.terminate()
        server.wait()


@contextlib.contextmanager
def moto(files):
    """An S3 server with the files in bucket `models`; yields the variables that lead to it."""
    import boto3  # what is missing is told by the caller

    port = free_port()
    code = f"from moto.server import main; main(['-H', '127.0.0.1', '-p', '{port}'])"
    server = subprocess.Popen([sys.executable, "-c", code], stdout=subprocess.DEVNULL, stderr=subprocess.DEVNULL)
    try:
        url = f"http://127.0.0.1:{port}"
        wait_for(url)
        keys = {"aws_access_key_id": "any", "aws_secret_access_key": "any", "region_name": "us-east-1"}
        client = boto3.client("s3", endpoint_url=url, **keys)
        client.create_bucket(Bucket="models")
        for path in files:
            client.upload_file(path, "models", os.path.basename(path))
        yield {
            "AWS_ACCESS_KEY_ID": "any", "AWS_SECRET_ACCESS_KEY": "any", "AWS_REGION": "us-east-1",
            "AWS_ENDPOINT": url, "AWS_ALLOW_HTTP": "true",
        }
    finally:
        server.terminate()
        server.wait()


def queries(path, share):
    """Name and arguments of what is asked of a file."""
    info = json.loads(run(BIN, "info", "--json", path)[0])
    low, high = info["bounds"]
    # On a surface a box of this side holds about `share` of the area.
    side = (share / 100) ** 0.5
    middle = [(a + b) / 2 for a, b in zip(low, high)]
    # From the middle upward to the surface.
    half = [(b - a) * side / 2 for a, b in zip(low, high)]
    box = [m - h for m, h in zip(middle, half)] + [m + h for m, h in zip(middle, half)]
    box[2], box[5] = low[2], high[2]
    bbox = "--bbox=" + ",".join(repr(x) for x in box)
    finest = info["levels"][-1]["certified_error"]
    return [
        ("coarsest cut of everything", ["--tolerance", repr(1e3 * max(b - a for a, b in zip(low, high)))]),
        (f"column of {share} % at the finest", [bbox]),
        (f"the same at {10 * finest:.3g}", [bbox, "--tolerance", repr(10 * finest)]),
    ]


def main():
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--nginx", default=shutil.which("nginx") or "/usr/sbin/nginx")
    parser.add_argument("--share", type=float, default=1.0)
    parser.add_argument("files", nargs="+")
    args = parser.parse_args()
    rows = []

    def measure(source, path, address, env=None, served=None):
        for name, query in queries(path, args.share):
            output = os.path.join(work, "out.ply")
            out, cpu, elapsed = run(BIN, "extract", address, "--json", "--force", "-o", output, *query, env=env)
            found = json.loads(out)
            counted = "{} / {:,}".format(*served()) if served else ""
            size = os.path.getsize(path)
            rows.append(
                f"| {os.path.basename(path)} | {source} | {name} | {found['triangles']:,} | {found['requests']} "
                f"| {found['bytes_read']:,} | {100 * found['bytes_read'] / size:.2f} % | {counted} | {cpu:.2f} | {elapsed:.2f} |"
            )

    with tempfile.TemporaryDirectory() as work:
        folder = os.path.join(work, "files")
        os.mkdir(folder)
        for path in args.files:
            shutil.copy(path, folder)
            measure("local", path, path)
        if os.access(args.nginx, os.X_OK):
            with nginx(args.nginx, folder, work) as (url, count):
                for path in args.files:
                    measure("nginx", path, f"{url}/{os.path.basename(path)}", served=count)
        else:
            print("nginx is not there: left out (name it with --nginx)", file=sys.stderr)
        try:
            with moto(args.files) as env:
                for path in args.files:
                    measure("S3 (moto)", path, f"s3://models/{os.path.basename(path)}", env=env)
        except ImportError as error:
            print(f"S3 left out: {error}; pip install 'moto[s3,server]' boto3", file=sys.stderr)
        except RuntimeError as error:
            print(f"S3 left out: {error}", file=sys.stderr)
    print("| file | source | what | triangles | requests | bytes | of the file | server: answers / bytes | CPU s | elapsed s |")
    print("|---|---|---|---:|---:|---:|---:|---:|---:|---:|")
    print("\n".join(rows))


if __name__ == "__main__":
    main()
