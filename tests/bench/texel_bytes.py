"""What colours and normals cost, beside what peers take for a surface that shows the same.

    python3 tests/bench/texel_bytes.py textures LODPACK MODEL [MODEL ...] [--gltfpack PROGRAM]
    python3 tests/bench/texel_bytes.py colours LODPACK MESH.ply [...]
    python3 tests/bench/texel_bytes.py normals LODPACK MESH.ply [...]

A MODEL is an OBJ with MTL, or a GLB. A mesh without colours is painted.

Colours are compared over the surface by `colours.py` and normals by `normals.py`, at the same points for all. Peers of
textures keep the input's mesh and coordinates and code its images: WebP (pillow, method 6) and KTX2 of Basis Universal
(alktx2) with averages, as gltfpack has it, each at several qualities; bytes at lodpack's PSNR are interpolated. The
peer of colours and normals at vertices is Draco (DracoPy, level 10, positions of 12 bits), of the input and of meshes
simplified by fast_simplification. Needs what those two need, and alktx2, DracoPy and fast_simplification.
"""

import argparse
import io
import json
import os
import pathlib
import struct
import subprocess
import tempfile

import alktx2
import DracoPy
import fast_simplification
import numpy as np
from PIL import Image
from scipy.spatial import cKDTree

import colours
import normals

POSITION_BITS = 12
# What counts as no difference, so that images without loss have a PSNR.
EXACT = 1e-4


def built(lodpack, source, file, *options):
    subprocess.run([lodpack, "build", source, "-o", file, "--force", *options], check=True, capture_output=True)
    info = json.loads(subprocess.run([lodpack, "info", "--json", file], check=True, capture_output=True).stdout)
    return sum(channel["bytes"] for channel in info["channels"]) + info["map_bytes"], info


def extracted(lodpack, file, cut, *options):
    subprocess.run([lodpack, "extract", file, "-o", cut, "--force", *options], check=True, capture_output=True)
    return cut


def at(points, wanted):
    """Bytes at a PSNR, between those of the two qualities beside it."""
    known, sizes = zip(*sorted(points))
    if wanted > known[-1]:
        return f"> {sizes[-1] / 1000:.1f} ({known[-1]:.1f} dB)"
    return f"{'< ' if wanted < known[0] else ''}{np.exp(np.interp(wanted, known, np.log(sizes))) / 1000:.1f}"


def as_webp(image, quality):
    out = io.BytesIO()
    image.save(out, "WEBP", method=6, **({"lossless": True} if quality is None else {"quality": quality}))
    return out.getvalue(), Image.open(io.BytesIO(out.getvalue())).convert("RGB")


def as_ktx2(image, options):
    png = io.BytesIO()
    image.save(png, "PNG")
    coded = alktx2.encode_bytes_to_ktx2(png.getvalue(), mime="image/png", mipmaps=True, check_for_alpha=False, **options)
    return coded, Image.open(io.BytesIO(alktx2.decode_ktx2_to_bytes(coded)[0])).convert("RGB")


PEERS = {
    "WebP": (as_webp, [5, 15, 30, 45, 60, 70, 80, 85, 90, 95, 98, 100, None]),
    "KTX2 ETC1S": (as_ktx2, [{"codec": "etc1s", "quality": quality} for quality in [1, 10, 25, 50, 75, 100]]),
    "KTX2 UASTC": (
        as_ktx2,
        [{"codec": "uastc", "uastc_rdo_lambda": rdo, "zstd_supercompression_level": 19} for rdo in [0, 0.5, 1, 2, 4, 8]],
    ),
}


def curve(judge, source, code, qualities):
    """PSNR over the surface, and bytes of all images that it shows, by quality."""
    points = []
    for quality in qualities:
        known, images, size = {}, [], 0
        for factor, image in source.images:
            if image is not None and image.tobytes() not in known:
                coded, back = code(Image.fromarray(image), quality)
                known[image.tobytes()] = np.asarray(back)
                size += len(coded)
            images.append((factor, image if image is None else known[image.tobytes()]))
        shown = colours.Surface(
            source.positions, source.triangles, None, source.places, source.place_triangles, images, source.image_of
        )
        squares = judge.squares_at(shown, judge.triangles, judge.weights)[0]
        points.append((colours.decibels(np.maximum(squares, EXACT)), size))
    return points


def mesh_bytes(gltfpack, model, folder):
    """What gltfpack takes for geometry and coordinates."""
    packed = folder / "packed.glb"
    subprocess.run([*gltfpack.split(), "-i", model, "-o", packed, "-cc"], check=True, capture_output=True)
    data = packed.read_bytes()
    document = json.loads(data[20 : 20 + struct.unpack_from("<I", data, 12)[0]])
    views = [image["bufferView"] for image in document.get("images", []) if "bufferView" in image]
    return len(data) - sum(document["bufferViews"][view]["byteLength"] for view in views)


def textures(options, folder):
    for model in options.models:
        source = colours.read(model)
        judge = colours.Judge(source)
        curves = {name: curve(judge, source, *peer) for name, peer in PEERS.items()}
        own = {image.tobytes(): image for _, image in source.images if image is not None}
        print(f"{model}: {len(source.triangles)} triangles, {sum(image.shape[0] * image.shape[1] for image in own.values())} texels; kB")
        if options.gltfpack:
            print(f"gltfpack -cc without images: {mesh_bytes(options.gltfpack, model, folder) / 1000:.1f}")
        print("quality   PSNR dB   finest level   all levels   whole file   " + "   ".join(curves))
        for quality in [60, 75, 85, 95, 100]:
            settings = ["--channels", "colour", "--color-quality", str(quality)]
            finest, _ = built(options.lodpack, model, folder / "finest.lodpack", *settings, "--levels", "finest")
            size, info = built(options.lodpack, model, folder / "all.lodpack", *settings)
            cut = colours.read(str(extracted(options.lodpack, folder / "all.lodpack", folder / "cut.obj")))
            found = colours.decibels(judge.squares(cut)[0])
            peers = "   ".join(f"{at(points, found):>10}" for points in curves.values())
            print(f"{quality:7} {found:9.2f} {finest / 1000:14.1f} {size / 1000:12.1f} {info['bytes'] / 1000:12.1f}   {peers}", flush=True)


def painted(positions):
    """Waves with periods of 2 to 12 % of the diagonal, and noise of 1 of 255."""
    random = np.random.default_rng(11)
    diagonal = np.linalg.norm(np.ptp(positions, axis=0))
    values = np.full((len(positions), 3), 127.0)
    for period in np.geomspace(0.02, 0.12, 6):
        directions = normals.unit(random.normal(size=(3, 3)))
        values += 20 * np.sin(positions @ directions.T * (2 * np.pi / (period * diagonal)) + random.random(3) * 6)
    return np.clip(np.round(values + random.normal(size=values.shape)), 0, 255).astype("u1")


def write_painted(path, positions, triangles, values):
    vertices = np.empty(len(positions), dtype=[("position", "<f8", 3), ("colour", "u1", 3)])
    vertices["position"], vertices["colour"] = positions, values
    faces = np.empty(len(triangles), dtype=[("count", "u1"), ("corners", "<i4", 3)])
    faces["count"], faces["corners"] = 3, triangles
    with open(path, "wb") as out:
        coordinates = "".join(f"property double {axis}\n" for axis in "xyz") + "".join(f"property uchar {c}\n" for c in ["red", "green", "blue"])
        head = f"ply\nformat binary_little_endian 1.0\nelement vertex {len(vertices)}\n{coordinates}element face {len(faces)}\n"
        out.write((head + "property list uchar int vertex_indices\nend_header\n").encode())
        out.write(vertices.tobytes() + faces.tobytes())


def in_draco(positions, triangles, **attributes):
    settings = {"quantization_bits": POSITION_BITS, "compression_level": 10}
    return DracoPy.encode(positions, triangles.astype("u4"), **settings, **attributes)


def simplified(positions, triangles, counts):
    """The input itself, and it with fewer triangles."""
    for count in counts:
        if count >= len(triangles):
            yield positions, triangles
        else:
            yield fast_simplification.simplify(positions, triangles, target_count=count)


def colours_of_vertices(options, folder):
    for path in options.models:
        positions, triangles = normals.read_mesh(path)
        model = folder / "painted.ply"
        write_painted(model, positions, triangles, painted(positions))
        source = colours.read(str(model))
        judge = colours.Judge(source)
        size, info = built(options.lodpack, model, folder / "all.lodpack", "--channels", "colour")
        finest, _ = built(options.lodpack, model, folder / "finest.lodpack", "--channels", "colour", "--levels", "finest")
        print(f"{path}: {len(triangles)} triangles; lodpack has {size / 1000:.1f} kB of colours in all levels, {finest / 1000:.1f} in the finest; file {info['bytes'] / 1000:.1f}")
        cuts = []
        for share in [1, 0.05]:
            budget = [] if share == 1 else ["--triangles", str(int(len(triangles) * share))]
            cut = colours.read(str(extracted(options.lodpack, folder / "all.lodpack", folder / "cut.obj", *budget)))
            cuts.append((len(cut.triangles), colours.decibels(judge.squares(cut)[0])))
            print(f"lodpack: {cuts[-1][0]} triangles, {cuts[-1][1]:.2f} dB")
        print("draco, triangles: bits of a colour: PSNR dB, kB of colours, kB in all")
        counts = [count for count, _ in cuts] + [len(triangles) // divisor for divisor in [10, 4, 2, 1]]
        for own, corners in simplified(positions, triangles, sorted(set(counts))):
            found, closest = source.mesh().find_closest_cell(own, return_closest_point=True)
            exact = source.colour(found, colours.weights_at(source, found, closest), False)
            bare, row = len(in_draco(own, corners)), []
            where = None
            for bits in [4, 5, 6, 8]:
                step = 255 / (2**bits - 1)
                levels = np.round(exact / step)
                surface = colours.Surface(own, corners, levels * step)
                if where is None:
                    cells, nearest = surface.mesh().find_closest_cell(judge.points, return_closest_point=True)
                    where = cells, colours.weights_at(surface, cells, nearest)
                found = colours.decibels(judge.squares_at(surface, *where)[0])
                coded = len(in_draco(own, corners, colors=levels.astype("u1")))
                row.append(f"{bits}: {found:.2f}, {(coded - bare) / 1000:.1f}, {coded / 1000:.1f}")
            print(f"{len(corners):9}: " + "; ".join(row), flush=True)


def normals_of_vertices(options, folder):
    for path in options.models:
        positions, triangles = normals.read_mesh(path)
        judge = normals.Judge(positions, triangles)
        print(f"{path}: {len(triangles)} triangles; median and RMS in degrees, kB of normals, kB in all")
        cuts = []
        for quality in [60, 75, 85, 95]:
            settings = ["--channels", "normal", "--color-quality", str(quality)]
            size, info = built(options.lodpack, path, folder / "all.lodpack", *settings)
            finest, _ = built(options.lodpack, path, folder / "finest.lodpack", *settings, "--levels", "finest")
            cut = normals.Glb(extracted(options.lodpack, folder / "all.lodpack", folder / "cut.glb"))
            cuts.append(len(cut.triangles))
            median, rms = judge.angles(cut.mapped(*judge.closest(cut.positions, cut.triangles)))
            print(f"lodpack, quality {quality}, {len(cut.triangles)} triangles: {median:.2f}, {rms:.2f}; all levels {size / 1000:.1f}, finest {finest / 1000:.1f}; file {info['bytes'] / 1000:.1f}", flush=True)
        tree = cKDTree(positions)
        for own, corners in simplified(positions, triangles, sorted({cuts[0], len(triangles) // 4, len(triangles)})):
            nearest = tree.query(own)[1]
            exact, bare = judge.of_vertices[nearest], len(in_draco(own, corners))
            for bits in [3, 4, 5, 6, 7, 8, 10]:
                coded = in_draco(own, corners, normals=exact, normal_quantization_bits=bits)
                back = DracoPy.decode(coded)
                points, faces = np.asarray(back.points, dtype=float), np.asarray(back.faces).astype(int)
                found, weights = judge.closest(points, faces)
                shown = normals.unit((normals.unit(np.asarray(back.normals, dtype=float))[faces[found]] * weights).sum(axis=1))
                median, rms = judge.angles(shown)
                print(f"draco, {len(corners)} triangles, normals of {bits} bits: {median:.2f}, {rms:.2f}; {(len(coded) - bare) / 1000:.1f}, {len(coded) / 1000:.1f}", flush=True)


def main():
    parser = argparse.ArgumentParser()
    parser.add_argument("what", choices=["textures", "colours", "normals"])
    parser.add_argument("lodpack", type=os.path.abspath)
    parser.add_argument("models", nargs="+")
    parser.add_argument("--gltfpack", help='as "node node_modules/gltfpack/cli.js"')
    options = parser.parse_args()
    run = {"textures": textures, "colours": colours_of_vertices, "normals": normals_of_vertices}[options.what]
    with tempfile.TemporaryDirectory() as folder:
        run(options, pathlib.Path(folder))


if __name__ == "__main__":
    main()
