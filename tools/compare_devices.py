"""The same reconstruction on two devices, over many seeds: do they end at the same quality?

    python3 tools/compare_devices.py data/lobby-mini --seeds 144 --out devices.csv

One seed says nothing: rounding alone moves a run by up to a decibel or two. For each seed both devices reconstruct, the processor evaluates both
fields, and differences are paired. Writes every seed's metrics (CSV) and prints means with 95 % confidence intervals. Needs nothing but Python and
a `corf` with the GPU device (`cargo build --release -p corf-bench --features gpu`).
"""

import argparse
import csv
import json
import math
import os
import subprocess
import sys
import tempfile
from concurrent.futures import ThreadPoolExecutor
from pathlib import Path

METRICS = ["psnr_opt", "psnr_rf_jet", "psnr_rf_scalar", "ssim_opt"]
# Two-sided 95 % of a normal distribution; there are many seeds.
Z95 = 1.96


def arguments():
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("dataset", help="dataset folder")
    parser.add_argument("--seeds", type=int, default=72)
    parser.add_argument("--devices", default="cpu,gpu", help="two devices, comma-separated (default: cpu,gpu)")
    parser.add_argument("--jobs", type=int, default=1, help="seeds at once on each device")
    parser.add_argument("--threads", type=int, help="threads of each run (default: one per core)")
    parser.add_argument("--corf", default=os.path.join(os.environ.get("CARGO_TARGET_DIR", "target"), "release/corf"))
    parser.add_argument("--out", default="devices.csv")
    parser.add_argument("--set", action="append", default=[], metavar="KEY=VALUE", help="a setting of `corf reconstruct`; repeat for more")
    args = parser.parse_args()
    if args.seeds < 2 or args.jobs < 1 or len(set(args.devices.split(","))) != 2:
        parser.error("give two different devices, at least two seeds and one job")
    return args


def run(command):
    done = subprocess.run(command, capture_output=True, text=True)
    if done.returncode != 0:
        raise SystemExit(f"{' '.join(command)} ended with {done.returncode}:\n{done.stderr}")
    return done.stdout


def metrics_of(args, device, seed, scratch):
    out = Path(scratch) / f"{device}-{seed}"
    threads = ["--threads", str(args.threads)] if args.threads else []
    seeded = ["--seed", str(seed), "--device", device, "--out", str(out)]
    settings = [part for one in args.set for part in ("--set", one)]
    run([args.corf, "reconstruct", args.dataset, *seeded, *threads, *settings])
    means = json.loads(run([args.corf, "evaluate", str(out), "--device", "cpu", "--json", *threads]))["means"]
    print(f"seed {seed}, {device}: " + ", ".join(f"{m} {means[m]:.3f}" for m in METRICS), file=sys.stderr)
    return [means[m] for m in METRICS]


def of_device(args, device, scratch):
    with ThreadPoolExecutor(args.jobs) as pool:
        return list(pool.map(lambda seed: metrics_of(args, device, seed, scratch), range(1, args.seeds + 1)))


def mean_and_deviation(values):
    mean = sum(values) / len(values)
    return mean, math.sqrt(sum((v - mean) ** 2 for v in values) / (len(values) - 1))


def main():
    args = arguments()
    devices = args.devices.split(",")
    with tempfile.TemporaryDirectory() as scratch, ThreadPoolExecutor(2) as both:
        first, second = both.map(lambda device: of_device(args, device, scratch), devices)
    written = Path(args.out + ".new")
    with written.open("w", newline="") as file:
        rows = csv.writer(file, lineterminator="\n")
        rows.writerow(["seed", *(f"{m} {device}" for device in devices for m in METRICS)])
        rows.writerows([seed, *a, *b] for seed, (a, b) in enumerate(zip(first, second), 1))
    written.rename(args.out)
    print(f"| metric | {devices[0]} | {devices[1]} | difference, paired |\n|---|---:|---:|---:|")
    for k, metric in enumerate(METRICS):
        a, b = ([row[k] for row in rows] for rows in (first, second))
        difference, deviation = mean_and_deviation([y - x for x, y in zip(a, b)])
        interval = Z95 * deviation / math.sqrt(len(a))
        print(f"| {metric} | {mean_and_deviation(a)[0]:.3f} | {mean_and_deviation(b)[0]:.3f} | {difference:+.3f} ± {interval:.3f} |")


if __name__ == "__main__":
    main()
