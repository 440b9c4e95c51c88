"""Runs programs as processes and measures them; meshes as files and as arrays; distances."""
import json, os, subprocess, sys, tempfile, time
import numpy as np

ROOT = os.path.dirname(os.path.dirname(os.path.dirname(os.path.dirname(os.path.abspath(__file__)))))
BIN = os.environ.get("LODPACK_BIN") or os.path.join(os.environ.get("CARGO_TARGET_DIR", os.path.join(ROOT, "target")), "release")
LIMIT = 3600


class Run:
    """The output and cost of a program: stdout, CPU seconds, elapsed seconds, peak memory in bytes.

    Memory is sampled while the program runs: afterwards, the system would include what this Python used when it started
    it."""

    def __init__(self, *command):
        with tempfile.TemporaryFile() as out, tempfile.TemporaryFile() as err:
            start = time.time()
            child = subprocess.Popen([str(c) for c in command], stdout=out, stderr=err)
            self.memory = 0
            # Usage of this child only, unlike RUSAGE_CHILDREN.
            while True:
                self.memory = peak_memory(child.pid) or self.memory
                pid, status, usage = os.wait4(child.pid, os.WNOHANG)
                if pid:
                    break
                if time.time() - start > LIMIT:
                    child.kill()
                # Often at first: a short program peaks near its end, which must not fall between two samples.
                time.sleep(min(0.01, 0.001 + 0.01 * (time.time() - start)))
            child.returncode = os.waitstatus_to_exitcode(status)
            self.wall = time.time() - start
            self.cpu = usage.ru_utime + usage.ru_stime
            err.seek(0), out.seek(0)
            if self.wall > LIMIT:
                raise RuntimeError(f"{os.path.basename(str(command[0]))} was stopped after {LIMIT} s")
            if child.returncode != 0:
                told = err.read().decode(errors="replace")[-200:].strip() or f"exit status {child.returncode}"
                raise RuntimeError(f"{os.path.basename(str(command[0]))} failed: {told}")
            self.out = out.read().decode()

    def json(self):
        return json.loads(self.out)


def peak_memory(pid):
    """Peak resident memory of a running program so far, in bytes; None when it has ended."""
    try:
        with open(f"/proc/{pid}/status") as status:
            return next((int(line.split()[1]) * 1024 for line in status if line.startswith("VmHWM")), None)
    except OSError:
        return None


def program(name, *args):
    return Run(os.path.join(BIN, name), *args)


def lodpack(*args):
    return program("lodpack", *args).json()


def python(code, *args):
    return Run(sys.executable, "-c", code, *args)


class Distance:
    """RMS and a bound on the maximum, for the worse direction, in mean edge lengths of the input (`edge`, in its
    units)."""

    def __init__(self, mesh, path):
        d = program("distance", mesh, path).json()
        self.edge = d["mean_edge_a"]
        self.rms = max(d["rms_ab"], d["rms_ba"]) / self.edge
        self.max = max(d["max_ab"][1], d["max_ba"][1]) / self.edge
        self.triangles = d["triangles_b"]


def welded(mesh):
    import pymeshlab

    meshes = pymeshlab.MeshSet(verbose=False)
    meshes.load_new_mesh(mesh)
    meshes.apply_filter("meshing_remove_duplicate_vertices")
    return meshes


def arrays(meshes):
    mesh = meshes.current_mesh()
    # Unused vertices would count in a peer's bytes.
    used, inverse = np.unique(mesh.face_matrix(), return_inverse=True)
    return mesh.vertex_matrix()[used].astype(np.float32), inverse.reshape(-1, 3).astype(np.uint32)


def extent(positions):
    return float((positions.max(0) - positions.min(0)).max())


def write_ply(path, positions, triangles):
    rows = np.empty(len(triangles), dtype=[("n", "u1"), ("i", "<i4", 3)])
    rows["n"], rows["i"] = 3, triangles
    with open(path, "wb") as f:
        f.write(
            f"ply\nformat binary_little_endian 1.0\nelement vertex {len(positions)}\nproperty float x\nproperty float y\n"
            f"property float z\nelement face {len(triangles)}\nproperty list uchar int vertex_indices\nend_header\n".encode()
        )
        f.write(np.ascontiguousarray(positions, np.float32).tobytes())
        f.write(rows.tobytes())


def read_ply(path):
    """Positions and triangles of a file written by `write_ply`."""
    with open(path, "rb") as f:
        head = iter(f.readline, b"end_header\n")
        counts = [int(line.split()[-1]) for line in head if line.startswith(b"element")]
        positions = np.frombuffer(f.read(12 * counts[0]), np.float32).reshape(-1, 3)
        return positions, np.frombuffer(f.read(), [("n", "u1"), ("i", "<i4", 3)])["i"].astype(np.uint32)


def name_of(mesh):
    return os.path.splitext(os.path.basename(mesh))[0]


def given(mesh, work):
    """The file of a mesh, generated if necessary, in single precision, which all peers read."""
    kind, _, n = mesh.partition(":")
    if not n or os.path.exists(mesh):
        return mesh
    double, path = os.path.join(work, f"{kind}{n}-double.ply"), os.path.join(work, f"{kind}{n}.ply")
    program("generate", kind, n, double)
    write_ply(path, *arrays(welded(double)))
    return path
