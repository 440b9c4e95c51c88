#!/bin/sh
# Builds a mesh in parts with GNU parallel: build.sh MESH OUT.lodpack [PARTS] [options of parallel, as --sshlogin HOSTS]
# The same command continues after any interruption: finished parts are not built again.
set -eu
lodpack=${LODPACK:-lodpack}
mesh=$1 out=$2 parts=${3:-16}
shift; shift; [ $# -eq 0 ] || shift
"$lodpack" plan "$mesh" -o "$out.job" --parts "$parts" --resume --progress none
seq 0 $((parts - 1)) | parallel --halt soon,fail=1 "$@" "$lodpack" build --job "$out.job" --part {} --progress none
"$lodpack" merge "$out.job" -o "$out" --force --progress none
