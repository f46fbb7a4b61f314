"""Channels along a way, as NIST's Q-D channel realization software writes them and ns-3 reads them. Used by check_formats.py.

The reader follows the format's description: for every step a line with the number of paths N and, where that is not 0, seven lines of N numbers, delay (s), gain (dB),
phase (rad), zenith and azimuth of departure, zenith and azimuth of arrival (degrees). A receiver forms h(f) = sum of 10^(gain/20) e^(j phase) e^(-j 2 pi f delay).
What is compared with is worked out from the corners of the paths of `corf paths --format json`: delays are lengths over c, directions those of the first and last part.
"""

import copy
import json
import math

from format_rules import insist

SPEED_OF_LIGHT = 299792458.0
# Metres of length, decibels, radians of h at the carrier, parts of a unit vector; nodes in metres.
TOLERANCE = 1e-6
NAMES = ("Delay", "Gain", "Phase", "AODEL", "AODAZ", "AOAEL", "AOAAZ")


def text_steps(file):
    """The steps of a text file: lists of seven numbers a path."""
    text = file.read_text()
    insist(text.endswith("\n"), f"{file.name}: ns-3 loses a step whose last line does not end")
    lines = iter(text.splitlines())
    steps = []
    for line in lines:
        count = int(line)
        rows = [[float(v) for v in next(lines, "").split(",")] for _ in NAMES] if count else []
        insist(all(len(row) == count for row in rows), f"{file.name}: step {len(steps)} has rows of {[len(r) for r in rows]} instead of {count}")
        steps.append([list(path) for path in zip(*rows)])
    return steps


def json_steps(file):
    """The steps of every ordered pair of nodes."""
    pairs = {}
    for line in file.read_text().splitlines():
        pair = json.loads(line)
        insist((pair["PAA_TX"], pair["PAA_RX"]) == (0, 0), "an array that is not the first")
        counts = [[len(step) for step in pair[name]] for name in NAMES]
        insist(all(c == counts[0] for c in counts), f"lists of different lengths between {pair['TX']} and {pair['RX']}")
        pairs[pair["TX"], pair["RX"]] = [[list(path) for path in zip(*rows)] for rows in zip(*(pair[name] for name in NAMES))]
    return pairs


def direction(zenith_deg, azimuth_deg):
    insist(0 <= zenith_deg <= 180 and 0 <= azimuth_deg < 360, f"angles {zenith_deg}, {azimuth_deg}")
    theta, phi = math.radians(zenith_deg), math.radians(azimuth_deg)
    return math.sin(theta) * math.cos(phi), math.sin(theta) * math.sin(phi), math.cos(theta)


def towards(a, b):
    return tuple((y - x) / math.dist(a, b) for x, y in zip(a, b))


def check_paths(paths, link, worst, reverse=False):
    """The paths of a step against those of a link, each found by its length and its directions."""
    insist(len(paths) == len(link["paths"]), f"{len(paths)} paths instead of {len(link['paths'])}")
    insist(all(a[0] <= b[0] for a, b in zip(paths, paths[1:])), "the first path is not the earliest")
    left = [(p[0] * SPEED_OF_LIGHT, direction(*p[3:5]), direction(*p[5:7]), p) for p in paths]
    for path in link["paths"]:
        corners = [link["tx"], *path["vertices"], link["rx"]]
        length = sum(math.dist(a, b) for a, b in zip(corners, corners[1:]))
        ends = [towards(corners[0], corners[1]), towards(corners[-1], corners[-2])]
        if reverse:
            ends.reverse()

        def off(candidate):
            return max(abs(candidate[0] - length), math.dist(candidate[1], ends[0]), math.dist(candidate[2], ends[1]))

        # Corners that meet leave directions open; such paths are not made.
        nearest = min(left, key=off)
        left.remove(nearest)
        delay, gain_db, phase = nearest[3][:3]
        a = complex(*path["a"])
        turned = phase - 2 * math.pi * link["frequency_hz"] * delay
        wanted = math.atan2(a.imag, a.real) - 2 * math.pi * link["frequency_hz"] * length / SPEED_OF_LIGHT
        worst["m or of a direction"] = max(worst["m or of a direction"], off(nearest))
        worst["dB"] = max(worst["dB"], abs(gain_db - 20 * math.log10(abs(a))))
        worst["rad"] = max(worst["rad"], abs(math.remainder(turned - wanted, 2 * math.pi)))


def check_qd(folder, truth):
    """A scenario folder of either variant against the links of the same receivers."""
    worst = {"m or of a direction": 0.0, "dB": 0.0, "rad": 0.0}
    files = folder / "Output/Ns3/QdFiles"
    names = sorted(p.name for p in files.iterdir())
    if names == ["qdOutput.json"]:
        pairs = json_steps(files / "qdOutput.json")
    else:
        insist(names == ["Tx0Rx1.txt", "Tx1Rx0.txt"], f"{names}")
        pairs = {(0, 1): text_steps(files / "Tx0Rx1.txt"), (1, 0): text_steps(files / "Tx1Rx0.txt")}
    insist(set(pairs) == {(0, 1), (1, 0)}, f"pairs {sorted(pairs)}")
    for ends, steps in pairs.items():
        insist(len(steps) == len(truth), f"{len(steps)} steps instead of {len(truth)}")
        for paths, link in zip(steps, truth):
            check_paths(paths, link, worst, reverse=ends == (1, 0))
    nodes = [json.loads(line) for line in (folder / "Output/Visualizer/NodePositions.json").read_text().splitlines()]
    insist([node["Node"] for node in nodes] == [0, 1], "not two nodes")
    for node, end in zip(nodes, ("tx", "rx")):
        off = max(math.dist(place, link[end]) for place, link in zip(node["Position"], truth, strict=True))
        insist(off < TOLERANCE, f"node {node['Node']} is {off} m elsewhere")
    first = [[float(v) for v in line.split(",")] for line in (folder / "Output/Ns3/NodesPosition/NodesPosition.csv").read_text().splitlines()]
    insist(first == [node["Position"][0] for node in nodes], "NodesPosition.csv has other places")
    settings = dict(line.split("\t") for line in (folder / "Input/paraCfgCurrent.txt").read_text().splitlines())
    insist(int(settings["numberOfTimeDivisions"]) == len(truth), "another number of steps in paraCfgCurrent.txt")
    insist(float(settings["carrierFrequency"]) == truth[0]["frequency_hz"], "another carrier in paraCfgCurrent.txt")
    for what, value in worst.items():
        insist(value < TOLERANCE, f"{value:.3g} {what} off, where {TOLERANCE} is allowed")
    count = sum(len(link["paths"]) for link in truth)
    print(f"        {len(truth)} steps, {count} paths: " + ", ".join(f"{v:.1e} {u}" for u, v in worst.items()))


def qd_controls(truth):
    """What is off, and links that are off by it: twice what is allowed."""

    def changed(change):
        off = copy.deepcopy(truth)
        link = next(link for link in off if any(p["vertices"] for p in link["paths"]))
        change(link, next(p for p in link["paths"] if p["vertices"]))
        return off

    def louder(_, path):
        path["a"] = [10 ** (2 * TOLERANCE / 20) * part for part in path["a"]]

    def turned(_, path):
        a = complex(*path["a"]) * complex(math.cos(2 * TOLERANCE), math.sin(2 * TOLERANCE))
        path["a"] = [a.real, a.imag]

    def elsewhere(link, path):
        path["vertices"][0] = [v + 1e-4 for v in path["vertices"][0]]

    return [("2e-6 dB", changed(louder)), ("2e-6 radians", changed(turned)), ("0.1 mm", changed(elsewhere))]
