#!/usr/bin/env bash
# The documentation builds without warnings. Units and shapes stand in square brackets, such as [m] or [n, 3], which rustdoc
# takes for links, so that its lint is off in Cargo.toml; here every unresolved link that is no unit or count is an error.
set -euo pipefail
cd "$(dirname "$0")/.."
units='m|s|GB|n|frames|kg|N|Pa|J|rad|dB|degrees|decades|pixels|voxels|cells|bytes|spacings|sizes|radii|vertices|colliders|devices'
log=$(mktemp)
RUSTDOCFLAGS="-D warnings --force-warn rustdoc::broken_intra_doc_links" \
  cargo doc --workspace --no-deps --locked --quiet 2>"$log" || { grep -A 6 '^error' "$log" >&2; exit 1; }
if grep -A 2 'unresolved link to' "$log" | grep -vE "unresolved link to \`($units)\`" | grep -A 2 'unresolved link to'; then
  echo "check_rustdoc: these links lead nowhere" >&2
  exit 1
fi
