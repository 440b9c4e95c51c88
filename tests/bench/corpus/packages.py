"""Where the files come from: packages by their ordinary clients, at pinned versions."""
import hashlib
import pathlib
import struct
import subprocess
import tarfile
import zipfile

# Client, name, version. `source` is the upstream archive of a Debian source package.
PACKAGES = [
    ("deb", "assimp-testmodels", "5.2.5~ds0-1"),
    ("deb", "cura", "4.13.0-1"),
    ("deb", "prusa-slicer", "2.5.0+dfsg-4"),
    ("deb", "r-cran-raster", "3.6-14-1"),
    ("deb", "r-cran-rgdal", "1.6-4+dfsg-1"),
    ("deb", "r-cran-sf", "1.0-9+dfsg-1+b1"),
    ("deb", "r-cran-stars", "0.6-0-4"),
    ("deb", "r-cran-terra", "1.7-3-1"),
    ("deb", "r-cran-tiff", "0.1-11-1+b1"),
    ("deb", "r-cran-wkutils", "0.1.3-1"),
    ("npm", "@webxr-input-profiles/assets", "1.0.20"),
    ("pip", "compas", "2.15.1", "--no-binary=:all:"),
    ("pip", "dm_control", "1.0.50"),
    ("pip", "earthpy", "1.0.0"),
    ("pip", "genesis-world", "1.4.5"),
    ("pip", "gymnasium-robotics", "1.4.2"),
    ("pip", "mani-skill", "3.0.1"),
    ("pip", "meshio", "5.3.5", "--no-binary=:all:"),
    ("pip", "metaworld", "3.1.1"),
    ("pip", "pybullet", "3.2.7"),
    ("pip", "pyglet", "2.1.19", "--no-binary=:all:"),
    ("pip", "pyvista", "0.49.1"),
    ("pip", "rasterstats", "0.21.0", "--no-binary=:all:"),
    ("pip", "robosuite", "1.5.2"),
    ("source", "draco", "1.5.5+dfsg-2"),
    ("source", "gdal", "3.6.2+dfsg-1"),
    ("source", "geomview", "1.9.5-4"),
    ("source", "libpng1.6", "1.6.39-2+deb12u5"),
    ("source", "openexr", "3.1.5-5"),
    ("source", "openmesh", "9.0-4"),
    ("source", "tiff", "4.5.0-6+deb12u4"),
    ("source", "tinygltf", "2.7.0+dfsg-2"),
    ("source", "tinyobjloader", "2.0.0~rc10+dfsg-2"),
]
MESHES = {"obj": "OBJ", "ply": "PLY", "off": "OFF", "stl": "STL", "gltf": "glTF", "glb": "GLB"}
RASTERS = {"tif": "TIFF", "tiff": "TIFF", "png": "PNG", "asc": "ASC", "hgt": "HGT", "bil": "BIL", "exr": "EXR"}


def fetch(cache):
    """Downloads and unpacks what the cache lacks; yields each package's name and folder."""
    for client, name, version, *options in PACKAGES:
        folder = cache / "unpacked" / f"{client} {name.replace('/', '+')} {version}"
        if not folder.exists():
            down = cache / "downloads" / folder.name
            down.mkdir(parents=True, exist_ok=True)
            try:
                download(client, name, version, options, cache, down)
                part = folder.with_name(folder.name + ".part")
                part.mkdir(parents=True, exist_ok=True)
                for archive in sorted(down.iterdir()):
                    unpack(archive, part)
                part.rename(folder)
            except (subprocess.SubprocessError, OSError) as why:
                print(f"note: {client} {name} {version} cannot be had: {why}", flush=True)
                continue
        yield f"{client} {name}", folder


def download(client, name, version, options, cache, down):
    if client == "pip":
        words = ["pip", "download", "-q", "--no-deps", *options, "-d", down, f"{name}=={version}"]
    elif client == "npm":
        words = ["npm", "pack", "-s", "--pack-destination", down, f"{name}@{version}"]
    elif client == "deb":
        words = ["apt-get", "download", "-qq", f"{name}={version}"]
    else:
        words = ["apt-get", *source_lists(cache), "-qq", "source", "--download-only", "--tar-only", f"{name}={version}"]
    subprocess.run([str(word) for word in words], cwd=down, check=True, timeout=900, stdout=subprocess.DEVNULL)


def source_lists(cache):
    """Options that let apt-get see the sources of the archives that the machine knows, without changing its
    settings."""
    own = cache / "apt"
    options = ["-o", "Dir::Etc::sourcelist=/dev/null", "-o", f"Dir::Etc::sourceparts={own}/etc", "-o", f"Dir::State::lists={own}/lists"]
    if not (own / "lists").exists():
        (own / "etc").mkdir(parents=True)
        (own / "lists" / "partial").mkdir(parents=True)
        known = pathlib.Path("/etc/apt/sources.list.d/debian.sources").read_text()
        (own / "etc" / "own.sources").write_text(known.replace("Types: deb\n", "Types: deb deb-src\n"))
        subprocess.run(["apt-get", *options, "-qq", "update"], check=True, timeout=900)
    return options


def unpack(archive, folder):
    if archive.suffix == ".whl":
        zipfile.ZipFile(archive).extractall(folder)
    elif archive.suffix == ".deb":
        subprocess.run(["dpkg-deb", "-x", archive, folder], check=True)
    elif ".tar" in archive.name or archive.suffix == ".tgz":
        if archive.suffix != ".asc":
            tarfile.open(archive).extractall(folder, filter="data")


def files(cache, largest, most):
    """Distinct files (format, package, path, hash), at most `most` of one format from a package; which ones, their
    hashes say."""
    seen, found = set(), []
    for package, folder in fetch(cache):
        own = {}
        for path in sorted(folder.rglob("*")):
            form = {**MESHES, **RASTERS}.get(path.suffix[1:].lower())
            if form is None or not path.is_file() or path.is_symlink() or not 0 < path.stat().st_size <= largest:
                continue
            data = path.read_bytes()
            if form == "OBJ" and data[:1] in (b"\x7f", b"\x4c", b"\x64") or form == "PNG" and not is_grey(data):
                continue
            key = hashlib.sha256(data).hexdigest()[:16]
            if key not in seen:
                seen.add(key)
                own.setdefault(form, []).append((key, form, package, path))
        found += [file for form in sorted(own) for file in sorted(own[form])[:most]]
    return found


def is_grey(png):
    """Whether a PNG may hold heights: shades of grey, with or without alpha."""
    return png[12:16] == b"IHDR" and struct.unpack(">B", png[25:26])[0] in (0, 4)
