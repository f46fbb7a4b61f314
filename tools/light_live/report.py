"""The report, and the table on the terminal."""

from .compare import MAX_MEAN_DEVIATION, MIN_PSNR_DB

MODEL = """corf's reflection is a GGX lobe with height-correlated Smith shadowing and Schlick's Fresnel term over a Lambertian base in the coupled
form of Kelemen and Szirmay-Kalos (2001). No plugin of Mitsuba's has that base. What must agree is therefore Mitsuba with a plugin that
implements these formulas anew in Python, with its own albedo table (`tools/light_live/bsdf.py`), put in place of `principled` when the exported file
is loaded; geometry, cameras, textures, emitters, panes, masks, the sampling of lights and the integrator are Mitsuba's. Beside it stands the
exported file as it is: `principled`'s base does not give up what the lobe above it reflects, so its rooms are brighter."""


def db(value):
    return f"{value:.1f}"


def percent(ratio):
    return f"{100 * (ratio - 1):+.2f} %"


def verdict(passes):
    return "agrees" if passes else "DIFFERS"


def rows(record):
    for r in record["scenes"]:
        d, p = r["documented"], r["plain"]
        yield [
            r["scene"],
            percent(d["ratio"]),
            f"{100 * d['ratio_error']:.2f} %",
            db(d["psnr_db"]),
            verdict(d["passes"]),
            percent(p["ratio"]),
            db(p["psnr_db"]),
        ]


def control_rows(record):
    for c in record["controls"]:
        yield [c["control"], percent(c["ratio"]), db(c["psnr_db"]), "NOT NOTICED" if c["passes"] else "fails, as it must"]


def table(record):
    """Plain text."""
    head = ["scene", "corf/Mitsuba", "error", "PSNR dB", "verdict", "own plugins", "PSNR dB"]
    lines = [head, *rows(record)]
    widths = [max(len(row[k]) for row in lines) for k in range(len(head))]
    text = "\n".join("  ".join(word.ljust(w) for word, w in zip(row, widths)).rstrip() for row in lines)
    for row in control_rows(record):
        text += "\ncontrol: " + ", ".join(row)
    for r in record["scenes"]:
        for name, (samples, seconds, psnr_db) in r.get("equal_time", {}).items():
            text += f"\n{r['scene']}: {name} {samples} samples in {seconds:.1f} s: {db(psnr_db)} dB"
    return text


def grid(head, lines):
    return "\n".join(["| " + " | ".join(row) + " |" for row in [head, ["---"] * len(head), *lines]])


def markdown(record):
    """The report as Markdown."""
    m = record["machine"]
    parts = [
        "# corf's light beside Mitsuba 3",
        f"`python tools/check_light.py --corf target/release/corf --out DIR --controls`, corf {m['corf']}, Mitsuba {m['mitsuba']} ({m['variant']}, "
        f"{m['llvm']}), {m['threads']} threads of {m['cpu']}.",
        MODEL,
        "## Agreement",
        f"Each side rendered every view twice with independent numbers. Agreement asks the ratio of mean linear radiance (of pixels that do not look into a lamp) within "
        f"{100 * MAX_MEAN_DEVIATION:g} % and a PSNR of {MIN_PSNR_DB:g} dB between 8-bit pictures (corf's developer), from the mean of (c₁ − m₁)(c₂ − m₂), in "
        "which neither side's noise has an expectation. The error is the means' own, from their halves.",
        grid(["scene", "corf ÷ Mitsuba", "error", "PSNR, dB", "verdict", "own plugins: ratio", "PSNR, dB"], rows(record)),
        "By view: "
        + "; ".join(
            f"{r['scene']} "
            + ", ".join(
                f"{percent(a)} / {db(b)} dB"
                for a, b in zip(r["documented"]["view_ratios"], r["documented"]["view_psnrs_db"])
            )
            for r in record["scenes"]
        )
        + ".",
    ]
    if record["controls"]:
        parts += [
            "## Controls",
            "corf with a wrong scene against Mitsuba with the right one.",
            grid(["what is wrong", "corf ÷ Mitsuba", "PSNR, dB", "verdict"], control_rows(record)),
        ]
    timed = [r for r in record["scenes"] if "equal_time" in r]
    if timed:
        lines = [
            [
                r["scene"],
                *(f"{n} in {s:.1f} s: **{db(p)} dB**" for n, s, p in (r["equal_time"]["corf"], r["equal_time"]["mitsuba"])),
            ]
            for r in timed
        ]
        parts += [
            "## At equal time",
            "Paths a pixel in about the same wall time on the same cores, and PSNR against the mean of both converged images, without that one's noise. Reading, "
            "building and compiling are left out on both sides. Mitsuba runs the Python plugin, compiled by LLVM with the rest of its kernel.",
            grid(["scene", "corf", "Mitsuba"], lines),
        ]
    parts.append("## Pictures")
    for r in record["scenes"]:
        e = r["export"]
        parts.append(
            f"### {r['scene']}\n{r['about']}. {r['views']} views of {r['size'][0]}×{r['size'][1]}, 2 × {r['samples']} samples a pixel and side, up to {r['max_bounces']} bounces, "
            f"exposure {r['exposure_ev']:+.2f} EV; {e['shapes']} shapes, {e['materials']} materials, {e['textures']} textures, {e['emitters']} emitters; `{r['integrator']}`.\n\n"
            f"![{r['scene']}]({r['scene']}.png)"
        )
        if e["approximated"]:
            parts.append("The file cannot say: " + "; ".join(e["approximated"]) + ".")
    return "\n\n".join(parts) + "\n"
