"""The optical stage of a finished `rf-3dgs` run beside gsplat's own trainer settings: the same images, points, steps and held-out keyframes.

    corf reconstruct DATASET --out RUN --method rf-3dgs --device gpu
    corf evaluate RUN
    python -m venv .venv && .venv/bin/pip install -r tools/requirements-gsplat.txt     (torch with CUDA, and nvcc)
    .venv/bin/python tools/compare_gsplat.py RUN --out gsplat.json

gsplat 1.5.3 trains with its DefaultStrategy and the settings of its example trainer: dense Adam, the rate of positions falling to a hundredth over
all steps, one more band of harmonics every 1000 steps, 0.8 L1 + 0.2 (1 − SSIM), black background, no antialiasing. It begins with RUN's
initial_points.ply, trains for RUN's optical_steps on the keyframes RUN trained with and is evaluated on those in RUN's metrics.json, by the same PSNR
of 8-bit images. World and units are RUN's: nothing is normalised. Prints both, frame by frame and in the mean, and writes them as JSON.

What remains different on gsplat's side: it resets opacities before its first step as well, its SSIM looks at whole windows only, and its near plane
is at 0.01. docs/baselines.md says what differs on ours.
"""

import argparse
import json
import math
import random
import struct
import sys
import time
from pathlib import Path

# Rates of gsplat's example trainer; that of positions is times the scene's extent.
RATES = {"means": 1.6e-4, "scales": 5e-3, "quats": 1e-3, "opacities": 5e-2, "sh0": 2.5e-3, "shN": 2.5e-3 / 20}
SH_DEGREE = 3
SH_INTERVAL = 1000
SH_C0 = 0.28209479177387814
INITIAL_OPACITY = 0.1
LAST_POSITION_RATE = 0.01
SSIM_WEIGHT = 0.2
NEAR, FAR = 0.01, 1e10


def arguments():
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("run", type=Path, help="folder of a finished and evaluated rf-3dgs run")
    parser.add_argument("--dataset", type=Path, help="the run's dataset, if it has moved")
    parser.add_argument("--steps", type=int, help="steps (default: the run's optical_steps)")
    parser.add_argument("--seed", type=int, default=1)
    parser.add_argument("--device", default="cuda", help="as torch names it (default: cuda)")
    parser.add_argument("--out", type=Path, help="JSON file for the figures")
    args = parser.parse_args()
    if args.steps is not None and args.steps < 1:
        parser.error("--steps must be 1 or more")
    return args


def fail(message):
    sys.exit(f"error: {message}")


def read_json(path, made_by):
    try:
        return json.loads(path.read_text())
    except OSError as error:
        fail(f"{error}\n  help: {made_by}")
    except json.JSONDecodeError as error:
        fail(f"{path} is no JSON: {error}")


def read_points(path):
    """Positions and colours of a binary PLY of `float x y z`, `uchar red green blue`."""
    data = path.read_bytes()
    header, mark, body = data.partition(b"end_header\n")
    lines = header.decode("ascii", "replace").splitlines()
    wanted = [f"property float {c}" for c in "xyz"] + [f"property uchar {c}" for c in ("red", "green", "blue")]
    properties = [line for line in lines if line.startswith("property")]
    counts = [line.split()[2] for line in lines if line.startswith("element vertex ")]
    if not mark or lines[:2] != ["ply", "format binary_little_endian 1.0"] or properties != wanted or len(counts) != 1:
        raise ValueError(f"{path} is not the PLY of points that corf writes")
    if len(body) != int(counts[0]) * 15:
        raise ValueError(f"{path} has {len(body)} bytes of data where {counts[0]} points take {int(counts[0]) * 15}")
    rows = list(struct.iter_unpack("<3f3B", body))
    return [row[:3] for row in rows], [row[3:] for row in rows]


def split_of(count, held_out, protocol, test_every):
    """Keyframes to train with: all that are not held out and, under `validation`, no test keyframe."""
    left_out = set(held_out)
    if protocol == "validation":
        left_out |= set(range(0, count, test_every))
    return [i for i in range(count) if i not in left_out]


def extent_of(positions):
    """1.1 times the largest distance of a camera from the mean of all."""
    mean = [sum(p[k] for p in positions) / len(positions) for k in range(3)]
    return 1.1 * max(math.dist(p, mean) for p in positions)


def inverse(rigid):
    """The inverse of a 4×4 rigid transform, by rows."""
    rotation = [[rigid[c][r] for c in range(3)] for r in range(3)]
    moved = [-sum(rotation[r][k] * rigid[k][3] for k in range(3)) for r in range(3)]
    return [rotation[r] + [moved[r]] for r in range(3)] + [[0.0, 0.0, 0.0, 1.0]]


def epochs(count, seed):
    """Numbers 0 … count − 1 in one random order after another."""
    draw = random.Random(seed)
    while True:
        order = list(range(count))
        draw.shuffle(order)
        yield from order


def degree_of(step):
    """Highest band learnt in a step, from 0."""
    return min(step // SH_INTERVAL, SH_DEGREE)


def psnr(mean_squared_error):
    """Of images in 0 … 1; 100 for equal ones, as corf has it."""
    return min(100.0, -10.0 * math.log10(mean_squared_error)) if mean_squared_error > 0 else 100.0


def report(held_out, ours, theirs):
    """The lines of the comparison, and the difference of the means."""
    lines = ["keyframe   rf-3dgs    gsplat   difference"]
    row = lambda name, a, b: f"{name:>8} {a:9.2f} {b:9.2f} {a - b:+12.2f}"
    lines += [row(index, a, b) for index, a, b in zip(held_out, ours, theirs)]
    means = [sum(values) / len(values) for values in (ours, theirs)]
    return lines + [row("mean", *means)], means[0] - means[1]


class Images:
    """A dataset's images and cameras on a device."""

    def __init__(self, torch, dataset, header, keyframes, device):
        import numpy
        from PIL import Image

        self.torch, self.device = torch, device
        camera = header["optical_camera"]
        self.width, self.height = camera["width"], camera["height"]
        intrinsics = [[camera["fx"], 0.0, camera["cx"]], [0.0, camera["fy"], camera["cy"]], [0.0, 0.0, 1.0]]
        self.intrinsics = torch.tensor([intrinsics], dtype=torch.float32, device=device)
        self.views = [torch.tensor([inverse(k["world_from_camera"])], dtype=torch.float32, device=device) for k in keyframes]
        self.files = [dataset / "optical" / "images" / f"{k['file']}.png" for k in keyframes]
        # 8 bits a value on the device, too: a hundred and fifty images of 1600×900 are 0.6 GB.
        self.pixels = [torch.from_numpy(numpy.array(Image.open(f).convert("RGB"))).to(device) for f in self.files]

    def of(self, index):
        return self.pixels[index].float()[None] / 255.0


def begin(torch, points, colors, extent, device):
    """Parameters and optimisers as gsplat's example trainer has them."""
    means = torch.tensor(points, dtype=torch.float32, device=device)
    # To the three nearest others, in portions that fit in memory.
    nearest = [torch.cdist(part, means).topk(4, largest=False).values[:, 1:] for part in means.split(2048)]
    distance = torch.cat(nearest).square().mean(-1).clamp_min(1e-7).sqrt()
    count = len(points)
    harmonics = torch.zeros((count, (SH_DEGREE + 1) ** 2, 3), device=device)
    harmonics[:, 0] = (torch.tensor(colors, dtype=torch.float32, device=device) / 255.0 - 0.5) / SH_C0
    quats = torch.zeros((count, 4), device=device)
    quats[:, 0] = 1.0
    values = {
        "means": means,
        "scales": distance.log()[:, None].repeat(1, 3),
        "quats": quats,
        "opacities": torch.logit(torch.full((count,), INITIAL_OPACITY, device=device)),
        "sh0": harmonics[:, :1].contiguous(),
        "shN": harmonics[:, 1:].contiguous(),
    }
    splats = torch.nn.ParameterDict({name: torch.nn.Parameter(value) for name, value in values.items()})
    rate = lambda name: RATES[name] * (extent if name == "means" else 1.0)
    optimizers = {
        name: torch.optim.Adam([{"params": splats[name], "lr": rate(name), "name": name}], eps=1e-15, betas=(0.9, 0.999)) for name in values
    }
    return splats, optimizers


def structural_similarity(torch, a, b):
    """Mean SSIM of two images (1, rows, columns, 3) over whole windows of 11×11, σ = 1.5."""
    offsets = torch.arange(-5, 6, dtype=torch.float32, device=a.device)
    weights = torch.exp(-(offsets**2) / (2 * 1.5**2))
    weights = (weights / weights.sum())[:, None] * (weights / weights.sum())[None]
    kernel = weights.expand(3, 1, 11, 11).contiguous()
    blur = lambda x: torch.nn.functional.conv2d(x, kernel, groups=3)
    a, b = a.permute(0, 3, 1, 2), b.permute(0, 3, 1, 2)
    mean_a, mean_b = blur(a), blur(b)
    var_a, var_b, both = blur(a * a) - mean_a**2, blur(b * b) - mean_b**2, blur(a * b) - mean_a * mean_b
    c1, c2 = 0.01**2, 0.03**2
    return ((2 * mean_a * mean_b + c1) * (2 * both + c2) / ((mean_a**2 + mean_b**2 + c1) * (var_a + var_b + c2))).mean()


def render(torch, splats, images, index, degree):
    from gsplat import rasterization

    picture, _, info = rasterization(
        means=splats["means"],
        quats=splats["quats"],
        scales=torch.exp(splats["scales"]),
        opacities=torch.sigmoid(splats["opacities"]),
        colors=torch.cat([splats["sh0"], splats["shN"]], 1),
        viewmats=images.views[index],
        Ks=images.intrinsics,
        width=images.width,
        height=images.height,
        sh_degree=degree,
        near_plane=NEAR,
        far_plane=FAR,
        packed=False,
        rasterize_mode="classic",
    )
    return picture, info


def train(torch, splats, optimizers, images, training, steps, extent, seed):
    from gsplat import DefaultStrategy

    strategy = DefaultStrategy()
    strategy.check_sanity(splats, optimizers)
    state = strategy.initialize_state(scene_scale=extent)
    schedule = torch.optim.lr_scheduler.ExponentialLR(optimizers["means"], gamma=LAST_POSITION_RATE ** (1.0 / steps))
    order = epochs(len(training), seed)
    for step in range(steps):
        index = training[next(order)]
        picture, info = render(torch, splats, images, index, degree_of(step))
        strategy.step_pre_backward(splats, optimizers, state, step, info)
        target = images.of(index)
        difference = torch.nn.functional.l1_loss(picture, target)
        loss = difference * (1.0 - SSIM_WEIGHT) + (1.0 - structural_similarity(torch, picture, target)) * SSIM_WEIGHT
        loss.backward()
        for optimizer in optimizers.values():
            optimizer.step()
            optimizer.zero_grad(set_to_none=True)
        schedule.step()
        strategy.step_post_backward(splats, optimizers, state, step, info, packed=False)
        if step % 1000 == 999:
            print(f"gsplat: step {step + 1} of {steps}, {len(splats['means'])} Gaussians, loss {loss.item():.4f}", file=sys.stderr)


def evaluate(torch, splats, images, held_out):
    out = []
    with torch.no_grad():
        for index in held_out:
            picture, _ = render(torch, splats, images, index, SH_DEGREE)
            shown = (picture.clamp(0.0, 1.0) * 255.0).round() / 255.0
            out.append(psnr((shown - images.of(index)).double().square().mean().item()))
    return out


def main():
    args = arguments()
    info = read_json(args.run / "run.json", "give the folder of a finished run")
    metrics = read_json(args.run / "metrics.json", f"run `corf evaluate {args.run}` first")
    if not info["method"].startswith("rf-3dgs") or metrics.get("status") != "done":
        fail(f"{args.run} is no finished and evaluated run of rf-3dgs")
    steps = args.steps or info["config"]["optical_steps"]
    dataset = args.dataset or Path(info["dataset"])
    described = read_json(dataset / "dataset.json", "name the run's dataset with --dataset")
    keyframes = read_json(dataset / "trajectory.json", "name the run's dataset with --dataset")["keyframes"]
    header = described["header"]
    held_out = [frame["index"] for frame in metrics["frames"]]
    training = split_of(len(keyframes), held_out, info.get("protocol", "test"), header["split"]["test_every"])
    positions = [[row[3] for row in keyframes[i]["world_from_camera"][:3]] for i in training]
    try:
        points, colors = read_points(args.run / "initial_points.ply")
    except (OSError, ValueError) as error:
        fail(error)
    try:
        import torch
        import gsplat
    except ImportError as error:
        fail(f"{error}\n  help: pip install -r tools/requirements-gsplat.txt, beside a build of torch for CUDA")
    torch.manual_seed(args.seed)
    images = Images(torch, dataset, header, keyframes, args.device)
    extent = extent_of(positions)
    splats, optimizers = begin(torch, points, colors, extent, args.device)
    start = time.perf_counter()
    train(torch, splats, optimizers, images, training, steps, extent, args.seed)
    if args.device.startswith("cuda"):
        torch.cuda.synchronize()
    seconds = time.perf_counter() - start
    ours = [frame["psnr_opt"] for frame in metrics["frames"]]
    theirs = evaluate(torch, splats, images, held_out)
    lines, difference = report(held_out, ours, theirs)
    print("\n".join(lines))
    optical = {stage["name"]: stage["seconds"] for stage in info.get("stages", [])}.get("optical")
    print(f"Gaussians: rf-3dgs {info['gaussians']}, gsplat {gsplat.__version__} {len(splats['means'])}")
    print(f"optical stage, seconds: rf-3dgs {optical if optical is None else round(optical, 1)} on {info['device']}, gsplat {seconds:.1f}")
    if args.out:
        figures = {
            "run": str(args.run),
            "steps": steps,
            "training": training,
            "held_out": held_out,
            "psnr_opt": {"rf-3dgs": ours, "gsplat": theirs},
            "difference_db": difference,
            "gaussians": {"rf-3dgs": info["gaussians"], "gsplat": len(splats["means"])},
            "seconds": {"rf-3dgs": optical, "gsplat": seconds},
            "gsplat": gsplat.__version__,
            "torch": torch.__version__,
            "device": torch.cuda.get_device_name() if args.device.startswith("cuda") else args.device,
        }
        args.out.write_text(json.dumps(figures, indent=1) + "\n")


if __name__ == "__main__":
    main()
