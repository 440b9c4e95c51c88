# %% [markdown]
# # A tour of lodpack in Python
#
# Run it cell by cell in an editor, or as a program: `python tour.py PATH_OR_ADDRESS [PICTURE.png]`.

# %%
import sys

import lodpack

source = sys.argv[1] if len(sys.argv) > 1 else "scan.lodpack"

# %% [markdown]
# Opening reads 8 kB, from a disk or a web server alike. Everything that is known then is in `info`.

# %%
file = lodpack.open(source)
info = file.info()
print(f"{info['source_triangles']:,} triangles became {info['roots']} roots of {len(info['levels'])} levels:")
for level in info["levels"]:
    print(f"  level {level['level']}: {level['triangles']:9,} triangles, at most {level['certified_error']:.3g} off the input")

# %% [markdown]
# A tolerance is a length: what is drawn is nowhere farther from the input, and the input nowhere farther from it.
# Whoever thinks in shares of the model or in edges multiplies.

# %%
coarse = file.extract(tolerance=8 * info["mean_edge_length"])
print(coarse)

# %% [markdown]
# A region, as fine as it gets: every root that touches the box, whole. The rest stays where it is, on the disk or on
# the server.

# %%
low, high = file.bounds
middle, reach = (low + high) / 2, (high - low) / 10
before = file.bytes_read
region = file.extract(bbox=(middle - reach, middle + reach))
print(region, "for", file.bytes_read - before, "bytes")

# %% [markdown]
# `select` answers from the index alone: how many triangles a query would give, how far off they would be, and why they
# are not fewer.

# %%
for triangles in (2_000, 10_000, 50_000):
    print(file.select(max_triangles=triangles))

# %% [markdown]
# Focus and context: a region at a fine tolerance, and around it the rest at its coarsest, without a crack in between.

# %%
focus = file.extract(bbox=(low, (middle[0], high[1], high[2])), context=True)
print(focus, "and", focus.error_everywhere, "outside")

# %% [markdown]
# Arrays of numpy are the decoder's own memory. For an area no other library is needed.

# %%
import numpy as np

a, b, c = (focus.positions[focus.triangles[:, corner]] for corner in range(3))
area = np.linalg.norm(np.cross(b - a, c - a), axis=1).sum() / 2
print(f"area {area:.4g}")

# %% [markdown]
# What the surface carries besides positions comes with it if it is asked for: here the first channel of colours, if the
# file has one.

# %%
for channel in file.channels:
    print(f"{channel['name']}: {channel['kind']}, {channel['bytes'] / 1e3:.1f} kB")
coloured = file.extract(tolerance=8 * info["mean_edge_length"], channels="auto")
if coloured.colours is not None:
    print("mean colour", coloured.colours.mean(axis=0).round(), coloured.textured())

# %% [markdown]
# A mesh may stand on heights in the same file. Their mesh comes in the space of the mesh on them; their samples are an
# array of two dimensions.

# %%
ground = file.ground()
if ground is not None:
    print(ground.extract(tolerance=8 * info["mean_edge_length"]))
    print(ground.heights.window().heights.shape, "samples; to the mesh by", ground.transform.tolist())

# %% [markdown]
# Where trimesh, PyVista or Open3D are installed, a mesh becomes one of theirs. PyVista's cells know their level and
# their error, and `pyvista.read("scan.lodpack", tolerance=...)` works without this package being imported.

# %%
if len(sys.argv) > 2:
    import pyvista

    plotter = pyvista.Plotter(off_screen=True, window_size=(900, 600))
    plotter.add_mesh(focus.to_pyvista(), scalars="level", show_edges=True)
    plotter.screenshot(sys.argv[2])
    print("wrote", sys.argv[2])
