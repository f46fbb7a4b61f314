"""What both sides cost at equal error: Markdown, CSV, pictures."""

import csv
import datetime

import matplotlib.pyplot as plt
import numpy as np

from . import speed
from .pictures import CORF, INK, THEIRS, save
from .report import table

KINDS = {
    "total_db": "total power, worst position",
    "diffuse_db": "diffuse power, worst position",
    "diffuse_rms_db": "diffuse power, rms over positions",
    "pixel_median_db": "1° lobes, spectrum pixels within 30 dB of the peak, median",
    "pixel_p99_db": "the same, 99 % of them better than",
    "bartlett_median_db": "Bartlett spectrum of the 8×8 array, pixels within 30 dB of the peak, median",
    "bartlett_p99_db": "the same, 99 % of them better than",
    "bartlett_worst_db": "the same, worst pixel of all positions",
}
# A run's errors by the names they have here.
RUN_KINDS = {
    "ours": {
        "total_db": "total_worst_db",
        "diffuse_db": "diffuse_worst_db",
        "diffuse_rms_db": "diffuse_rms_db",
        "pixel_median_db": "pixel_median_db",
        "pixel_p99_db": "pixel_p99_db",
    },
    "bartlett": {"bartlett_median_db": "pixel_median_db", "bartlett_p99_db": "pixel_p99_db", "bartlett_worst_db": "pixel_worst_db"},
}

# What the runs for powers alone are compared by: diffuse power that ends with the scattering.
POWERS_KINDS = {"ending_rms_db": "rms over positions", "ending_db": "worst position"}
# Stages of `corf bench radio` that a transmitter costs once.
ONCE = ("hierarchy", "transmitter_chains", "photons")


def for_all(result, ours):
    """corf's seconds for all positions: as measured, or scaled up position by position from fewer."""
    factor = result["positions"] / ours["positions"]
    stages = {name: s for name, s in ours["seconds"].items() if name != "total"}
    return {clock: sum((s[clock] or 0) * (1 if name in ONCE else factor) for name, s in stages.items()) for clock in ("wall_s", "cpu_s")}


def laws(result):
    """Per number of rays: errors of one run, and mean seconds of a call; and per kind the exponent of error ∝ rays^exponent."""
    theirs = result["theirs"]
    counts = sorted({run["samples"] for run in theirs["runs"]})
    rows = []
    for samples in counts:
        runs = [run for run in theirs["runs"] if run["samples"] == samples]
        pixel, array = (theirs[kind].get(samples) or theirs[kind][str(samples)] for kind in ("pixels", "bartlett"))
        error = {what: speed.error_db([r[what] for r in runs]) for what in ("total", "diffuse", "ending")}
        rows.append(
            {
                "samples": samples,
                "total_median_db": float(np.median(error["total"])),
                **{f"{what}_db": float(e.max()) for what, e in error.items()},
                **{f"{what}_rms_db": float(np.sqrt(np.mean(e**2))) for what, e in error.items()},
                "pixel_median_db": pixel["median_db"],
                "pixel_p99_db": pixel["p99_db"],
                **{f"bartlett_{what}": array[what] for what in ("median_db", "p99_db", "worst_db")},
                "wall_s": float(np.median([r["wall_s"] for r in runs])),
                "cpu_s": float(np.median([r["cpu_s"] for r in runs])),
            }
        )
    exponent = {kind: float(np.polyfit(np.log(counts), np.log([row[kind] for row in rows]), 1)[0]) for kind in KINDS}
    return rows, exponent


def equal_error(result):
    """For every kind of error: the rays with which Sionna RT would have corf's, and both sides' seconds for all positions."""
    rows, _ = laws(result)
    kinds = []
    for which, names in RUN_KINDS.items():
        run = result[which]["report"]
        kinds += [(kind, KINDS[kind], run["standard_error"][name], for_all(result, run)) for kind, name in names.items()]
    for run in (run["report"] for run in result["powers"]):
        error = {"ending_db": run["standard_error"]["diffuse_worst_db"], "ending_rms_db": run["standard_error"]["diffuse_rms_db"]}
        for kind, where in POWERS_KINDS.items():
            label = f"powers alone, {run['directions']} directions: {where}"
            kinds.append((kind, label, error[kind], for_all(result, run)))
    calls = result["positions"] / len(result["traced"])
    most = rows[-1]
    slope = {
        clock: max(np.polyfit([r["samples"] for r in rows], [r[clock] for r in rows], 1)[0], 0.0) for clock in ("wall_s", "cpu_s")
    }
    lines = []
    for kind, label, corf_db, spent in kinds:
        # σ² ∝ 1/rays, as of independent rays, also where the measured law is another.
        needed = most["samples"] * (most[kind] / corf_db) ** 2
        seconds = {clock: calls * (most[clock] + slope[clock] * (needed - most["samples"])) for clock in slope}
        least = {clock: calls * rows[0][clock] for clock in slope}
        seconds = {clock: max(seconds[clock], least[clock]) for clock in slope}
        lines.append(
            {
                "kind": kind,
                "label": label,
                "corf_db": corf_db,
                "rays": float(needed),
                "sionna_cpu_s": seconds["cpu_s"],
                "sionna_s": seconds["wall_s"],
                "corf_cpu_s": spent["cpu_s"],
                "corf_s": spent["wall_s"],
                "ratio_cpu": seconds["cpu_s"] / spent["cpu_s"],
                "ratio_wall": seconds["wall_s"] / spent["wall_s"],
            }
        )
    return lines


def told(report):
    """Seconds by stage, CPU seconds in brackets."""
    ran = {name: s for name, s in report["seconds"].items() if s["wall_s"] > 0}
    return "; ".join(f"{name.replace('_', ' ')} {s['wall_s']:.2f} ({s['cpu_s']:.2f})" for name, s in ran.items())


def write(out, args, result):
    rows, exponent = laws(result)
    lines = equal_error(result)
    ours, bartlett, machine = result["ours"]["report"], result["bartlett"]["report"], result["machine"]
    powers = "\n".join(f"- {run['directions']} directions: {told(run)}" for run in (run["report"] for run in result["powers"]))
    scaled = (
        ""
        if ours["positions"] == result["positions"]
        else "All {0} positions, scaled from these: {1[wall_s]:.0f} ({1[cpu_s]:.0f}) and {2[wall_s]:.0f} ({2[cpu_s]:.0f}). ".format(
            result["positions"], for_all(result, ours), for_all(result, bartlett)
        )
    )
    text = f"""# Speed against Sionna RT ({datetime.date.today().isoformat()})

`python tools/compare_speed.py`: {ours["config"]}, {ours["triangles"]} triangles, {result["positions"]} positions, depth {ours["depth"]}, specular + transmitted + diffuse, one transmitter.

- corf {machine["corf"]}; sionna-rt {machine["sionna-rt"]}, mitsuba {machine["mitsuba"]}, drjit {machine["drjit"]}, {machine["llvm"]}; {machine["cpu"]}, {machine["threads"]} threads each, one after the other in one run
- seconds on the wall; in brackets CPU seconds of all threads. Reading the scene and, for Sionna RT, compiling its kernels are left out on both sides.

## corf, {ours["positions"]} positions

- 1° lobes (`mpc`), {ours["directions"]} directions: {told(ours)}
- 8×8 array (`bartlett`), {bartlett["directions"]} directions: {told(bartlett)}

{scaled}Spectra of 300×200 pixels are in corf's time, not in Sionna RT's; {ours["photons"]} photons, patches of {ours["patch_size_m"]} m.

For powers alone, no spectra, of paths that end with a scattering as Sionna RT's do ({result["powers"][0]["report"]["photons"]} photons):

{powers}

## Sionna RT, {len(result["traced"])} positions a call

Error: standard deviation of one run over {args.seeds} seeds, dB. Pixels of lobes at {args.pixels_at} positions, of the 8×8 array's spectra at all.

"""
    text += table(
        ["rays", "seconds a call (CPU)", "total, worst", "total, median", "diffuse, worst", "diffuse, rms", "… ending so, worst", "… rms", "lobes, median", "lobes, 99 %", "array, median", "array, 99 %", "array, worst"],
        [
            [
                f"{r['samples']:.3g}",
                f"{r['wall_s']:.1f} ({r['cpu_s']:.1f})",
                *[f"{r[k]:.3f}" for k in ("total_db", "total_median_db", "diffuse_db", "diffuse_rms_db", "ending_db", "ending_rms_db", "pixel_median_db", "pixel_p99_db", "bartlett_median_db", "bartlett_p99_db", "bartlett_worst_db")],
            ]
            for r in rows
        ],
    )
    text += (
        "\n\nMeasured laws, error ∝ rays^x: "
        + ", ".join(f"{label} x = {exponent[k]:.2f}" for k, label in KINDS.items())
        + ". Where x is far from −0.5 the run's spread is not that of a sum of random paths: specular paths off small facets are found by some runs and not by others, and the spread of pixels that few rays reach is bounded (√seeds × 4.3 dB at most). Both make the rays needed look fewer than they are.\n"
    )
    text += f"\n## At equal error, all {result['positions']} positions\n\nThe rays that bring Sionna RT's error of each kind down to corf's by σ² ∝ 1/rays, the law of independent rays, and the seconds they cost.\n\n"
    text += table(
        ["error", "corf's, dB", "rays needed", "Sionna RT, s (CPU)", "corf, s (CPU)", "ratio (CPU)"],
        [
            [
                x["label"],
                f"{x['corf_db']:.4f}",
                f"{x['rays']:.2g}",
                f"{x['sionna_s']:.0f} ({x['sionna_cpu_s']:.0f})",
                f"{x['corf_s']:.0f} ({x['corf_cpu_s']:.0f})",
                f"{x['ratio_wall']:.1f} ({x['ratio_cpu']:.1f})",
            ]
            for x in lines
        ],
    )
    if "scaling" in result:
        text += scaling(out, result["scaling"], ours["triangles"])
    (out / "README.md").write_text(text + "\n")


def scaling(out, scaling_result, triangles):
    """CSV and picture of cost against triangles, depth and receivers."""
    rows = scaling_result["rows"]
    with open(out / "scaling.csv", "w", newline="") as file:
        writer = csv.DictWriter(file, fieldnames=list(rows[0]))
        writer.writeheader()
        writer.writerows(rows)
    figure, axes = plt.subplots(1, 3, figsize=(11, 3.3), layout="constrained")
    for axis, what in zip(axes, ("triangles", "depth", "receivers")):
        own = [r for r in rows if r["against"] == what]
        both = [r for r in own if r["sionna_cpu_s"] is not None]
        axis.plot([r["x"] for r in own], [r["corf_cpu_s"] for r in own], "o-", color=CORF, label="corf, with 300×200 spectra")
        axis.plot(
            [r["x"] for r in both],
            [r["sionna_cpu_s"] for r in both],
            "s-",
            color=THEIRS,
            label=f"Sionna RT, {scaling_result['rays']:.0e} rays",
        )
        axis.set(xlabel=what, ylabel="CPU seconds", yscale="log", xscale="linear" if what == "depth" else "log")
        axis.grid(color=INK, alpha=0.12, lw=0.5)
    axes[0].legend(frameon=False)
    save(figure, out / "scaling.png")
    return f"""

## Cost against triangles, depth and receivers

![scaling](scaling.png)

CPU seconds of everything at 7 positions (where not varied), depth 3; corf at its own error, Sionna RT at {scaling_result["rays"]:.0e} rays, which is not
the same error: the shapes of the curves compare, not their heights. Triangle counts under the scene's own {triangles} are its largest surfaces, counts above it the same surfaces cut finer. Numbers in [scaling.csv](scaling.csv)."""
