#!/usr/bin/env bash
# Measures coupled training steps on this machine's GPU and writes what was found to a folder:
#   tools/bench_step.sh OUT [PEER]
# OUT/table.{json,txt}: the six published workloads; OUT/variants.txt: the same with other tiles, batches and ways of blending.
# PEER is a script that writes its Gaussians with `--n N --ply FILE` (PLY, coupled columns) and measures itself with
# `--n --w --h --rf-w --rf-h --engine`; with it both sides get the same Gaussians in the same run. CORF names the program
# (default: built here), PEER_ENGINES the peer's engines.
set -euo pipefail
out=${1:?usage: tools/bench_step.sh OUT [PEER]}
peer=${2:-}
cd "$(dirname "$0")/.."
mkdir -p "$out"
if [ -z "${CORF:-}" ]; then
    cargo build --release -p corf-bench --features gpu
    CORF=${CARGO_TARGET_DIR:-target}/release/corf
fi
ply=()
if [ -n "$peer" ]; then
    for n in 200000 1000000; do
        python3 "$peer" --n "$n" --ply "$out/$n.ply"
        ply+=(--ply "$out/$n.ply")
    done
fi
"$CORF" bench step --table --device gpu "${ply[@]}" | tee "$out/table.txt"
"$CORF" bench step --table --device gpu "${ply[@]}" --json >"$out/table.json"
# A variant that the adapter has no workgroup memory for says so.
"$CORF" bench step --table --device gpu --repeats 3 --variant 8x8/32 --variant 8x8/32/apart --variant 8x8/32/portable --variant 8x4/32 \
    --variant 8x4/16/by4 --variant 16x8/32 "${ply[@]}" 2>&1 | tee "$out/variants.txt" || true
if [ -n "$peer" ]; then
    for engine in ${PEER_ENGINES:-gsplat fastergs}; do
        for w in "200000 640 480 640 480" "200000 160 120 160 120" "200000 1280 720 1280 720" "1000000 640 480 640 480" \
                 "200000 1600 900 300 200" "1000000 1600 900 300 200"; do
            read -r n a b c d <<<"$w"
            python3 "$peer" --engine "$engine" --n "$n" --w "$a" --h "$b" --rf-w "$c" --rf-h "$d" || true
        done
    done 2>&1 | tee "$out/peer.txt"
fi
rm -f "$out"/*.ply
