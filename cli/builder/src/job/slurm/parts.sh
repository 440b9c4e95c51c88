#!/bin/sh
# Builds the parts of a lodpack job, one or several in each task. Slurm reruns a task whose node dies; `lodpack submit` reruns
# one that fails.
#SBATCH --job-name=lodpack-parts
#SBATCH --array=@ARRAY@
#SBATCH --cpus-per-task=@CPUS@
#SBATCH --mem=@MEBIBYTES@M
#SBATCH --requeue
#SBATCH --open-mode=append
#SBATCH --output=@JOB@/slurm/parts-%a.log
set -eu
first=$((SLURM_ARRAY_TASK_ID * @PER_TASK@))
last=$((first + @PER_TASK@ - 1))
if [ "$last" -gt @LAST_PART@ ]; then last=@LAST_PART@; fi
echo "parts $first to $last on $(hostname), node ${SLURMD_NODENAME:-unknown}, try $((${SLURM_RESTART_COUNT:-0} + 1))"
exec @LODPACK@ build --job @JOB@ --part "$first-$last" --memory @MEMORY@MiB --threads @CPUS@ --progress none
