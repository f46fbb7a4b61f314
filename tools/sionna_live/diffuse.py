"""Diffuse power of both sides: totals, by number of interactions, by object; with standard errors."""

import numpy as np

MAX_TOTAL_DB = 0.1
MAX_STANDARD_ERRORS = 4.0
# Objects with less than this share of a receiver's diffuse power are summed up as one.
SMALL_OBJECT = 0.01


def mean_and_error(samples):
    """Mean and standard error of the mean."""
    samples = np.asarray(samples, dtype=float)
    return float(samples.mean()), float(samples.std(ddof=1) / np.sqrt(len(samples)))


def sum_where(run, wanted):
    return sum(power for (types, name), power in run["powers"].items() if wanted(types, name))


def theirs_of(runs, r, wanted):
    """Mean and error over seeds of the power of receiver `r` in (types, object) that are wanted."""
    return mean_and_error([sum_where(run[r], wanted) for run in runs])


def ends_scattering(types):
    return types.endswith("D")


def ours_of(entry):
    return entry["power"], entry["standard_error"] or 0.0


def ours_ending(ours, r):
    """Our power at receiver `r` of all paths that end with a scattering."""
    return ours_of(ours["receivers"][r]["by_interactions_after_the_scattering"].get("0", {"power": 0.0, "standard_error": 0.0}))


def db(ratio):
    return 10 * np.log10(ratio) if ratio > 0 else float("-inf")


def row(label, ours, theirs):
    """One comparison: powers, errors, difference in dB and in combined standard errors."""
    error = np.hypot(ours[1], theirs[1])
    return {
        "label": label,
        "ours": ours[0],
        "ours_error": ours[1],
        "theirs": theirs[0],
        "theirs_error": theirs[1],
        "difference_db": db(ours[0] / theirs[0]) if theirs[0] > 0 and ours[0] > 0 else float("nan"),
        "error_db": 10 / np.log(10) * error / theirs[0] if theirs[0] > 0 else float("nan"),
        "in_errors": (ours[0] - theirs[0]) / error if error > 0 else float("nan"),
    }


def total(ours, runs, r):
    """All power that ends with a scattering."""
    return row("total", ours_ending(ours, r), theirs_of(runs, r, lambda types, _: ends_scattering(types)))


def within_total(row):
    """Whether two powers agree as well as is asked of a total."""
    return abs(row["difference_db"]) <= MAX_TOTAL_DB


def own(by_photons, exact, r):
    """All power that ends with a scattering, of two of our own fields: what photons make of mirrors, and their exact images."""
    return row("own", ours_ending(by_photons, r), ours_ending(exact, r))


def by_object(ours, runs, r):
    """The objects of weight, and the rest in one row."""
    entries = ours["receivers"][r]["ending_with_the_scattering_by_object"]
    whole = total(ours, runs, r)["theirs"]
    names = {name for run in runs for (types, name) in run[r]["powers"] if ends_scattering(types)} | set(entries)
    rows, small = [], []
    for name in sorted(names):
        mine = ours_of(entries[name]) if name in entries else (0.0, 0.0)
        yours = theirs_of(runs, r, lambda types, n: n == name and ends_scattering(types))
        if max(mine[0], yours[0]) >= SMALL_OBJECT * whole:
            rows.append(row(name, mine, yours))
        else:
            small.append(name)
    if small:
        mine = sum(ours_of(entries[n])[0] for n in small if n in entries), np.sqrt(
            sum(ours_of(entries[n])[1] ** 2 for n in small if n in entries)
        )
        rows.append(
            row(f"{len(small)} small objects", mine, theirs_of(runs, r, lambda types, n: n in small and ends_scattering(types)))
        )
    return sorted(rows, key=lambda x: -x["theirs"])


def by_interactions(ours_by_depth, runs, r):
    """Power that ends with a scattering, by the number of interactions: differences of runs of rising depth."""
    rows, before = [], (0.0, 0.0)
    for depth, report in sorted(ours_by_depth.items()):
        power, error = ours_ending(report, r)
        mine = power - before[0], np.hypot(error, before[1]) if depth > 1 else error
        rows.append(
            row(
                f"{depth} interaction{'s' if depth > 1 else ''}",
                mine,
                theirs_of(runs, r, lambda t, _: ends_scattering(t) and len(t) == depth),
            )
        )
        before = power, error
    return rows


def lacking(ours, runs, r):
    """Power with a mirror or a slab behind the last scattering: ours, and what little of it the library returns."""
    hops = ours["receivers"][r]["by_interactions_after_the_scattering"]
    mine = sum(ours_of(e)[0] for h, e in hops.items() if h != "0"), np.sqrt(
        sum(ours_of(e)[1] ** 2 for h, e in hops.items() if h != "0")
    )
    return row("…D…S, …D…R", mine, theirs_of(runs, r, lambda types, _: not ends_scattering(types)))
