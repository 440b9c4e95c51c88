#!/bin/sh
# Joins the parts of a lodpack job when all are built.
#SBATCH --job-name=lodpack-merge
#SBATCH --cpus-per-task=1
#SBATCH --requeue
#SBATCH --open-mode=append
#SBATCH --output=@JOB@/slurm/merge.log
set -eu
echo "merge on $(hostname), node ${SLURMD_NODENAME:-unknown}"
exec @LODPACK@ merge @JOB@ -o @OUTPUT@ --force --progress none
