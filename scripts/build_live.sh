#!/usr/bin/env bash
# Builds the simulator that `gic view --live` puts into its page: crates/gic-live as WebAssembly with SIMD, next to the
# page's script, with a hash of the sources that it is of. Run it after a change of gic-live, gic-mpm or gic-simd: a test
# of gic-live compares the hash. Needs the target: rustup target add wasm32-unknown-unknown
set -euo pipefail
cd "$(dirname "$0")/.."
module=crates/gic-view/src/page/live/gic_live.wasm
# Speed before size: at opt-level s nothing is inlined into the lanes, and it is 20 times slower and larger.
export CARGO_INCREMENTAL=0 CARGO_PROFILE_RELEASE_OPT_LEVEL=3 CARGO_PROFILE_RELEASE_LTO=fat \
  CARGO_PROFILE_RELEASE_CODEGEN_UNITS=1 CARGO_PROFILE_RELEASE_PANIC=abort CARGO_PROFILE_RELEASE_STRIP=symbols \
  CARGO_PROFILE_RELEASE_DEBUG=false
# No path of this machine stays in the messages of the module.
export RUSTFLAGS="-C target-feature=+simd128 --remap-path-prefix=$PWD=. --remap-path-prefix=${CARGO_HOME:-$HOME/.cargo}=cargo"
cargo build --release --quiet --locked -p gic-live --lib --target wasm32-unknown-unknown --target-dir target/live
cp target/live/wasm32-unknown-unknown/release/gic_live.wasm "$module"
GIC_LIVE_WRITE_HASH=1 RUSTFLAGS='' cargo test --release --quiet --locked -p gic-live --test module_is_fresh >/dev/null
ls -l "$module"
