#!/bin/sh
# Stops the nodes that up.sh started: down.sh DIR
for pid in "$1"/slurmd-*.pid "$1"/slurmctld.pid; do
  [ -f "$pid" ] && kill "$(cat "$pid")" 2> /dev/null
done
exit 0
