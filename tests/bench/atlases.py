#!/usr/bin/env python3
"""Stretch and use of `lodpack atlas` beside PyPI's xatlas, at like numbers of samples. Prints a Markdown table.

usage: atlases.py LODPACK MESH... [--resolution R]

A texture stands for a surface well where a step of one sample is as long everywhere and in all directions. L2 stretch
is the root of the mean square length of such steps, weighted by area and relative to an even map (Sander et al. 2001):
1 is best. The ratio is that of the longest step from a point to the shortest, its median by area: 1 keeps angles.
Lodpack's map is made of the cells of its images, each of two triangles, xatlas's of the triangles of the mesh. *Used*
is the share of stored samples that stand for a point of the surface of their own: of lodpack's without those that
neighbours have, too, of xatlas's without empty texels. Patches, which have no images, are left out of lodpack's
numbers, and their share of the triangles is printed. Times are CPU seconds, of lodpack's with reading and writing.
Needs numpy, trimesh, OpenEXR and xatlas (requirements.txt)."""
import argparse, json, pathlib, resource, subprocess, tempfile, time

import numpy as np, OpenEXR, trimesh, xatlas


def stretch(texture, surface):
    """L2 stretch and median ratio of maps from triangles of a texture (n x 3 x 2) to triangles in space (n x 3 x 3)."""
    (a, b), (p, q) = [np.moveaxis(corners[:, 1:] - corners[:, :1], 1, 0) for corners in (texture, surface)]
    flat = a[:, 0] * b[:, 1] - a[:, 1] * b[:, 0]
    area = np.linalg.norm(np.cross(p, q), axis=1)
    sound = (np.abs(flat) > 0) & (area > 0)
    a, b, p, q, flat, area = (values[sound] for values in (a, b, p, q, flat, area))
    along = (p * b[:, 1:] - q * a[:, 1:]) / flat[:, None]
    across = (q * a[:, :1] - p * b[:, :1]) / flat[:, None]
    e, f, g = (along * along).sum(1), (along * across).sum(1), (across * across).sum(1)
    middle, half = (e + g) / 2, np.sqrt(((e - g) / 2) ** 2 + f * f)
    longest, shortest = np.sqrt(middle + half), np.sqrt(np.maximum(middle - half, 1e-30))
    even = area.sum() / np.abs(flat).sum()
    order = np.argsort(longest / shortest)
    median = order[np.searchsorted(np.cumsum(area[order]), area.sum() / 2)]
    return np.sqrt((middle * area).sum() / area.sum() / even), (longest / shortest)[median]


def images_of(folder):
    """The positions of all images of an atlas."""
    for path in sorted(folder.glob("*.exr")):
        with OpenEXR.File(str(path)) as file:
            channels = {name.upper(): channel.pixels for name, channel in file.channels().items()}
        if "RGB" in channels:
            yield np.asarray(channels["RGB"], np.float64)
        elif {"X", "Y", "Z"} <= channels.keys():
            yield np.stack([channels[name] for name in "XYZ"], -1).astype(np.float64)


def cells(samples):
    """The triangles of the cells of an image, in the texture and in space."""
    rows, columns = samples.shape[:2]
    at = np.arange(rows * columns).reshape(rows, columns)
    a, b, c, d = at[:-1, :-1], at[:-1, 1:], at[1:, 1:], at[1:, :-1]
    triangles = np.concatenate([np.stack(three, -1).reshape(-1, 3) for three in ((a, b, c), (a, c, d))])
    places = np.stack(np.mgrid[:rows, :columns], -1).reshape(-1, 2).astype(np.float64)
    return places[triangles], samples.reshape(-1, 3)[triangles]


def by_lodpack(program, mesh, resolution, folder):
    """A row of the table, and the number of samples."""
    before = resource.getrusage(resource.RUSAGE_CHILDREN)
    chosen = [] if resolution is None else ["--resolution", str(resolution)]
    command = [program, "atlas", str(mesh), "-o", str(folder), *chosen]
    subprocess.run(command, check=True, stdout=subprocess.DEVNULL, stderr=subprocess.DEVNULL)
    after = resource.getrusage(resource.RUSAGE_CHILDREN)
    images = list(images_of(folder))
    texture, surface = (np.concatenate(parts) for parts in zip(*map(cells, images)))
    samples = np.concatenate([image.reshape(-1, 3) for image in images])
    distinct = len(np.unique(samples.astype(np.float32), axis=0))
    patches = sum(len(trimesh.load(path, process=False).faces) for path in folder.glob("patch_*.ply"))
    seconds = after.ru_utime + after.ru_stime - before.ru_utime - before.ru_stime
    return [len(images), len(samples), *stretch(texture, surface), distinct / len(samples), seconds], patches


def by_xatlas(mesh, samples):
    atlas = xatlas.Atlas()
    begin = time.process_time()
    atlas.add_mesh(np.asarray(mesh.vertices, np.float32), np.asarray(mesh.faces, np.uint32))
    options = xatlas.PackOptions()
    options.resolution = int(np.sqrt(samples))
    atlas.generate(pack_options=options)
    seconds = time.process_time() - begin
    vertices, triangles, places = atlas[0]
    size = np.array([atlas.width, atlas.height])
    texture = places[triangles].astype(np.float64) * size
    found = stretch(texture, np.asarray(mesh.vertices)[vertices][triangles])
    used = float(np.mean([atlas.utilization]) if np.isscalar(atlas.utilization) else np.mean(list(atlas.utilization)))
    return [atlas.chart_count, int(size.prod()) * max(1, atlas.atlas_count), *found, used, seconds]


def main():
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("lodpack")
    parser.add_argument("meshes", nargs="+", type=pathlib.Path)
    parser.add_argument("--resolution", type=int, help="steps along a side of lodpack's images")
    options = parser.parse_args()
    print("| mesh | | charts | samples | L2 stretch | ratio, median | samples used | CPU s |\n|---|---|---:|---:|---:|---:|---:|---:|")
    for path in options.meshes:
        mesh = trimesh.load(path, process=False, force="mesh")
        with tempfile.TemporaryDirectory() as folder:
            ours, patches = by_lodpack(options.lodpack, path, options.resolution, pathlib.Path(folder) / "atlas")
        rows = [(path.stem, "lodpack", ours), ("", f"xatlas {xatlas.__version__}", by_xatlas(mesh, ours[1]))]
        for name, program, (charts, samples, l2, ratio, used, seconds) in rows:
            print(f"| {name} | {program} | {charts:,} | {samples:,} | {l2:.2f} | {ratio:.2f} | {used:.0%} | {seconds:.1f} |")
        print(f"{path.stem}: {patches} of {len(mesh.faces)} triangles are in patches", flush=True)


if __name__ == "__main__":
    main()
