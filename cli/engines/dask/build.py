"""Builds a mesh in parts with Dask: python build.py MESH OUT.lodpack [PARTS] [SCHEDULER_ADDRESS]

Workers must see the job's directory. Without an address, Dask's local threads start the processes. Finished parts take no
time, so the same command continues after any interruption.
"""

import json
import os
import subprocess
import sys

import dask

LODPACK = os.environ.get("LODPACK", "lodpack")


def lodpack(*arguments):
    subprocess.run([LODPACK, *map(str, arguments)], check=True)


def main(mesh, out, parts="16", scheduler=None):
    job = out + ".job"
    lodpack("plan", mesh, "-o", job, "--parts", parts, "--resume", "--progress", "none")
    with open(os.path.join(job, "job.json")) as manifest:
        count = len(json.load(manifest)["parts"])
    part = dask.delayed(lambda number: lodpack("build", "--job", job, "--part", number, "--progress", "none"))
    tasks = [part(number) for number in range(count)]
    if scheduler:
        from dask.distributed import Client

        with Client(scheduler):
            dask.compute(*tasks)
    else:
        dask.compute(*tasks, scheduler="threads")
    lodpack("merge", job, "-o", out, "--force", "--progress", "none")


if __name__ == "__main__":
    main(*sys.argv[1:])
