"""The specular and transmitted part of the check: one verdict for every receiver."""

from . import compare, float64_reference

# A path this close to the third opinion is right: plane offsets are rounded by up to 5e-6 m when triangles are gathered into faces.
REFEREE_RELATIVE_A = 1e-5
REFEREE_VERTEX_M = 1e-4


class Link:
    """What one receiver's two path sets have and have not in common."""

    def __init__(self, index, rx, ours, kept, repeats, off_the_mirror):
        self.index, self.rx, self.ours, self.kept = index, rx, ours, kept
        self.repeats, self.off_the_mirror = repeats, off_the_mirror
        self.pairs, self.ours_only, self.missing = [], [], []

    def judge(self, tx):
        """Pairs up and names what is left over on our side; chains to be told are those without a reason yet."""
        self.pairs, left, right = compare.match(self.ours, self.kept, tx, self.rx)
        self.missing = [self.kept[j] for j in right]
        self.ours_only = []
        for i in left:
            path, reason = self.ours[i], None
            if compare.shortest_segment(path, tx, self.rx) < compare.SHORTEST_SEGMENT_M:
                reason = "segment under 1 cm"
            elif compare.coincident(path, self.ours):
                reason = "two surfaces in one place"
            self.ours_only.append({"path": path, "reason": reason, "told": None})

    def ask_referee(self, tx, meshes, radio):
        """Notes in every pair how far our side of it is from the third opinion."""
        for pair in self.pairs:
            pair["referee_vertex_m"], pair["referee_a"], readings = float64_reference.judge(
                self.ours[pair["ours"]], tx, self.rx, meshes, radio
            )
            theirs = self.kept[pair["theirs"]]["a"]
            pair["other_surface"] = (
                len(readings) > 1 and min(abs(theirs - a) / abs(a) for a in readings) <= compare.MAX_RELATIVE_A
            )

    def pairs_over_limits(self):
        """(pair, broken tolerances, whether the referee takes our side)."""
        side = lambda p: p["referee_a"] <= REFEREE_RELATIVE_A and p["referee_vertex_m"] <= REFEREE_VERTEX_M
        return [(pair, compare.over_limits(pair), side(pair)) for pair in self.pairs if compare.over_limits(pair)]

    def faulty_pairs(self):
        """Pairs out of tolerance that the third opinion does not explain by the library's single precision."""
        return [(pair, broken) for pair, broken, explained in self.pairs_over_limits() if not explained]

    def refused(self):
        """Our paths that the library neither found nor accepts."""
        return [entry for entry in self.ours_only if entry["reason"] is None]

    def powers_db(self):
        """Ours without what the library cannot have; theirs without repeats and with the chains it accepts; and as returned."""
        beyond = [id(e["path"]) for e in self.ours_only if e["reason"] in ("segment under 1 cm", "two surfaces in one place")]
        mine = [p for p in self.ours if id(p) not in beyond]
        told = [{"a": e["told"]} for e in self.ours_only if e["told"] is not None]
        return compare.power_db(mine), compare.power_db(self.kept + told)

    def passed(self):
        mine, yours = self.powers_db()
        return not self.faulty_pairs() and not self.missing and not self.refused() and abs(mine - yours) <= compare.MAX_POWER_DB


def links(ours, runs, tx, receivers, meshes, radio):
    """Judged links from corf's lists and the library's runs `[run][receiver][transmitter]`."""
    made = []
    for r, rx in enumerate(receivers):
        link = Link(r, rx, ours[r], *compare.sort_out([run[r][0] for run in runs], tx, rx, meshes))
        link.judge(tx)
        link.ask_referee(tx, meshes, radio)
        made.append(link)
    return made


def tell(made, library, tx, receivers, meshes, depth):
    """Hands the library every chain of ours that it did not find; what it then computes is compared like any other path."""
    asked = [(link, entry) for link in made for entry in link.ours_only if entry["reason"] is None]
    chains = []
    for link, entry in asked:
        path = entry["path"]
        places = [meshes.triangles_at(name, vertex)[0] for name, vertex in zip(path["objects"], path["vertices"])]
        chains.append((link.index, path["types"], path["vertices"], places))
    for (link, entry), a in zip(asked, library.told(tx, receivers, chains, depth)):
        if a is None:
            continue
        own, strongest = entry["path"]["a"], max(abs(p["a"]) for p in link.ours)
        if abs(a - own) <= compare.MAX_RELATIVE_A * abs(own) and abs(a - own) <= compare.MAX_A_OF_STRONGEST * strongest:
            entry["told"], entry["reason"] = a, "not met by its rays"
