#!/usr/bin/env bash
# Every crate can be published: it packs with what it needs, and no package is above 10 MB. `--verify` builds each from its package, too.
set -euo pipefail
cd "$(dirname "$0")/.."
verify=--no-verify
[ "${1:-}" != --verify ] || verify=
cargo package --workspace --locked --allow-dirty --quiet $verify
largest=$(($(stat --format=%s target/package/*.crate | sort -n | tail -n 1)))
du --apparent-size -h target/package/*.crate
[ "$largest" -lt 10000000 ] || { echo "check_packages: a package is above 10 MB" >&2; exit 1; }
