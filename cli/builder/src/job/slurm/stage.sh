#!/bin/sh
# Does the tasks of a stage of a lodpack job, one or several in each task of the array. Slurm reruns a task whose node dies;
# `lodpack submit` reruns one that fails.
#SBATCH --job-name=lodpack-@STAGE@
#SBATCH --array=@ARRAY@
#SBATCH --cpus-per-task=@CPUS@
#SBATCH --mem=@MEBIBYTES@M
#SBATCH --requeue
#SBATCH --open-mode=append
#SBATCH --output=@JOB@/slurm/@STAGE@-%a.log
set -eu
first=$((SLURM_ARRAY_TASK_ID * @PER_TASK@))
last=$((first + @PER_TASK@ - 1))
if [ "$last" -gt @LAST_PART@ ]; then last=@LAST_PART@; fi
echo "@STAGE@ $first to $last on $(hostname), node ${SLURMD_NODENAME:-unknown}, try $((${SLURM_RESTART_COUNT:-0} + 1))"
exec @LODPACK@ work @JOB@ --stage @STAGE@ --task "$first-$last" --memory @MEMORY@MiB --threads @CPUS@ --progress none
