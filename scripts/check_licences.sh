#!/usr/bin/env bash
# Licences, sources and advisories of all dependencies (deny.toml), with cargo-deny from its crate.
# Advisories need the RustSec database, which is fetched from the network: where it cannot be had, that one check is skipped, visibly.
set -euo pipefail
cd "$(dirname "$0")/.."
version=0.20.2
if ! cargo deny --version 2>/dev/null | grep -qx "cargo-deny $version"; then
  cargo install cargo-deny --version "$version" --locked --quiet
fi
cargo deny --locked check bans licenses sources
if ! timeout 60 cargo deny --locked fetch db >/dev/null 2>&1; then
  echo "SKIPPED: advisories, for the RustSec database cannot be fetched here"
else
  cargo deny --locked check --disable-fetch advisories
fi
