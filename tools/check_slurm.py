"""Runs a small comparison's cells as Slurm job arrays and checks that they are those of `corf bench run`.

    tools/slurm_local.sh start; python3 tools/check_slurm.py CORF; tools/slurm_local.sh stop

CORF is the program. The folder has an odd name. One job is requeued while it runs, as when its node had died: Slurm counts one restart,
and the log begins with what it held before. A plan of one cell more than an array takes is submitted as two arrays, held, and cancelled. Exit code 1 where a number
differs, a job does not end, or something else was submitted than is said.
"""

import json
import subprocess
import sys
import tempfile
import time
from pathlib import Path

PLAN = """name = "array"
dataset = "{dataset}"
seeds = [1, 2]
[[row]]
label = "CORF-GS"
method = "corf-gs"
[row.config]
iterations_per_keyframe = 600
[[row]]
label = "nearest"
method = "nearest"
"""
# What Slurm and the shell read their own way.
ODD_NAME = "an array #1 it's \"50% %A\" $HOME `x` ;*?"
LONG_PLAN = """name = "long"
dataset = "{dataset}"
seeds = [{seeds}]
[[row]]
label = "nearest"
method = "nearest"
"""
# Longest wait for all jobs, seconds.
PATIENCE_S = 600


def run(*command):
    """Standard output of a command that has to succeed."""
    done = subprocess.run([str(c) for c in command], capture_output=True, text=True, check=False)
    if done.returncode != 0:
        sys.exit(f"{' '.join(map(str, command))}: exit code {done.returncode}\n{done.stderr}")
    return done.stdout


def frames(record):
    """A record's frames without the times that rendering took."""
    return [{k: v for k, v in frame.items() if k != "render_s"} for frame in json.loads(record.read_text())["frames"]]


def queue():
    """Jobs in the queue: id of the task and state."""
    return [line.split() for line in run("squeue", "--noheader", "--array", "--format=%i %T").splitlines()]


def log_of(out, job):
    """What a job of the array has said so far."""
    path = out / "logs" / f"{job}.log"
    return path.read_text() if path.exists() else ""


def main(corf):
    """Runs the comparison both ways."""
    corf = Path(corf).resolve()
    with tempfile.TemporaryDirectory() as folder:
        folder = Path(folder)
        run(corf, "dataset", "generate", "scenes/room-tiny.toml", "--out", folder / "data")
        (folder / "plan.toml").write_text(PLAN.format(dataset=folder / "data"))
        run(corf, "bench", "run", folder / "plan.toml", "--out", folder / "whole", "--device", "cpu")
        out = folder / ODD_NAME
        run(corf, "bench", "plan", folder / "plan.toml", "--out", out)
        print(run(corf, "bench", "submit", out, "--slurm", "--device", "cpu", "--sbatch=--cpus-per-task=1").strip())
        requeued, said_before, begin = None, "", time.time()
        while jobs := queue():
            if time.time() - begin > PATIENCE_S:
                sys.exit(f"the jobs did not end within {PATIENCE_S} s: {jobs}")
            running = [job for job, state in jobs if state == "RUNNING" and "_" in job]
            # A job that has said something is one whose program runs, and a cell takes seconds, so that it is still running.
            speaking = [job for job in running if log_of(out, job)]
            if requeued is None and speaking:
                requeued = speaking[0]
                said_before = log_of(out, requeued)
                subprocess.run(["scontrol", "requeue", requeued], check=True)
                print(f"requeued {requeued}")
            time.sleep(0.1)
        if requeued is None:
            sys.exit("no job was seen running, so that none was requeued")
        for name in ["corf-gs-seed1", "corf-gs-seed2", "nearest-seed1", "nearest-seed2"]:
            whole, array = (frames(f / "cells" / f"{name}.json") for f in (folder / "whole", out))
            if whole != array:
                sys.exit(f"{name}: the job array's numbers are others")
        if not (out / "report.html").exists():
            sys.exit("the collecting job wrote no report; see " + (out / "logs/collect.log").read_text())
        logs = sorted(path.name for path in (out / "logs").iterdir())
        if len(logs) != 5 or "collect.log" not in logs:
            sys.exit(f"the logs of four cells and of the collecting job are {logs}")
        said = log_of(out, requeued)
        if not said.startswith(said_before) or len(said) == len(said_before):
            sys.exit(f"the log of {requeued} is {said!r}; before it was requeued it was {said_before!r}")
        if "Restarts=1 " not in run("scontrol", "show", "job", requeued):
            sys.exit(f"Slurm did not run {requeued} twice")
        print("4 cells of a job array have the numbers of `corf bench run`, one of them requeued while it ran")
        long_sweep(corf, folder)


def long_sweep(corf, folder):
    """Submits one cell more than an array takes, and looks at what is in the queue."""
    config = run("scontrol", "show", "config")
    most = int(next(line.split("=")[1] for line in config.splitlines() if line.startswith("MaxArraySize")))
    seeds = ", ".join(str(seed) for seed in range(most + 1))
    (folder / "long.toml").write_text(LONG_PLAN.format(dataset=folder / "data", seeds=seeds))
    out = folder / "long"
    run(corf, "bench", "plan", folder / "long.toml", "--out", out)
    said = json.loads(run(corf, "--json", "bench", "submit", out, "--slurm", "--device", "cpu", "--sbatch=--hold"))
    waiting = [job.split("_")[0] for job, _ in queue()]
    run("scancel", *said["arrays"], said["collect"])
    counts = [waiting.count(job) for job in [*said["arrays"], said["collect"]]]
    if said["cells"] != most + 1 or counts != [most, 1, 1] or len(waiting) != most + 2:
        sys.exit(f"{said} was submitted, and the queue holds {counts} of {len(waiting)} jobs")
    ids = (out / "slurm").glob("ids-*")
    if [len(path.read_text().split()) for path in ids] != [most + 1]:
        sys.exit("the list of ids is not that of all cells")
    print(f"{most + 1} cells are arrays of {most} and 1, and a job that collects them")


if __name__ == "__main__":
    if len(sys.argv) != 2:
        sys.exit(__doc__)
    main(sys.argv[1])
