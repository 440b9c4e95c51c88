#!/usr/bin/env python3
"""Measures the cost of drawing files from disk, from a web server (nginx) and from an S3 server (moto), side by side,
and compared with Nexus for the same regions. Prints Markdown.

usage: streams.py [--regions N] [--mesh MESH]... [--simplified] [--equal-triangles] [--nginx PROGRAM] [--work DIR]
                  FILE.lodpack...

For each file: opening, the first complete picture (the overview, or all roots at their coarsest level), and cubes that
contain a hundredth of the roots, around evenly chosen roots, at the finest level and at the error of the next coarser
one. The figures are those that the example `requests` counts, opening included; for the servers also those of their own
logs (bytes without headers; moto's log has none). Before that, `lodpack extract` writes a cube from each source, and
the meshes must be equal to the byte.

With --mesh, one per file in the same order, Nexus's pyramid of that mesh (nxs_build, nxs_compress) is read for the same
cubes. Its errors are neither bounds nor measured distances. Therefore it is drawn down to the node error at which the
whole model has a measured RMS no larger than lodpack's finest level, or the next coarser one; its positions are coded
as coarsely as that allows. Of its nodes, those are read whose tight spheres touch the cube, and those above them; its
viewers request each node separately. The search compares about seven cuts with the mesh. With --equal-triangles, for
large meshes, Nexus is drawn with as many triangles as lodpack's level instead. With --simplified, Nexus is also
measured over a mesh that VTK has first simplified to that RMS: smaller, but without anything finer.

Needs the output of `cargo build --release --workspace --bins --examples --features
lodpack-cli/object-store,lodpack/http,lodpack/object-store`, nginx, and `pip install 'moto[s3,server]' boto3`; for Nexus
requirements.txt. Missing programs are named and left out."""
import argparse, collections, contextlib, csv, filecmp, os, re, shutil, signal, socket, subprocess, sys, tempfile, time, urllib.request
from statistics import median

from peer import nexus, search, simplify
from peer.run import BIN, Distance, Run, arrays, given, lodpack, welded, write_ply
from peer.single import Scale

KEYS = {"AWS_ACCESS_KEY_ID": "any", "AWS_SECRET_ACCESS_KEY": "any", "AWS_REGION": "us-east-1", "AWS_ALLOW_HTTP": "true"}
FINEST, BEFORE = "region at the finest", "region at the next coarser level"
Source = collections.namedtuple("Source", "name address served")


def free_port():
    with socket.socket() as s:
        s.bind(("127.0.0.1", 0))
        return s.getsockname()[1]


def wait_for(url):
    for _ in range(200):
        with contextlib.suppress(OSError):
            urllib.request.urlopen(url, timeout=1).close()
            return
        time.sleep(0.1)
    raise RuntimeError(f"{url} does not answer")


class Log:
    """The lines that a server logs, one per answer; counts those since the last call."""

    def __init__(self, path, line):
        self.path, self.line, self.seen = path, re.compile(line, re.MULTILINE), 0

    def count(self):
        """Number of answers and, if the lines contain them, bytes."""
        time.sleep(0.2)
        with open(self.path) as f:
            found = self.line.findall(f.read())
        new, self.seen = found[self.seen:], len(found)
        return len(new), sum(int(size) for size in new if size)


@contextlib.contextmanager
def stopped_at_end(*command, **options):
    server = subprocess.Popen(command, **options)
    try:
        yield
    finally:
        server.terminate()
        server.wait()


@contextlib.contextmanager
def nginx(program, folder, work):
    """Serves a folder. Yields the address and the log."""
    port, log, conf = free_port(), os.path.join(work, "access.log"), os.path.join(work, "nginx.conf")
    temp = "".join(f"{kind}_temp_path {work}/{kind};" for kind in ("client_body", "proxy", "fastcgi", "uwsgi", "scgi"))
    with open(conf, "w") as f:
        f.write(
            f"daemon off; pid {work}/pid; error_log {work}/error.log; events {{}}\n"
            f"http {{ {temp} log_format sent 'sent $body_bytes_sent'; access_log {log} sent;\n"
            f"server {{ listen 127.0.0.1:{port}; root {folder}; }} }}\n"
        )
    # Its workers may belong to another user.
    os.chmod(work, 0o755)
    with stopped_at_end(program, "-c", conf, "-p", work, stderr=subprocess.DEVNULL):
        wait_for(f"http://127.0.0.1:{port}/{os.listdir(folder)[0]}")
        yield f"http://127.0.0.1:{port}", Log(log, r"^sent (\d+)$")


@contextlib.contextmanager
def moto(folder, work):
    """Runs an S3 server with the folder's files in the bucket `models`, to which the environment points. Yields the
    address and the log."""
    import boto3  # the caller reports missing modules

    port, log = free_port(), os.path.join(work, "moto.log")
    code = f"from moto.server import main; main(['-H', '127.0.0.1', '-p', '{port}'])"
    with open(log, "w") as out, stopped_at_end(sys.executable, "-u", "-c", code, stdout=out, stderr=out):
        url = f"http://127.0.0.1:{port}"
        wait_for(url)
        client = boto3.client("s3", endpoint_url=url, aws_access_key_id="any", aws_secret_access_key="any", region_name="us-east-1")
        client.create_bucket(Bucket="models")
        for name in os.listdir(folder):
            client.upload_file(os.path.join(folder, name), "models", name)
        os.environ.update(KEYS, AWS_ENDPOINT=url)
        yield "s3://models", Log(log, r'(?:GET|HEAD) /models/\S+ HTTP/1\.1\S* 20\d ()')


def steps_of(address, regions):
    """The output of the example: for each kind of step its rows, with numbers as numbers."""
    run = Run(os.path.join(BIN, "examples", "requests"), "--csv", "--regions", regions, address)
    steps = collections.defaultdict(list)
    for row in csv.DictReader(run.out.splitlines()):
        steps[row.pop("what")].append({name: float(value) for name, value in row.items()})
    return steps


def box(row):
    return [row[name] for name in ("x0", "y0", "z0", "x1", "y1", "z1")]


def cold(steps):
    """Name and (requests, bytes, seconds), opening included, of each measured result."""
    opening = steps["open"][0]
    with_opening = lambda row: tuple(opening[k] + row[k] for k in ("requests", "bytes", "seconds"))
    first = steps["overview after opening"] or steps["coarsest level after opening"]
    rows = [("opening", [tuple(opening[k] for k in ("requests", "bytes", "seconds"))])]
    rows.append((f"first complete picture, {first[0]['triangles']:,.0f} triangles", [with_opening(first[0])]))
    if steps["overview after opening"]:
        coarsest = steps["coarsest level after opening"]
        rows.append((f"all roots at their coarsest, {coarsest[0]['triangles']:,.0f} triangles", [with_opening(coarsest[0])]))
    for what in (FINEST, BEFORE):
        if steps[what]:
            rows.append((f"{what}, median of {len(steps[what])}", [with_opening(row) for row in steps[what]]))
    return rows


def middle(values):
    """Medians of tuples, component by component."""
    return tuple(median(value) for value in zip(*values))


def ratio(a, b):
    return f"{a / b:.2f}" if b else "-"


def side_by_side(name, size, sources, found):
    """Requests, bytes and time of each source, and those of the others relative to the first."""
    print(f"\n{name}, {size:,} bytes:\n")
    print("| | " + " | ".join(f"{s.name}: requests | bytes | ms" for s in sources) + " | requests, relative to local | bytes, relative to local |")
    print("|---" + "|---:" * (3 * len(sources) + 2) + "|")
    for k, (what, local) in enumerate(cold(found[0])):
        numbers = [middle(cold(steps)[k][1]) for steps in found]
        cells = [f"{requests:g} | {read:,.0f} | {1e3 * seconds:.1f}" for requests, read, seconds in numbers]
        over = [", ".join(ratio(n[i], numbers[0][i]) for n in numbers[1:]) or "-" for i in (0, 1)]
        print(f"| {what} | {' | '.join(cells)} | {over[0]} | {over[1]} |")


def extract_from(address, row, work):
    path = os.path.join(work, "cube.ply")
    numbers = lodpack("extract", address, "--bbox=" + ",".join(map(repr, box(row))), "-o", path, "--force", "--json")
    return path, numbers


def nexus_read(index, chosen, cubes):
    """Medians over cubes: requests (header, index, and one per node), the same with adjacent nodes joined, bytes."""
    rows = []
    for cube in cubes:
        read = index.read_for(chosen, cube)
        runs = sum(bool(now and not before) for before, now in zip([False, *read], read))
        rows.append((2 + int(read.sum()), 2 + runs, index.bytes_of(read)))
    return middle(rows)


def level_distance(path, mesh, error, work):
    """The distance of everything drawn at an error."""
    out = os.path.join(work, "level.ply")
    lodpack("extract", path, "-o", out, "--force", "--json", "--tolerance", repr(error))
    return Distance(mesh, out)


def nexus_rows(path, mesh, steps, args, work):
    """For both kinds of cubes: name, peer, medians (requests, with adjacent nodes joined, bytes), bytes of the file."""
    source = os.path.join(work, "source.ply")
    positions, triangles = arrays(welded(mesh))
    write_ply(source, positions, triangles)
    nexus.nexus(mesh, work, keep=True)
    nxs, cut = os.path.join(work, "peer.nxs"), os.path.join(work, "cut.ply")
    raw = nexus.Index(nxs)
    errors = sorted({float(error) for error in raw.nodes["error"][:raw.sink]}, reverse=True) + [-1.0]
    levels = lodpack("info", path, "--json")["levels"]
    for what, level in ((FINEST, levels[-1]), (BEFORE, levels[max(len(levels) - 2, 0)])):
        cubes = [box(row) for row in steps[what]]
        if not cubes:
            continue
        ours = level_distance(path, mesh, level["certified_error"], work)
        limit, scale = ours.rms, Scale(positions, ours.edge)
        step = scale.lattice("rms", limit)
        coded = os.path.join(work, "coded.nxz")
        nexus.compress(nxs, coded, step)
        index = nexus.Index(coded)

        def rms(error):
            raw.write_cut(raw.selected(error), cut)
            nexus.truncated(cut, cut, step)
            return Distance(mesh, cut).rms

        def is_enough(error):
            return raw.triangles(raw.selected(error)) >= ours.triangles if args.equal_triangles else rms(error) <= limit

        low, high = -1, len(errors) - 1
        while high - low > max(1, len(errors) // 100):
            at = (low + high) // 2
            low, high = (low, at) if is_enough(errors[at]) else (at, high)
        chosen = raw.selected(errors[high])
        name = f"Nexus, RMS {rms(errors[high]):.3f} for our {limit:.3f} edges"
        yield what, name, nexus_read(index, chosen, cubes), index.size
        if args.simplified:
            yield what, f"VTK + Nexus, RMS at most {limit:.3f} edges", *over_simplified(mesh, source, len(triangles), limit, scale, step, cubes, work)


def over_simplified(mesh, source, count, limit, scale, step, cubes, work):
    """Nexus over a mesh that VTK has simplified, with all of its nodes down to the finest in each cube."""
    simplifier = simplify.Simplifier("VTK", source, count, mesh, work)
    nxs, nxz, path = (os.path.join(work, name) for name in ("over.nxs", "over.nxz", "level.ply"))
    best = None

    def error_of(triangles):
        nonlocal best
        simplified, _ = simplifier.mesh(triangles)
        nexus.truncated(simplified, path, step)
        rms = Distance(mesh, path).rms
        if rms <= limit and (best is None or triangles < best):
            best = triangles
        return rms

    search.reach(error_of, min(count * 0.1, 1e6), 0.9 * count, limit, scale.truncation("rms", step / scale.edge), tries=6)
    if best is None:
        raise RuntimeError("VTK does not reach the RMS")
    nexus.build_only(simplifier.mesh(best)[0], nxs, best)
    nexus.compress(nxs, nxz, step)
    index = nexus.Index(nxz)
    return nexus_read(index, index.selected(-1.0), cubes), index.size


def beside_nexus(name, path, mesh, steps, args, work):
    ours = dict(zip((FINEST, BEFORE), (middle(values) for what, values in cold(steps) if what.startswith("region"))))
    print(f"\n{name}, the same cubes, opening included, medians:\n")
    print("| | file, bytes | requests | adjacent nodes joined | bytes | bytes, relative to lodpack |")
    print("|---|---:|---:|---:|---:|---:|")
    for what in ours:
        print(f"| {what}: lodpack | {os.path.getsize(path):,} | {ours[what][0]:g} | | {ours[what][1]:,.0f} | 1 |")
        sys.stdout.flush()
    for what, peer, (requests, joined, read), size in nexus_rows(path, mesh, steps, args, work):
        print(f"| {what}: {peer} | {size:,} | {requests:g} | {joined:g} | {read:,.0f} | {ratio(read, ours[what][1])} |")
        sys.stdout.flush()


def main():
    # So that the servers stop too when this program is stopped.
    signal.signal(signal.SIGTERM, lambda *_: sys.exit(143))
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--nginx", default=shutil.which("nginx") or "/usr/sbin/nginx")
    parser.add_argument("--regions", type=int, default=50)
    parser.add_argument("--mesh", action="append", default=[])
    parser.add_argument("--simplified", action="store_true")
    parser.add_argument("--equal-triangles", action="store_true")
    parser.add_argument("--work")
    parser.add_argument("files", nargs="+")
    args = parser.parse_args()
    with contextlib.ExitStack() as stack:
        work = args.work or stack.enter_context(tempfile.TemporaryDirectory())
        folder = os.path.join(work, "files")
        os.makedirs(folder, exist_ok=True)
        names = [os.path.basename(path) for path in args.files]
        for path in args.files:
            shutil.copy(path, folder)
        sources = [Source("local", folder, None)]
        if os.access(args.nginx, os.X_OK):
            sources.append(Source("nginx", *stack.enter_context(nginx(args.nginx, folder, work))))
        else:
            print("nginx not found: left out (name it with --nginx)", file=sys.stderr)
        try:
            sources.append(Source("S3 (moto)", *stack.enter_context(moto(folder, work))))
        except (ImportError, RuntimeError) as error:
            print(f"S3 left out: {error}; pip install 'moto[s3,server]' boto3", file=sys.stderr)
        local = {}
        for name, path in zip(names, args.files):
            found, cube = [], None
            for source in sources:
                address = f"{source.address}/{name}"
                if source.served:
                    source.served.count()
                steps = steps_of(address, args.regions)
                if source.served:
                    asked = [row for rows in steps.values() for row in rows]
                    # The file is opened anew for each region.
                    openings = len(steps[FINEST]) + len(steps[BEFORE])
                    requests, read = (sum(row[k] for row in asked) + openings * steps["open"][0][k] for k in ("requests", "bytes"))
                    answers, sent = source.served.count()
                    print(f"{name}, {source.name}: {answers:,} answers for {requests:,.0f} requests, "
                          f"{f'{sent:,}' if sent else '?'} bytes for {read:,.0f}", file=sys.stderr)
                extracted, _ = extract_from(address, steps[FINEST][0], work)
                if cube and not filecmp.cmp(cube, extracted, shallow=False):
                    raise RuntimeError(f"{address}: the mesh differs from the one on disk")
                cube = cube or shutil.copy(extracted, os.path.join(work, "local.ply"))
                found.append(steps)
            local[name] = found[0]
            side_by_side(name, os.path.getsize(path), sources, found)
        for name, path, mesh in zip(names, args.files, args.mesh):
            beside_nexus(name, path, given(mesh, work), local[name], args, work)


if __name__ == "__main__":
    main()
