"""The report's pictures."""

import matplotlib

matplotlib.use("Agg")
import matplotlib.pyplot as plt
import numpy as np

from .compare import MAX_A_OF_STRONGEST, MAX_RELATIVE_A
from .spectrum import AZIMUTH_DEG, ELEVATION_DEG

INK, CORF, THEIRS = "#33414f", "#d1495b", "#30638e"
plt.rcParams.update(
    {
        "font.size": 9,
        "axes.edgecolor": INK,
        "axes.labelcolor": INK,
        "text.color": INK,
        "xtick.color": INK,
        "ytick.color": INK,
        "axes.spines.top": False,
        "axes.spines.right": False,
        "figure.dpi": 110,
    }
)


def save(figure, path):
    figure.savefig(path, bbox_inches="tight", facecolor="white")
    plt.close(figure)


def plan(path, mesh, tx, receivers, links):
    """The room between knee and head height from above, the ends of the links, and the paths that both sides have."""
    figure, axis = plt.subplots(figsize=(6.2, 5.6))
    for corners in mesh.corners:
        near = (corners[..., 2].min(1) < 1.8) & (corners[..., 2].max(1) > 0.5)
        edges = corners[near][:, [0, 1, 2, 0], :2]
        if len(edges):
            flat = np.concatenate([edges, np.full((len(edges), 1, 2), np.nan)], 1).reshape(-1, 2)
            axis.plot(flat[:, 0], flat[:, 1], color="#b8c0c8", lw=0.3, zorder=1)
    for link in links:
        for pair in link.pairs:
            corners = np.vstack([tx, *link.ours[pair["ours"]]["vertices"], link.rx])
            axis.plot(corners[:, 0], corners[:, 1], color=CORF, lw=0.4, alpha=0.25, zorder=2)
        axis.annotate(str(link.index), link.rx[:2], xytext=(5, 4), textcoords="offset points", weight="bold", zorder=4)
    axis.scatter(receivers[:, 0], receivers[:, 1], color=THEIRS, s=26, zorder=3, label="receivers")
    axis.scatter(*tx[:2], color=CORF, marker="^", s=46, zorder=3, label="transmitter")
    low, high = np.vstack([tx, receivers])[:, :2].min(0), np.vstack([tx, receivers])[:, :2].max(0)
    axis.set(xlim=(low[0] - 2.2, high[0] + 2.2), ylim=(low[1] - 2.8, high[1] + 2.6), aspect="equal", xlabel="x, m", ylabel="y, m")
    axis.legend(loc="upper right", frameon=False)
    axis.set_title("Paths that corf and Sionna RT share, from above", loc="left")
    save(figure, path)


def coefficients(path, links):
    """How far the coefficients of same paths differ, against their gain."""
    figure, axis = plt.subplots(figsize=(7.2, 3.4))
    colours = plt.get_cmap("viridis")(np.linspace(0, 0.9, len(links)))
    for link, colour in zip(links, colours):
        axis.scatter(
            [p["gain_db"] for p in link.pairs],
            [max(p["relative_a"], 1e-8) for p in link.pairs],
            s=14,
            color=colour,
            label=f"receiver {link.index}",
        )
    axis.axhline(MAX_RELATIVE_A, color=CORF, lw=1)
    axis.text(axis.get_xlim()[0], MAX_RELATIVE_A * 1.15, " tolerance", color=CORF, va="bottom")
    axis.set(yscale="log", xlabel="gain of the path, dB", ylabel="|Δa| / |a|", ylim=(1e-7, 1), xlim=(-180, None))
    axis.legend(frameon=False, ncol=3, fontsize=8, loc="lower left")
    axis.set_title("Complex coefficients of the same paths: corf (double) against Sionna RT (single precision)", loc="left")
    save(figure, path)


def diffuse(path, scattered):
    """Differences of the totals and of the objects, in dB."""
    figure, (left, right) = plt.subplots(1, 2, figsize=(9.2, 3.4), width_ratios=(1, 1.6))
    totals = scattered["totals"]
    left.errorbar(
        range(len(totals)),
        [t["difference_db"] for t in totals],
        yerr=[t["error_db"] for t in totals],
        fmt="o",
        color=THEIRS,
        capsize=3,
    )
    left.axhspan(-0.1, 0.1, color=CORF, alpha=0.12, lw=0)
    left.axhline(0, color=INK, lw=0.6)
    span = max(0.15, 1.2 * max(abs(t["difference_db"]) + t["error_db"] for t in totals))
    left.set(xlabel="receiver", ylabel="corf − Sionna RT, dB", ylim=(-span, span), xticks=range(len(totals)))
    left.set_title("Total diffuse power; band: ±0.1 dB", loc="left")
    for r, rows in enumerate(scattered["objects"]):
        right.scatter(
            [10 * np.log10(row["theirs"]) for row in rows if row["theirs"] > 0],
            [row["in_errors"] for row in rows if row["theirs"] > 0],
            s=10,
            label=f"receiver {r}",
        )
    right.axhspan(-4, 4, color=CORF, alpha=0.12, lw=0)
    right.axhline(0, color=INK, lw=0.6)
    right.set(xlabel="power scattered by the object, dB", ylabel="difference, standard errors")
    right.set_title("Every object; band: ±4 standard errors", loc="left")
    right.legend(frameon=False, fontsize=7, ncol=2)
    figure.tight_layout()
    save(figure, path)


def spectra(path, maps, range_db, rows=3):
    """Maps of both sides side by side, and their difference."""
    chosen = np.unique(np.linspace(0, len(maps) - 1, min(rows, len(maps))).round().astype(int))
    figure, axes = plt.subplots(len(chosen), 4, figsize=(12, 2.15 * len(chosen)), squeeze=False, layout="constrained")
    extent = (AZIMUTH_DEG[0], AZIMUTH_DEG[-1], ELEVATION_DEG[0], ELEVATION_DEG[-1])
    for line, r in zip(axes, chosen):
        db = {k: 10 * np.log10(np.maximum(v, 1e-30)) for k, v in maps[r].items() if not k.endswith("_error")}
        peak = max(db["ours"].max(), db["theirs"].max())
        within = np.maximum(db["ours"], db["theirs"]) >= peak - range_db
        difference = np.where(within, db["ours"] - db["theirs"], np.nan)
        for axis, image, options, title in (
            (line[0], db["theirs"], {"vmin": peak - range_db, "vmax": peak, "cmap": "inferno"}, f"receiver {r}: Sionna RT"),
            (line[1], db["ours"], {"vmin": peak - range_db, "vmax": peak, "cmap": "inferno"}, "corf, the same paths"),
            (line[2], difference, {"vmin": -0.2, "vmax": 0.2, "cmap": "RdBu_r"}, "corf − Sionna RT, dB"),
            (line[3], db["everything"] - db["ours"], {"vmin": 0, "vmax": 3, "cmap": "viridis"}, "what Sionna RT lacks, dB"),
        ):
            shown = axis.imshow(image, origin="lower", extent=extent, aspect="auto", **options)
            axis.set_title(title, loc="left", fontsize=8)
            # Azimuth counts towards the array's left, so that the picture is what the camera sees.
            axis.invert_xaxis()
            figure.colorbar(shown, ax=axis, fraction=0.045)
    axes[-1][0].set(xlabel="azimuth, °", ylabel="elevation, °")
    save(figure, path)
