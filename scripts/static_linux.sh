#!/usr/bin/env bash
# A static Linux binary of gic in dist/, and a container image of nothing but it; says their sizes.
# The C library is musl where its Rust target can be had (`rustup target add x86_64-unknown-linux-musl`), else glibc, linked statically.
set -euo pipefail
cd "$(dirname "$0")/.."
machine=$(uname -m)
target=$machine-unknown-linux-musl
flags=
if ! rustup target list --installed 2>/dev/null | grep -qx "$target" && ! rustup target add "$target" >/dev/null 2>&1; then
  target=$machine-unknown-linux-gnu
  flags="-C target-feature=+crt-static"
  echo "static_linux: the musl target cannot be had here; glibc is linked statically instead" >&2
fi
if [ -z "$flags" ] && ! command -v "$machine-linux-musl-gcc" >/dev/null; then
  echo "static_linux: $machine-linux-musl-gcc is missing; on Debian: apt-get install musl-tools" >&2
  exit 1
fi
RUSTFLAGS="$flags" cargo build --release --locked -p gic --target "$target" --config 'profile.release.strip=true'
mkdir -p dist
cp "target/$target/release/gic" dist/gic
if ldd dist/gic 2>/dev/null | grep -q '=>'; then
  echo "static_linux: dist/gic is not static:" >&2
  ldd dist/gic >&2
  exit 1
fi
printf 'dist/gic %s: %d MB\n' "$target" $(($(stat --format=%s dist/gic) / 1000000))

# `buildah`, `podman` and `docker` all build the Containerfile; the image is saved as an archive that each of them loads.
image=gic:$(dist/gic --version | cut -d ' ' -f 2)
for tool in buildah podman docker; do
  command -v "$tool" >/dev/null || continue
  "$tool" build --quiet --file Containerfile --tag "$image" dist >/dev/null 2>&1 || continue
  case $tool in
    buildah) buildah push --quiet "$image" "docker-archive:dist/gic-image.tar:$image" ;;
    *) "$tool" save --output dist/gic-image.tar "$image" ;;
  esac
  printf 'dist/gic-image.tar %s: %d MB\n' "$image" $(($(stat --format=%s dist/gic-image.tar) / 1000000))
  exit 0
done
echo "static_linux: no container tool works here (buildah, podman or docker); the image was not made" >&2
exit 1
