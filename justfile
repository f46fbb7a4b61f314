# The commands of CONTRIBUTING.md by a word each, for those who have `just`.

# The command, optimised
build:
    cargo build --release

# The same with the GPU device
build-gpu:
    cargo build --release -p corf-bench --features gpu

# A small lobby, end to end
demo:
    cargo run --release -- demo

# Everything a change must pass
check *steps:
    tools/check.sh {{steps}}

# The slow end-to-end tests as well
test-slow:
    cargo test --release -p corf-tests --features slow

# The documents as a site, target/book/index.html (`cargo install mdbook --version 0.5.4 --locked`)
book:
    mdbook build

# Digests of what the program computes, before and after code is moved
digests: build
    python3 tools/digests.py
