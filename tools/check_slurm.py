"""Runs a small comparison's cells as a Slurm job array and checks that they are those of `corf bench run`.

    tools/slurm_local.sh start; python3 tools/check_slurm.py CORF; tools/slurm_local.sh stop

CORF is the program. One job is requeued while it runs, as when its node had died. Exit code 1 where a number differs or a job does not end.
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
iterations_per_keyframe = 60
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


def main(corf):
    """Runs the comparison both ways."""
    corf = Path(corf).resolve()
    with tempfile.TemporaryDirectory() as folder:
        folder = Path(folder)
        run(corf, "dataset", "generate", "scenes/room-tiny.toml", "--out", folder / "data")
        (folder / "plan.toml").write_text(PLAN.format(dataset=folder / "data"))
        run(corf, "bench", "run", folder / "plan.toml", "--out", folder / "whole", "--device", "cpu")
        out = folder / "array"
        run(corf, "bench", "plan", folder / "plan.toml", "--out", out)
        print(run(corf, "bench", "submit", out, "--slurm", "--device", "cpu", "--sbatch=--cpus-per-task=1").strip())
        requeued, begin = None, time.time()
        while jobs := queue():
            if time.time() - begin > PATIENCE_S:
                sys.exit(f"the jobs did not end within {PATIENCE_S} s: {jobs}")
            running = [job for job, state in jobs if state == "RUNNING" and "_" in job]
            if requeued is None and running:
                time.sleep(0.5)
                requeued = running[0]
                subprocess.run(["scontrol", "requeue", requeued], check=False)
                print(f"requeued {requeued}")
            time.sleep(0.5)
        if requeued is None:
            sys.exit("no job was seen running, so that none was requeued")
        for name in ["corf-gs-seed1", "corf-gs-seed2", "nearest-seed1", "nearest-seed2"]:
            whole, array = (frames(f / "cells" / f"{name}.json") for f in (folder / "whole", out))
            if whole != array:
                sys.exit(f"{name}: the job array's numbers are others")
        if not (out / "report.html").exists():
            sys.exit("the collecting job wrote no report; see " + (out / "logs/collect.log").read_text())
    print("4 cells of a job array have the numbers of `corf bench run`, one of them requeued while it ran")


if __name__ == "__main__":
    if len(sys.argv) != 2:
        sys.exit(__doc__)
    main(sys.argv[1])
