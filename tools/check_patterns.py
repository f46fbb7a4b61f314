"""An antenna pattern from a file, against Sionna RT with the same table as a pattern of its own: path by path, in a plain room.

    python -m venv .venv && .venv/bin/pip install -r tools/requirements-sionna.txt
    .venv/bin/python tools/check_patterns.py                  # a table on standard output

A lopsided pattern (no mirror image of itself) is written as corf reads it and registered with Sionna RT, interpolated by the same rule, and given to
both ends of links from the scene's transmitter to places along its trajectory; so are the exported scene's own elements, for what differs without a
pattern. Exit code 0: the paths in common have amplitudes within the tolerance, none is missing, and the pattern mirrored left to right in corf
alone is noticed. 1: not so; 2: bad input. Two minutes on two cores.
"""

import argparse
import json
import sys
import tempfile
from pathlib import Path

from sionna_live import environment
from sionna_live.environment import say

ROOT = environment.ROOT
NAME = "corf-table"
# Of amplitudes, dB: Sionna RT's single precision, where polarisations nearly cancel without a pattern as with one.
MAX_DB = 0.1
# Of what the table adds to a path that both have, dB: without what they differ by anyway.
MAX_GAIN_DB = 0.002
# Paths this far under the strongest are not compared, dB: both sides drop some of them.
RANGE_DB = 90.0


def arguments():
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("scene", nargs="?", default=str(ROOT / "scenes/room.toml"), help="scene file with a trajectory (default: the room)")
    parser.add_argument("--receivers", type=int, default=6, help="evenly spaced poses of the trajectory")
    parser.add_argument("--depth", type=int, default=3)
    parser.add_argument("--samples", type=float, default=2e6, help="rays of Sionna RT")
    parser.add_argument("--threads", type=int, default=2)
    parser.add_argument("--corf", help="the corf binary (default: cargo builds it)")
    return parser.parse_args()


def main():
    args = arguments()
    if not Path(args.scene).exists():
        environment.refuse(f"{args.scene} does not exist\n  help: give a scene file (.toml) with a [trajectory]")
    machine = environment.prepare(args.threads)
    import numpy as np

    from sionna_live import corf_runner, sionna_runner
    from sionna_live.tabulated import Table

    corf, table = corf_runner.Corf(args.corf, args.threads), Table.lopsided()
    table.register(NAME)
    rows, passed = [], True
    with tempfile.TemporaryDirectory() as scratch:
        scratch = Path(scratch)
        say("exporting the scene")
        radio = corf.export(args.scene, scratch / "scene", args.receivers)
        tx = np.float32(radio["transmitter"]["position_m"])
        receivers = np.float32([pose["position_m"] for pose in radio["poses"]])
        named = scratch / "scene/radio.json"

        def theirs(pattern):
            changed = json.loads(json.dumps(radio))
            for end in ("transmitter", "receiver"):
                changed[end]["pattern"] = pattern or changed[end]["pattern"]
            named.write_text(json.dumps(changed))
            found = sionna_runner.Theirs(scratch / "scene").specular([tx], receivers, args.depth, args.samples, 1)
            return [of_receiver[0] for of_receiver in found]

        def ours(pattern):
            if pattern is None:
                return corf.paths(args.scene, tx, receivers, args.depth)
            pattern.write(scratch / "pattern.csv")
            config = scratch / "link.toml"
            ends = "".join(f'[{end}]\npattern = {{ file = "pattern.csv" }}\n' for end in ("transmitter", "receiver"))
            config.write_text(ends)
            return corf.paths(args.scene, tx, receivers, args.depth, "--config", config)

        say("Sionna RT")
        plain, patterned = theirs(None), theirs(NAME)
        say("corf")
        own, of_table, of_mirrored = ours(None), ours(table), ours(table.mirrored())
    cases = [
        ("the scene's own elements", own, plain, True),
        ("the table at both ends", of_table, patterned, True),
        ("the table mirrored in corf alone (must differ)", of_mirrored, patterned, False),
    ]
    for name, mine, other, agree in cases:
        row = compare(mine, other)
        if mine is not own:
            row["gains"] = gains_off(own, plain, mine, other)
        good = row["missing"] == 0 and row["worst_db"] <= MAX_DB and max(row.get("gains", [0.0])) <= MAX_GAIN_DB
        passed &= good == agree and row["common"] > 0
        rows.append((name, row))
    print(f"Sionna RT {machine['sionna-rt']}, corf {machine['corf']}, {Path(args.scene).name}, {args.receivers} receivers, depth {args.depth}\n")
    print("| | paths in common | Sionna RT's alone | corf's alone | amplitudes: median, worst, dB | what the table adds: median, worst, dB |")
    print("|---|---:|---:|---:|---:|---:|")
    for name, r in rows:
        added = f"{np.median(r['gains']):.1e}, {max(r['gains']):.1e}" if "gains" in r else ""
        print(f"| {name} | {r['common']} | {r['missing']} | {r['alone']} | {r['median_db']:.1e}, {r['worst_db']:.1e} | {added} |")
    print(f"\nThe table changes the paths' gains by {spread_db(own, of_table):.1f} dB from the least to the most.")
    print("\npassed" if passed else "\nfailed")
    return 0 if passed else 1


def compare(ours, theirs):
    """Amplitudes of paths within the range of the strongest, over all receivers."""
    import numpy as np

    from sionna_live.tabulated import pairs

    off, missing, alone = [], 0, 0
    for mine, other in zip(ours, theirs):
        top = max(abs(path["a"]) for path in mine)
        strong = lambda path: abs(path["a"]) > top * 10 ** (-RANGE_DB / 20)
        found, only_mine, only_theirs = pairs(mine, other)
        off += [20 * np.log10(abs(a["a"]) / abs(b["a"])) for a, b in found if strong(a) and abs(b["a"]) > 0]
        missing += sum(strong(path) for path in only_theirs)
        alone += sum(strong(path) for path in only_mine)
    off = np.abs(off)
    return {
        "common": len(off),
        "missing": missing,
        "alone": alone,
        "median_db": float(np.median(off)) if len(off) else float("inf"),
        "worst_db": float(off.max()) if len(off) else float("inf"),
    }


def place(path):
    """What a path is, among those of one side."""
    return path["types"], tuple(path["vertices"].ravel().round(3))


def added_db(plain, patterned):
    """What a pattern adds to each path of a receiver: {place: dB}."""
    import numpy as np

    from sionna_live.tabulated import pairs

    both = [(a, b) for a, b in pairs(plain, patterned)[0] if abs(a["a"]) > 0 and abs(b["a"]) > 0]
    return {place(a): 20 * np.log10(abs(b["a"]) / abs(a["a"])) for a, b in both}


def gains_off(own, plain, ours, theirs):
    """|difference| of what the pattern adds on both sides, dB, of the paths that both have with and without it."""
    from sionna_live.tabulated import pairs

    off = []
    for receiver in range(len(own)):
        mine, other = added_db(own[receiver], ours[receiver]), added_db(plain[receiver], theirs[receiver])
        both = [(place(a), place(b)) for a, b in pairs(own[receiver], plain[receiver])[0]]
        off += [abs(mine[a] - other[b]) for a, b in both if a in mine and b in other]
    return off


def spread_db(plain, patterned):
    """Range of what the pattern does to corf's own paths: a pattern that changes nothing shows nothing."""
    gains = [gain for a, b in zip(plain, patterned) for gain in added_db(a, b).values()]
    return max(gains) - min(gains)


if __name__ == "__main__":
    sys.exit(main())
