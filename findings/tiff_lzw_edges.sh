#!/usr/bin/env bash
# What one would guess: a decoder that reads all inner tiles of a TIFF reads those at its right edge as well.
# What is so (crates tiff 0.11.3, weezl 0.1.12): an LZW tile that is wider than what is left of the image is often
# refused with "no lzw end code found" if its samples repeat. The crate reads each row up to the edge of the image and
# drops the rest of the row, which other compressions bear. GDAL reads all of them.
# Consequence: lodpack tells the crate that the image has whole tiles, and cuts off what lies beyond its edge.
set -euo pipefail
folder=$(mktemp -d)
trap 'rm -rf "$folder"' EXIT
cd "$folder"
python3 -m venv env
env/bin/pip install --quiet --disable-pip-version-check numpy==2.4.6 rasterio==1.4.4
env/bin/python - <<'PY'
import numpy as np, rasterio, warnings
warnings.simplefilter("ignore")
ramp = np.broadcast_to(np.arange(257, dtype=np.uint16) % 200, (130, 257))
noise = np.random.default_rng(1).integers(0, 65536, (130, 257), dtype=np.uint16)
layout = dict(driver="GTiff", width=257, height=130, count=1, dtype="uint16")
tiles = dict(tiled=True, blockxsize=128, blockysize=128)
for kind, samples, compress in [("ramp", ramp, "lzw"), ("ramp", ramp, "deflate"), ("noise", noise, "lzw")]:
    name = f"{kind}-{compress}.tif"
    with rasterio.open(name, "w", compress=compress, **layout, **tiles) as file:
        file.write(samples, 1)
    assert (rasterio.open(name).read(1) == samples).all()
PY
mkdir -p src
cat > Cargo.toml <<'TOML'
[package]
name = "edges"
version = "0.0.0"
edition = "2021"
[dependencies]
tiff = "=0.11.3"
weezl = "=0.1.12"
TOML
cat > src/main.rs <<'RS'
fn main() {
    let refused = |name: &str| {
        let mut file = tiff::decoder::Decoder::new(std::fs::File::open(name).unwrap()).unwrap();
        let count = file.tile_count().unwrap();
        let refused: Vec<u32> = (0..count).filter(|&tile| file.read_chunk(tile).is_err()).collect();
        println!("{name}: {count} tiles, refused: {refused:?}");
        refused
    };
    assert_eq!(refused("ramp-deflate.tif"), []);
    assert_eq!(refused("noise-lzw.tif"), []);
    assert_eq!(refused("ramp-lzw.tif"), [2], "this has changed");
}
RS
cargo run --quiet
