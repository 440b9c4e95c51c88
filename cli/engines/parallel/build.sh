#!/bin/sh
# Builds a mesh with GNU parallel: build.sh MESH OUT.lodpack [WORKERS] [options of parallel, as --sshlogin HOSTS]
# Each worker does tasks of all stages until none is left. The same command continues after any interruption.
set -eu
lodpack=${LODPACK:-lodpack}
mesh=$1 out=$2 workers=${3:-16}
shift; shift; [ $# -eq 0 ] || shift
"$lodpack" plan "$mesh" -o "$out.job" --parts "$((4 * workers))" --stages --resume --progress none
seq "$workers" | parallel --jobs "$workers" --halt soon,fail=1 -N0 "$@" "$lodpack" work "$out.job" --progress none
"$lodpack" merge "$out.job" -o "$out" --force --progress none
