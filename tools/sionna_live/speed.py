"""Time and error of both sides at the same receivers."""

import json
import resource
import time
from contextlib import contextmanager
from pathlib import Path

import numpy as np


@contextmanager
def stopwatch(children=False):
    """Seconds on the wall and seconds of CPU (all threads; of child processes where asked)."""
    cpu = (lambda: sum(resource.getrusage(resource.RUSAGE_CHILDREN)[:2])) if children else time.process_time
    taken = {}
    wall, busy = time.perf_counter(), cpu()
    yield taken
    taken["wall_s"], taken["cpu_s"] = time.perf_counter() - wall, cpu() - busy


def theirs_totals(library, tx, receivers, depth, samples, seed):
    """One run with everything on: linear power at every receiver (all paths; diffuse ones), and its time."""
    from .sionna_runner import ends_scattering

    with stopwatch() as taken:
        s = library.solve_scattered(tx, receivers, depth, samples, seed)
    power = np.where(s["valid"], np.abs(s["a"].astype(np.complex128)) ** 2, 0.0)[:, 0]
    scattered = (s["interactions"] == 2).any(0)[:, 0]
    ending = ends_scattering(s["interactions"])[:, 0]
    totals = {"total": power, "diffuse": power * scattered, "ending": power * ending}
    return {**{name: p.sum(1) for name, p in totals.items()}, **taken, "arrivals": s, "power": power}


def error_db(samples):
    """Standard deviation of one run relative to the mean, in dB, by receiver: samples (runs, receivers)."""
    samples = np.asarray(samples)
    return 10 / np.log(10) * samples.std(0, ddof=1) / samples.mean(0)


def lobes(directions, power, pixels, width_deg):
    """Power per steradian at pixel directions: every arrival a Gaussian of this width (mpc)."""
    kappa = 1.0 / np.radians(width_deg) ** 2
    total = np.zeros(len(pixels))
    for begin in range(0, len(directions), 4000):
        cosine = np.clip(directions[begin : begin + 4000] @ pixels.T, -1, 1)
        total += power[begin : begin + 4000] @ np.exp(-0.5 * kappa * np.arccos(cosine) ** 2)
    return total * kappa / (2 * np.pi)


def run_bench(corf, config, *options):
    """`corf bench radio`: its JSON, with the dataset file by name alone, and the time of the whole process."""
    with stopwatch(children=True) as taken:
        text = corf.run("bench", "radio", config, "--json", *options)
    return {**json.loads(text), "config": Path(config).name}, taken
