#!/usr/bin/env bash
# What everybody can run before handing in a change, and what runs on each pull request: formatting, lints, documentation, tests.
#   tools/check.sh [STEP...]     all steps, or those named: fmt clippy doc test gpu tools
# Needs Rust and Python alone. Tests that compare with reference files outside the repository leave themselves out; `gpu` wants any Vulkan, Metal or DirectX 12
# adapter, in software or not.
set -euo pipefail
cd "$(dirname "$0")/.."

fmt() { cargo fmt --all --check; }
clippy() {
    cargo clippy --release --locked --workspace --all-targets --features corf-tests/slow -- -D warnings
    cargo clippy --release --locked -p corf-gpu -p corf -p corf-raytrace -p corf-baselines -p corf-bench --features corf-bench/gpu --all-targets -- -D warnings
}
doc() { RUSTDOCFLAGS="-D warnings -A rustdoc::private-intra-doc-links" cargo doc --release --locked --no-deps --workspace --document-private-items; }
test() { cargo test --release --locked --workspace; }
gpu() {
    local -x CORF_REQUIRE_GPU=1
    # One build for all of them: cargo compiles what they share anew for every other set of features.
    cargo test --release --locked -p corf-gpu -p corf -p corf-raytrace -p corf-baselines -p corf-bench --features corf-bench/gpu \
        --lib --test gpu_device --test gradients --test dense --test wrf_gs_plus
}
tools() { python3 -m unittest discover --start-directory tools --pattern 'test_*.py'; }

[ $# -gt 0 ] || set -- fmt tools clippy doc test
for step in "$@"; do
    case $step in
    fmt | clippy | doc | test | gpu | tools) echo "== $step" && "$step" ;;
    *) echo "tools/check.sh: no step \"$step\"; the steps are fmt, clippy, doc, test, gpu, tools" >&2 && exit 2 ;;
    esac
done
