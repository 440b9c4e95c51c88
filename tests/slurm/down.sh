#!/bin/sh
# Stops what up.sh has started: down.sh DIR
for pid in "$1"/slurmd-*.pid "$1"/slurmctld.pid; do
  [ -f "$pid" ] && kill "$(cat "$pid")" 2> /dev/null
done
exit 0
