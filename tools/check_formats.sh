#!/usr/bin/env bash
# Makes every export of a data set and of its scene's links in a scratch folder, and has check_formats.py read them with the programs that they are for.
#
#     tools/check_formats.sh DATASET SCENE.toml [RUN]        (corf from target/release or $CORF; Python with tools/requirements-formats.txt from $PYTHON)
set -euo pipefail
dataset=$1 scene=$2 run=${3:-}
corf=${CORF:-target/release/corf} python=${PYTHON:-python3}
scratch=$(mktemp -d)
trap 'rm -rf "$scratch"' EXIT
for form in numpy nerfstudio rf-3dgs; do
    "$corf" dataset export "$dataset" --to "$form" --out "$scratch/$form"
done
"$corf" dataset export "$dataset" --to nerf2 --scene "$scene" --out "$scratch/nerf2"
"$corf" dataset publish "$dataset" --out "$scratch/publication" --licence cc-by-4.0 --title 'Room: "tiny"' --author 'Doe, Jane' --author 'The Lab' \
    --date 2026-11-29 --url https://example.org/room
links=("$scene" --rx-trajectory 5)
"$corf" paths "${links[@]}" --out "$scratch/links.json"
"$corf" paths "${links[@]}" --format deepmimo --out "$scratch/links"
"$corf" paths "${links[@]}" --format qd --out "$scratch/qd"
"$corf" paths "${links[@]}" --format qd-json --out "$scratch/qd-json"
small=(--device cpu --set iterations=20 --set width=16 --checkpoint-every 0)
"$corf" reconstruct "$dataset" --method nerf2 "${small[@]}" --set rays=64 --out "$scratch/network"
"$corf" reconstruct "$dataset" --method wrf-gs-plus "${small[@]}" --set random_points=200 --out "$scratch/gaussians"
"$python" "$(dirname "$0")/check_formats.py" "$dataset" ${run:+--run "$run"} --numpy "$scratch/numpy" --nerfstudio "$scratch/nerfstudio" \
    --rf-3dgs "$scratch/rf-3dgs" --nerf2 "$scratch/nerf2" --deepmimo "$scratch/links" --links "$scratch/links.json" \
    --publication "$scratch/publication" --qd "$scratch/qd" "$scratch/qd-json" \
    --arrays "$scratch/network/nerf2" "$scratch/gaussians/wrf-gs-plus" --controls
