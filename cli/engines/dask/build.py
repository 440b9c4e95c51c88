"""Builds a mesh with Dask: python build.py MESH OUT.lodpack [WORKERS] [SCHEDULER_ADDRESS]

Workers must see the job's directory. Without an address, Dask's local threads start the processes. Each worker does
tasks of all stages until none is left; what is done takes no time, so the same command continues after any
interruption.
"""

import os
import subprocess
import sys

import dask

LODPACK = os.environ.get("LODPACK", "lodpack")


def lodpack(*arguments):
    subprocess.run([LODPACK, *map(str, arguments)], check=True)


def main(mesh, out, workers="16", scheduler=None):
    job, count = out + ".job", int(workers)
    lodpack("plan", mesh, "-o", job, "--parts", 4 * count, "--stages", "--resume", "--progress", "none")
    work = dask.delayed(lambda number: lodpack("work", job, "--progress", "none"), pure=False)
    tasks = [work(number) for number in range(count)]
    if scheduler:
        from dask.distributed import Client

        with Client(scheduler):
            dask.compute(*tasks)
    else:
        dask.compute(*tasks, scheduler="threads")
    lodpack("merge", job, "-o", out, "--force", "--progress", "none")


if __name__ == "__main__":
    main(*sys.argv[1:])
