"""The report of the live check: Markdown, pictures, and the numbers as JSON."""

import datetime
import json

import numpy as np

from . import compare, pictures
from .diffuse import MAX_STANDARD_ERRORS, MAX_TOTAL_DB, within_total

# Bartlett maps are compared within this range below their peak.
RANGE_DB = 30.0
MAX_MAP_DB = 0.2
TESSELLATED = 500


def table(head, rows):
    """Markdown."""
    line = lambda cells: "| " + " | ".join(str(c) for c in cells) + " |"
    return "\n".join([line(head), line(["---"] + ["---:"] * (len(head) - 1)), *map(line, rows)])


def power(linear, error=None):
    """dB with its standard error."""
    if not linear > 0:
        return "none"
    if error is None:
        return f"{10 * np.log10(linear):.2f}"
    return f"{10 * np.log10(linear):.3f} ± {10 / np.log(10) * error / linear:.3f}"


def write(out, args, machine, radio, mesh, tx, receivers, links, runs, controls, scattered):
    """Writes everything; returns whether all is as it should be."""
    verdicts = {"specular and transmitted paths": all(link.passed() for link in links)}
    parts = [specular_part(links, runs, mesh, tx)]
    pictures.plan(out / "plan.png", mesh, tx, receivers, links)
    pictures.coefficients(out / "coefficients.png", links)
    if scattered:
        text, passed = diffuse_part(scattered)
        verdicts.update(passed)
        parts.append(text)
        pictures.diffuse(out / "diffuse.png", scattered)
        text, passed = spectra_part(scattered["spectra"])
        verdicts["spectra"] = passed
        parts.append(text)
        pictures.spectra(out / "spectra.png", scattered["spectra"], RANGE_DB)
        text, passed = dataset_part(scattered["dataset"])
        verdicts["a data set's spectra"] = passed
        parts.append(text)
    verdicts["negative controls fail"] = all(c["fails"] for c in controls)
    parts.append(
        "## Negative controls\n\n"
        + table(
            ["change on our side", "comparison", "what it noticed"],
            [[c["name"], "fails, as it must" if c["fails"] else "**passes**", c["what"]] for c in controls],
        )
    )
    head = heading(args, machine, radio, tx, receivers, verdicts)
    (out / "README.md").write_text("\n\n".join([head, *parts]) + "\n")
    numbers = {"machine": machine, "verdicts": verdicts, "links": [link_numbers(link) for link in links], "controls": controls}
    if scattered:
        numbers["diffuse"] = {k: v for k, v in scattered.items() if k not in ("spectra", "dataset")}
    (out / "results.json").write_text(json.dumps(numbers, indent=1, default=float) + "\n")
    return all(verdicts.values())


def heading(args, machine, radio, tx, receivers, verdicts):
    places = ", ".join(f"{i}: ({x:.2f}, {y:.2f}, {z:.2f})" for i, (x, y, z) in enumerate(receivers))
    triangles = sum(s["triangles"] for s in radio["shapes"])
    verdict = "\n".join(f"- {name}: **{'yes' if ok else 'NO'}**" for name, ok in verdicts.items())
    return f"""# {radio["scene"]} against Sionna RT ({datetime.date.today().isoformat()})

`python tools/check_sionna.py`: the scene ({len(radio["shapes"])} shapes, {triangles} triangles) exported by `corf scene export --to sionna`, traced by both
at {radio["frequency_hz"] / 1e9:g} GHz from the transmitter at ({tx[0]:g}, {tx[1]:g}, {tx[2]:g}), depth {args.depth}, at {len(receivers)} evenly spaced poses of the trajectory.

- corf {machine["corf"]}; sionna-rt {machine["sionna-rt"]}, mitsuba {machine["mitsuba"]}, drjit {machine["drjit"]}, {machine["llvm"]}; {machine["cpu"]}, {machine["threads"]} threads
- Sionna RT: {args.specular_runs} runs × {args.specular_samples:.0e} rays for specular paths, {args.diffuse_seeds} seeds × {args.diffuse_samples:.0e} rays for diffuse ones
- corf's diffuse field: {args.directions} directions, {args.replicas} samplings, exact images in mirrors of {args.mirror_sr:g} sr and more
- receivers: {places}

{verdict}

![plan](plan.png)"""


def specular_part(links, runs, mesh, tx):
    rows = []
    for link in links:
        mine, yours = link.powers_db()
        worst = max((p["relative_a"] for p in link.pairs), default=0.0)
        median = float(np.median([p["relative_a"] for p in link.pairs])) if link.pairs else 0.0
        rows.append(
            [
                link.index,
                len(link.ours),
                len(link.pairs),
                len(link.missing),
                f"{median:.1e}",
                f"{worst:.1e}",
                f"{mine:.3f}",
                f"{yours:.3f}",
                f"{mine - yours:+.4f}",
                "yes" if link.passed() else "**NO**",
            ]
        )
    text = "## Specular and transmitted paths\n\n" + table(
        [
            "receiver",
            "corf",
            "same in both",
            "missing in corf",
            "median Δa/a",
            "worst Δa/a",
            "corf dB",
            "Sionna RT dB",
            "difference",
            "agrees",
        ],
        rows,
    )
    text += f"""

Tolerances: length {compare.MAX_LENGTH_M:g} m, angles {compare.MAX_ANGLE_RAD:g} rad, vertices 1 mm, |Δa| ≤ {compare.MAX_RELATIVE_A:g}·|a| and ≤ {compare.MAX_A_OF_STRONGEST:g} of the
strongest path, power {compare.MAX_POWER_DB:g} dB. Sionna RT computes in single precision; corf in double.

![coefficients](coefficients.png)

### Paths that one side has

"""
    reasons = {
        "not met by its rays": "Told the chain of faces, Sionna RT's own image method accepts it and computes the same coefficient: its rays did not meet the faces, small as they are.",
        "segment under 1 cm": "Sionna RT drops paths with a segment under 1 cm.",
        "two surfaces in one place": "Two faces of different material coincide; corf reflects off both, Sionna RT off the one it happens to hit.",
        None: "**Refused by Sionna RT when told.**",
    }
    rows = []
    for reason, meaning in reasons.items():
        entries = [(link, e["path"]) for link in links for e in link.ours_only if e["reason"] == reason]
        if entries:
            share = max(
                10 ** ((compare.power_db([p for l, p in entries if l is link]) - compare.power_db(link.ours)) / 10)
                for link in links
            )
            rows.append(
                [
                    f"corf only: {reason or 'refused'}",
                    len(entries),
                    f"{max(20 * np.log10(abs(p['a'])) for _, p in entries):.1f}",
                    f"{10 * np.log10(1 + share):.3f}",
                    meaning,
                ]
            )
    for label, pick, meaning in (
        (
            "Sionna RT only: off the mirror",
            lambda l: l.off_the_mirror,
            "A second path off a face, computed with the image in another face up to 5 mm away; its vertices break the law of reflection by more than 1 mm.",
        ),
        (
            "Sionna RT only: repeats",
            lambda l: l.repeats,
            "A path of both sides, returned again through another nearly coplanar face.",
        ),
        ("Sionna RT only: missing in corf", lambda l: l.missing, "**A path that corf lacks.**"),
    ):
        entries = [(link, p) for link in links for p in pick(link)]
        if entries:
            share = max(10 ** ((compare.power_db(pick(link)) - compare.power_db(link.ours)) / 10) for link in links)
            rows.append(
                [
                    label,
                    len(entries),
                    f"{max(20 * np.log10(abs(p['a'])) for _, p in entries):.1f}",
                    f"{10 * np.log10(1 + share):.3f}",
                    meaning,
                ]
            )
    text += table(["what", "paths", "strongest, dB", "worst share of a receiver's power, dB", "why"], rows)
    missing = [(link, p) for link in links for p in link.missing]
    if missing:
        text += "\n\n" + table(
            ["receiver", "types", "dB", "objects", "vertices"],
            [
                [
                    l.index,
                    p["types"],
                    f"{20 * np.log10(abs(p['a'])):.1f}",
                    " → ".join(p["objects"]),
                    " ".join(str(tuple(float(c) for c in v.round(3))) for v in p["vertices"]),
                ]
                for l, p in missing
            ],
        )
    over = [(link, *entry) for link in links for entry in link.pairs_over_limits()]
    if over:
        text += (
            "\n\nPairs out of tolerance. The third opinion is a float64 evaluation of the published formulas in numpy, corners included:\n\n"
            + table(
                ["receiver", "types", "dB", "objects", "out of tolerance", "corf against the third opinion", "whose fault"],
                [
                    [
                        l.index,
                        pair["types"],
                        f"{pair['gain_db']:.1f}",
                        " → ".join(l.ours[pair["ours"]]["objects"]),
                        ", ".join(f"{k} {pair[k]:.1e}" for k in why),
                        f"Δa/a {pair['referee_a']:.0e}",
                        (
                            ("two surfaces in one place" if pair["other_surface"] else "single precision")
                            if explained
                            else "**corf**"
                        ),
                    ]
                    for l, pair, why, explained in over
                ],
            )
        )
    third = [pair["referee_a"] for link in links for pair in link.pairs]
    text += f"\n\nAll {len(third)} common paths against the third opinion: |Δa|/|a| median {np.median(third):.0e}, worst {max(third):.0e}."
    returned = [[compare.power_db(run[link.index][0]) for run in runs] for link in links]
    spread = max(max(r) - min(r) for r in returned)
    small = [
        (link, p) for link in links for p in link.ours if any(mesh.triangles_of_object[o] > TESSELLATED for o in p["objects"])
    ]
    shares = [10 ** ((compare.power_db([p for l, p in small if l is link]) - compare.power_db(link.ours)) / 10) for link in links]
    text += f"""

A single run of Sionna RT returns between {min(len(run[l.index][0]) for run in runs for l in links)} and {max(len(run[l.index][0]) for run in runs for l in links)} paths; its total at a receiver differs by up to {spread:.2f} dB between runs.
Curved objects are many small flat facets here: {len(small)} of our {sum(len(l.ours) for l in links)} paths touch an object of more than {TESSELLATED} triangles and
hold {100 * min(shares):.2f} to {100 * max(shares):.2f} % of the specular power; what either side misses is among them."""
    return text


def diffuse_part(scattered):
    rows = [
        [
            r,
            power(row["theirs"], row["theirs_error"]),
            power(row["ours"], row["ours_error"]),
            f"{row['difference_db']:+.3f} ± {row['error_db']:.3f}",
            "yes" if within_total(row) else "**NO**",
        ]
        for r, row in enumerate(scattered["totals"])
    ]
    passed_totals = all(within_total(row) for row in scattered["totals"])
    text = (
        f"## Diffuse power\n\nAll paths that end with a scattering, dB relative to 1 W transmitted, ± one standard error; tolerance {MAX_TOTAL_DB} dB.\n\n"
        + table(["receiver", "Sionna RT", "corf", "difference, dB", "agrees"], rows)
    )
    text += "\n\n![diffuse](diffuse.png)\n\n### By number of interactions\n\n" + table(
        ["receiver", "interactions", "Sionna RT", "corf", "difference, dB"],
        [
            [
                r,
                row["label"],
                power(row["theirs"], row["theirs_error"]),
                power(row["ours"], row["ours_error"]),
                f"{row['difference_db']:+.2f} ± {row['error_db']:.2f}",
            ]
            for r, rows in enumerate(scattered["interactions"])
            for row in rows
        ],
    )
    every = [(r, row) for r, rows in enumerate(scattered["objects"]) for row in rows]
    within_errors = lambda row: abs(row["in_errors"]) <= MAX_STANDARD_ERRORS
    outside = [row for _, row in every if not within_errors(row)]
    different = [row for row in outside if not within_total(row)]
    text += (
        f"\n\n### By object\n\n{len(every)} objects with at least 1 % of a receiver's diffuse power (and the rest, summed); "
        f"{len(every) - len(outside)} within {MAX_STANDARD_ERRORS:g} standard errors, {len(different)} of the others off by more than the "
        f"{MAX_TOTAL_DB} dB of a total: these are what fails, for with rays enough errors fall below any approximation's."
    )
    listed = [(r, row) for r, row in every if not (within_errors(row) and within_total(row))]
    if listed:
        text += f" All beyond {MAX_STANDARD_ERRORS:g} standard errors or {MAX_TOTAL_DB} dB:"
    shown = listed or [(0, row) for row in scattered["objects"][0][:8]]
    text += (
        "\n\n"
        + ("" if listed else "The strongest at receiver 0:\n\n")
        + table(
            ["receiver", "object", "Sionna RT", "corf", "difference, dB", "standard errors"],
            [
                [
                    r,
                    row["label"],
                    power(row["theirs"], row["theirs_error"]),
                    power(row["ours"], row["ours_error"]),
                    f"{row['difference_db']:+.2f}",
                    f"{row['in_errors']:+.1f}",
                ]
                for r, row in shown
            ],
        )
    )
    text += (
        "\n\n### Mirrors by photons\n\nData sets and `corf diffuse` by default have photons bring what mirrors send onto surfaces; above, exact images do.\n"
        "Where light varies within patches photons fall short of it.\n\n"
        + table(
            ["receiver", "exact images", "photons", "difference, dB"],
            [
                [
                    r,
                    power(row["theirs"], row["theirs_error"]),
                    power(row["ours"], row["ours_error"]),
                    f"{row['difference_db']:+.3f} ± {row['error_db']:.3f}",
                ]
                for r, row in enumerate(scattered["photons"])
            ],
        )
    )
    names = sorted({t for by in scattered["types"] for t in by}, key=lambda t: (len(t), t))
    kept = [t for t in names if t.endswith("D")]
    text += (
        "\n\n### Sionna RT by type\n\ndB; S specular, R transmitted, D scattered, in the order from the transmitter.\n\n"
        + table(
            ["receiver", *kept],
            [[r, *[power(by[t][0]) if t in by else "none" for t in kept]] for r, by in enumerate(scattered["types"])],
        )
    )
    text += (
        "\n\n### Power that Sionna RT lacks\n\nPaths with a mirror or a slab behind the last scattering: its search stores one such path per chain of planes, not one per ray.\n\n"
        + table(
            ["receiver", "corf", "Sionna RT", "share of corf's diffuse power"],
            [
                [
                    r,
                    power(row["ours"], row["ours_error"]),
                    power(row["theirs"]),
                    f"{100 * row['ours'] / (row['ours'] + total['ours']):.0f} %",
                ]
                for r, (row, total) in enumerate(zip(scattered["lacking"], scattered["totals"]))
            ],
        )
    )
    return text, {"diffuse totals": passed_totals, "diffuse by object": not different}


def map_difference(one):
    """Within the range of the peak: largest difference, largest beyond four standard errors, share of directions within the tolerance, the
    two sides' largest standard errors (all dB), and how many directions these are."""
    a, b = (10 * np.log10(np.maximum(one[k], 1e-30)) for k in ("ours", "theirs"))
    errors = [10 / np.log(10) * one[f"{side}_error"] / one[side] for side in ("ours", "theirs")]
    within = np.maximum(a, b) >= max(a.max(), b.max()) - RANGE_DB
    off = np.abs(a - b)[within]
    beyond = np.maximum(off - MAX_STANDARD_ERRORS * np.hypot(*errors)[within], 0.0)
    largest = [float(error[within].max()) for error in errors]
    return float(off.max()), float(beyond.max()), float((off <= MAX_MAP_DB).mean()), largest, int(within.sum())


def spectra_part(maps):
    found = [map_difference(m) for m in maps]
    lacks = [10 * np.log10(m["everything"] / m["ours"]).max() for m in maps]
    rows = [
        [
            r,
            count,
            f"{worst:.3f}",
            f"{100 * share:.1f} %",
            f"{own:.3f}",
            f"{error:.3f}",
            f"{beyond:.3f}",
            "yes" if beyond <= MAX_MAP_DB else "**NO**",
            f"{lack:.2f}",
        ]
        for r, ((worst, beyond, share, (own, error), count), lack) in enumerate(zip(found, lacks))
    ]
    text = f"""## Spectra

Noncoherent Bartlett spectrum of the 8×8 array at every pose, from each side's own arrivals (specular, transmitted, and all that end with a
scattering), 3° grid, rear half-space gated, directions within {RANGE_DB:g} dB of the peak; tolerance {MAX_MAP_DB} dB beyond {MAX_STANDARD_ERRORS:g} standard errors
of both sides' mean maps. The last column is what the map gains at most with the paths Sionna RT lacks.

""" + table(
        [
            "receiver",
            "directions",
            "largest difference, dB",
            f"within {MAX_MAP_DB} dB",
            "corf's error, at most dB",
            "Sionna RT's error, at most dB",
            "beyond their errors, dB",
            "agrees",
            "lacking, at most dB",
        ],
        rows,
    )
    return text + "\n\n![spectra](spectra.png)", all(beyond <= MAX_MAP_DB for _, beyond, _, _, _ in found)


def dataset_part(maps):
    """A data set's spectra beside those formed from arrivals gathered all around alike; whether they agree."""
    found = [map_difference(m) for m in maps]
    rows = [
        [r, count, f"{worst:.3f}", f"{100 * share:.1f} %", f"{error:.3f}", f"{beyond:.3f}", "yes" if beyond <= MAX_MAP_DB else "**NO**"]
        for r, (worst, beyond, share, (_, error), count) in enumerate(found)
    ]
    text = f"""## Spectra of a data set

What `corf dataset generate` writes at these poses (`bartlett`, one sampling), all paths, those that Sionna RT lacks too, beside the map that is
formed here from the arrivals above, which are gathered all around alike: other sampling, other code, the data set's own files and conventions.
Pixels within {RANGE_DB:g} dB of the peak; tolerance {MAX_MAP_DB} dB beyond {MAX_STANDARD_ERRORS:g} standard errors of the latter.

""" + table(
        ["receiver", "pixels", "largest difference, dB", f"within {MAX_MAP_DB} dB", "its error, at most dB", "beyond it, dB", "agrees"], rows
    )
    return text, all(beyond <= MAX_MAP_DB for _, beyond, *_ in found)


def link_numbers(link):
    return {
        "receiver": [float(c) for c in link.rx],
        "paths": len(link.ours),
        "pairs": link.pairs,
        "powers_db": link.powers_db(),
        "ours_only": [
            {
                "types": e["path"]["types"],
                "objects": e["path"]["objects"],
                "gain_db": 20 * np.log10(abs(e["path"]["a"])),
                "reason": e["reason"],
            }
            for e in link.ours_only
        ],
        "missing": [
            {
                "types": p["types"],
                "objects": p["objects"],
                "gain_db": 20 * np.log10(abs(p["a"])),
                "vertices": p["vertices"].tolist(),
            }
            for p in link.missing
        ],
        "repeats": len(link.repeats),
        "off_the_mirror": len(link.off_the_mirror),
        "passed": link.passed(),
    }
