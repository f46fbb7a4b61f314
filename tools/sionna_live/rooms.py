"""Small rooms with what the published references do not have: tilted faces, turned and leaning things, panes, bars, a corridor's corner.

Nothing stands on the floor: of two surfaces in one place either may be meant.
"""

from dataclasses import dataclass

import numpy as np


@dataclass
class Room:
    """Parts are (object name, id of a radio material of the lobby's, corners (n, 3, 3) of its triangles)."""

    parts: list
    tx: tuple
    receivers: list


def quad(a, b, c, d):
    return np.array([[a, b, c], [a, c, d]], dtype=float)


def box(low, high, yaw=0.0):
    """The six sides of a box, turned about the vertical through its middle, facing outward."""
    low, high = np.array(low, dtype=float), np.array(high, dtype=float)
    corners = np.array([[x, y, z] for x in (low[0], high[0]) for y in (low[1], high[1]) for z in (low[2], high[2])])
    turn = np.array([[np.cos(yaw), -np.sin(yaw), 0], [np.sin(yaw), np.cos(yaw), 0], [0, 0, 1]])
    corners = (corners - (low + high) / 2) @ turn.T + (low + high) / 2
    sides = [(0, 1, 3, 2), (4, 6, 7, 5), (0, 4, 5, 1), (2, 3, 7, 6), (0, 2, 6, 4), (1, 5, 7, 3)]
    return np.concatenate([quad(*corners[list(side)]) for side in sides])


def hall(x, y, z, west, east, south, north, floor, ceiling):
    """Six sheets around a box from the origin."""
    corner = lambda i, j, k: [x * i, y * j, z * k]
    sheet = lambda *ends: quad(*(corner(*end) for end in ends))
    return [
        ("west", west, sheet((0, 0, 0), (0, 0, 1), (0, 1, 1), (0, 1, 0))),
        ("east", east, sheet((1, 0, 0), (1, 1, 0), (1, 1, 1), (1, 0, 1))),
        ("south", south, sheet((0, 0, 0), (1, 0, 0), (1, 0, 1), (0, 0, 1))),
        ("north", north, sheet((0, 1, 0), (0, 1, 1), (1, 1, 1), (1, 1, 0))),
        ("floor", floor, sheet((0, 0, 0), (0, 1, 0), (1, 1, 0), (1, 0, 0))),
        ("ceiling", ceiling, sheet((0, 0, 1), (1, 0, 1), (1, 1, 1), (0, 1, 1))),
    ]


def rooms():
    """By name."""
    walls = ("concrete", "glass", "plasterboard", "wood", "floorboard", "ceiling_board")
    office = hall(7.1, 5.3, 2.9, *walls) + [
        ("crate", "wood", box([2.1, 1.2, 0.02], [2.9, 2.0, 0.9], 0.4)),
        ("cabinet", "metal", box([4.9, 3.4, 0.02], [5.6, 3.9, 1.9], 0.2)),
        ("screen", "glass", quad([3.6, 0.8, 0.6], [3.9, 2.9, 0.6], [3.9, 2.9, 2.1], [3.6, 0.8, 2.1])),
    ]
    attic = hall(6.0, 4.4, 3.2, "plasterboard", "plasterboard", "concrete", "glass", "chipboard", "ceiling_board")[:5] + [
        ("roof", "wood", quad([0, 0, 3.2], [6, 0, 2.6], [6, 4.4, 2.6], [0, 4.4, 3.2])),
        ("panel", "chipboard", quad([2.0, 1.0, 0.2], [3.1, 3.2, 0.2], [3.1, 3.2, 2.2], [2.0, 1.0, 2.2])),
        ("leaning", "plasterboard", quad([4.5, 0.4, 0.0], [4.1, 2.9, 0.0], [4.3, 2.9, 2.4], [4.7, 0.4, 2.4])),
        ("bar", "metal", box([2.2, 2.0, 2.2], [3.4, 2.15, 2.3], 0.1)),
    ]
    corridor = hall(8.0, 8.0, 2.7, "concrete", "wood", "glass", "plasterboard", "floorboard", "ceiling_board") + [
        ("core", "concrete", box([2.0, 2.0, -0.1], [9.0, 9.0, 2.8])),
        ("pillar", "metal", box([0.6, 3.0, 0.02], [0.9, 3.3, 2.6], 0.3)),
    ]
    divided = hall(6.0, 5.0, 3.0, *walls) + [
        ("partition", "glass", quad([3, 0, 0], [3, 3.6, 0], [3, 3.6, 3], [3, 0, 3])),
        ("cabinet", "metal", box([4.2, 0.5, 0.2], [4.8, 1.1, 2.0], 0.3)),
        ("board", "plasterboard", quad([1.2, 2.6, 0.1], [2.2, 3.0, 0.1], [2.2, 3.0, 2.0], [1.2, 2.6, 2.0])),
    ]
    return {
        "office": Room(office, (1.1, 4.2, 2.3), [(5.9, 1.3, 1.2), (4.3, 4.6, 1.4), (2.7, 3.1, 0.8)]),
        "attic": Room(attic, (0.8, 0.9, 1.9), [(5.3, 3.7, 1.1), (3.7, 1.2, 1.5), (1.4, 3.8, 0.5), (5.5, 0.5, 2.2)]),
        "corridor": Room(corridor, (1.2, 7.1, 2.1), [(7.2, 1.1, 1.3), (4.1, 0.7, 1.1), (1.3, 1.2, 1.6)]),
        "divided": Room(divided, (1.31, 1.17, 2.23), [(4.37, 1.61, 1.27), (4.83, 4.43, 0.9), (2.17, 2.83, 1.5)]),
    }
