#!/usr/bin/env python3
"""Checks that every accuracy which is printed holds for the file that was written.

usage: accuracy.py LODPACK [--inputs N] [--only KIND,...]

Makes N meshes and N rasters of heights (20 of each by default; far from the origin, thin, in degrees, on a globe, with
holes), writes every kind of output, and has `lodpack compare` measure it against the input. Prints a Markdown table:
for each kind the smallest and the median of what was printed over what was measured, and how many printed less. Exits
with 1 if any did. Needs numpy and rasterio. With --jacksboro, matplotlib's sample data is one of the rasters."""
import argparse, json, math, os, statistics, subprocess, sys, tempfile

import numpy as np

# Rounding of what is measured, relative to the size of coordinates.
ROUNDING = 1e-12
MESH_FORMATS = ("ply", "obj", "stl", "glb")


def sphere(rings, bumps, stretch, shift, rng):
    """A bumpy sphere as vertices and triangles."""
    lat = np.linspace(0.0, math.pi, rings + 1)[1:-1]
    lon = np.linspace(0.0, 2 * math.pi, 2 * rings, endpoint=False)
    a, b = np.meshgrid(lat, lon, indexing="ij")
    waves = rng.integers(2, 9, (4, 2))
    radius = 1 + bumps * sum(np.sin(p * a + q * b) for p, q in waves) / 4 + 0.02 * bumps * rng.normal(size=a.shape)
    points = np.stack([radius * np.sin(a) * np.cos(b), radius * np.sin(a) * np.sin(b), radius * np.cos(a)], -1)
    points = np.concatenate([[[0, 0, 1.0]], points.reshape(-1, 3), [[0, 0, -1.0]]]) * stretch + shift
    n, rows = 2 * rings, rings - 1
    at = lambda i, j: 1 + i * n + j % n
    faces = [(0, at(0, j), at(0, j + 1)) for j in range(n)]
    for i in range(rows - 1):
        for j in range(n):
            faces += [(at(i, j), at(i + 1, j), at(i + 1, j + 1)), (at(i, j), at(i + 1, j + 1), at(i, j + 1))]
    faces += [(at(rows - 1, j + 1), at(rows - 1, j), len(points) - 1) for j in range(n)]
    return points, np.array(faces)


def write_ply(path, points, faces):
    with open(path, "wb") as out:
        out.write(f"ply\nformat binary_little_endian 1.0\nelement vertex {len(points)}\nproperty double x\nproperty double y\nproperty double z\n"
                  f"element face {len(faces)}\nproperty list uchar int vertex_indices\nend_header\n".encode())
        out.write(points.astype("<f8").tobytes())
        rows = np.zeros(len(faces), dtype=[("n", "u1"), ("v", "<i4", 3)])
        rows["n"], rows["v"] = 3, faces
        out.write(rows.tobytes())


def meshes(count, folder):
    for number in range(count):
        rng = np.random.default_rng(number)
        shift = [0.0, 10.0, 1e4, 5e5, 4e6][number % 5] * np.array([1.0, -0.7, 0.3])
        stretch = np.array([1.0, 1.0, [1.0, 0.1, 5.0, 0.01][number % 4]]) * [1.0, 20.0, 0.05][number % 3]
        path = os.path.join(folder, f"mesh-{number}.ply")
        write_ply(path, *sphere(12 + 2 * number, 0.05 + 0.01 * number, stretch, shift, rng))
        yield path


def rasters(count, folder, has_jacksboro):
    """Rasters with what lays them out: none on a plane, or on the ellipsoid."""
    import rasterio
    from rasterio.transform import from_origin

    def write(name, heights, transform, crs, nodata=None):
        path = os.path.join(folder, name + ".tif")
        rows, columns = heights.shape
        profile = dict(driver="GTiff", width=columns, height=rows, count=1, dtype=heights.dtype, crs=crs, transform=transform, nodata=nodata)
        with rasterio.open(path, "w", **profile) as out:
            out.write(heights, 1)
        return path

    for number in range(count):
        rng = np.random.default_rng(100 + number)
        rows, columns = 60 + 7 * number, 80 + 5 * number
        y, x = np.mgrid[0:rows, 0:columns]
        heights = 500 + sum(rng.uniform(20, 200) * np.sin(x * rng.uniform(0.02, 0.3) + y * rng.uniform(0.02, 0.3)) for _ in range(4))
        heights += rng.normal(size=heights.shape) * rng.uniform(0, 5)
        heights = heights.astype([np.float32, np.int16][number % 2])
        nodata = None
        if number % 3 == 2:
            nodata = -9999
            heights[x + y < 20] = nodata
        if number % 2:
            yield write(f"degrees-{number}", heights, from_origin(-10 + 17 * number, 70 - 6.5 * number, 1 / 1200, 1 / 1200), "EPSG:4326", nodata), ["--surface", "wgs84"]
        else:
            yield write(f"plane-{number}", heights, from_origin(5e5, 5e6, 25, 25), "EPSG:32632", nodata), []
    if has_jacksboro:
        from matplotlib import cbook
        data = cbook.get_sample_data("jacksboro_fault_dem.npz")
        heights = data["elevation"].astype(np.int16)
        place = from_origin(data["xmin"] - data["dx"] / 2, data["ymax"] + data["dy"] / 2, data["dx"], data["dy"])
        yield write("jacksboro-4326", heights, place, "EPSG:4326"), ["--surface", "wgs84"]
        from rasterio.warp import Resampling, calculate_default_transform, reproject
        rows, columns = heights.shape
        bounds = rasterio.transform.array_bounds(rows, columns, place)
        to, width, height = calculate_default_transform("EPSG:4326", "EPSG:32616", columns, rows, *bounds)
        moved = np.full((height, width), -32768, np.int16)
        reproject(heights, moved, src_transform=place, src_crs="EPSG:4326", dst_transform=to, dst_crs="EPSG:32616", dst_nodata=-32768, resampling=Resampling.bilinear)
        yield write("jacksboro-32616", moved, to, "EPSG:32616", -32768), []


class Bench:
    def __init__(self, lodpack):
        self.lodpack, self.found = lodpack, {}

    def run(self, *words):
        done = subprocess.run([self.lodpack, *map(str, words)], capture_output=True, text=True)
        if done.returncode:
            raise RuntimeError(" ".join(map(str, words)) + "\n" + done.stderr)
        return done.stdout

    def json(self, *words):
        return json.loads(self.run(*words, "--json"))

    def compare(self, a, b, *more):
        return self.json("compare", a, b, "--samples", "1000", *more)["levels"]

    def note(self, kind, name, stated, measured, room=0.0):
        self.found.setdefault(kind, []).append((name, stated, measured, stated >= measured * (1 - 1e-9) - room))

    def meshes(self, path, folder):
        name, file = os.path.basename(path), os.path.join(folder, "m.lodpack")
        size = max(abs(float(x)) for corner in self.bounds(path, file) for x in corner)
        room = ROUNDING * size
        for level in self.compare(path, file, "--level", "all"):
            self.note("build, each level", name, level["claimed"], level["distance"][0], room)
        for extension in MESH_FORMATS:
            out = os.path.join(folder, "cut." + extension)
            for more in ([], ["--triangles", "300"]):
                said = self.json("extract", file, "-o", out, "--force", *more)
                level = self.compare(path, out)[0]
                self.note(f"extract {extension}" + (" --triangles" if more else ""), name, said["certified_error"], level["distance"][0], room)
        out = os.path.join(folder, "lod.glb")
        self.run("export", file, "--as", "glb-lod", "-o", out, "--force")
        for level in self.compare(path, out):
            self.note("export glb-lod, each level", name, level["claimed"], level["distance"][0], room)
        out = os.path.join(folder, "tiles-" + name)
        self.run("export", file, "--as", "3dtiles", "-o", out)
        for level in self.compare(path, os.path.join(out, "tileset.json")):
            self.note("export 3dtiles, each depth", name, level["claimed"], level["distance"][0], room)
        said = self.run("atlas", path, "-o", os.path.join(folder, "atlas-" + name))
        stated = float(next(line for line in said.splitlines() if "distance" in line).split()[1])
        again = os.path.join(folder, "again.lodpack")
        self.run("build", os.path.join(folder, "atlas-" + name), "-o", again, "--force", "--tolerance", "0.001%")
        built = self.compare(path, again)[0]
        self.note("atlas", name, stated + built["claimed"], built["distance"][0], room)

    def bounds(self, path, file):
        self.run("build", path, "-o", file, "--force")
        return self.json("info", file)["bounds"]

    def rasters(self, path, on_globe, folder):
        name, file = os.path.basename(path), os.path.join(folder, "h.lodpack")
        room = ROUNDING * 6.4e6
        self.run("build", path, "-o", file, "--force", "--heights", "--tolerance", "2", *on_globe)
        samples = lambda level: level["samples_of_a_to_b"]["upper"]
        of_file = self.compare(path, file, *on_globe)[0]
        self.note("build --heights", name, of_file["claimed"], samples(of_file), room)
        for tolerance in (2, 10, 60):
            for kind, more in (("extract ply", []), ("extract ply --tin", ["--tin"])):
                out = os.path.join(folder, "cut.ply")
                said = self.json("extract", file, "-o", out, "--force", "--tolerance", tolerance, *more)
                self.note(kind + " of heights", name, said["certified_error"], samples(self.compare(path, out, *on_globe)[0]), room)
        for extension in ("stl", "glb"):
            out = os.path.join(folder, "cut." + extension)
            said = self.json("extract", file, "-o", out, "--force")
            self.note(f"extract {extension} of heights", name, said["certified_error"], samples(self.compare(path, out, *on_globe)[0]), room)
        window = os.path.join(folder, "w.tif")
        for more in ([], ["--tolerance", "10"], ["--tolerance", "60"]):
            said = self.json("extract", file, "-o", window, "--force", *more)
            measured = samples(self.compare(path, window, *on_globe)[0])
            self.note("extract tif" + (" --tolerance" if more else ""), name, said["certified_error"], measured, room)
        tiles = os.path.join(folder, "tiles-" + name)
        self.run("export", file, "--as", "3dtiles", "-o", tiles)
        for level in self.compare(path, os.path.join(tiles, "tileset.json"), *on_globe):
            self.note("export 3dtiles of heights, each depth", name, level["claimed"], samples(level), room)
        if on_globe:
            terrain = os.path.join(folder, "terrain-" + name)
            said = self.json("export", file, "--as", "quantized-mesh", "-o", terrain)
            measured = samples(self.compare(path, os.path.join(terrain, "layer.json"), "--level", "finest")[0])
            self.note("export quantized-mesh", name, said["finest_error"], measured, room)
            self.note("quantized-mesh within 1.05 of the file", name, 1.05 * samples(of_file), measured, room)

    def table(self):
        print("| output | cases | printed over measured: least | median | printed less |\n|---|---:|---:|---:|---:|")
        bad = 0
        for kind, rows in self.found.items():
            ratios = [stated / measured for _, stated, measured, _ in rows if measured > 0]
            less = [row for row in rows if not row[3]]
            bad += len(less)
            least, median = (f"{min(ratios):.3f}", f"{statistics.median(ratios):.3f}") if ratios else ("", "")
            print(f"| {kind} | {len(rows)} | {least} | {median} | {len(less)} |")
            for name, stated, measured, _ in less[:5]:
                print(f"  {kind}: {name} says {stated:.6g} and is off by {measured:.6g}", file=sys.stderr)
        return bad


def main():
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("lodpack")
    parser.add_argument("--inputs", type=int, default=20)
    parser.add_argument("--only", default="meshes,rasters")
    parser.add_argument("--jacksboro", action="store_true")
    args = parser.parse_args()
    bench = Bench(args.lodpack)
    with tempfile.TemporaryDirectory() as folder:
        if "meshes" in args.only:
            for path in meshes(args.inputs, folder):
                bench.meshes(path, folder)
        if "rasters" in args.only:
            for path, on_globe in rasters(args.inputs, folder, args.jacksboro):
                bench.rasters(path, on_globe, folder)
    return 1 if bench.table() else 0


if __name__ == "__main__":
    sys.exit(main())
