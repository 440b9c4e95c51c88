#!/bin/sh
# Starts three nodes of Slurm on this machine, as root: up.sh DIR, with a new directory for the state. Prints the path of the configuration.
set -eu
folder=$(dirname "$0")
mkdir -p "$1/state" "$1/spool/n1" "$1/spool/n2" "$1/spool/n3"
dir=$(cd "$1" && pwd)
SLURM_CONF=$dir/slurm.conf
export SLURM_CONF
sed "s#@HOST@#$(hostname -s)#g; s#@DIR@#$dir#g" "$folder/slurm.conf.in" > "$SLURM_CONF"
if ! pgrep -x munged > /dev/null; then
  mkdir -p /run/munge /var/log/munge /var/lib/munge
  chown munge:munge /run/munge /var/log/munge /var/lib/munge
  chmod 755 /run/munge
  [ -f /etc/munge/munge.key ] || { dd if=/dev/urandom of=/etc/munge/munge.key bs=1024 count=1 2> /dev/null; chown munge:munge /etc/munge/munge.key; chmod 400 /etc/munge/munge.key; }
  setsid runuser -u munge -- /usr/sbin/munged
fi
slurmctld -c
for node in n1 n2 n3; do slurmd -N $node; done
tries=0
while [ "$(sinfo -h -N -t idle -o %N | wc -l)" -ne 3 ]; do
  tries=$((tries + 1))
  [ $tries -lt 150 ] || { sinfo -N >&2; exit 1; }
  sleep 0.2
done
echo "$SLURM_CONF"
