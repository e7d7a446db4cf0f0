#!/usr/bin/env bash
# Installs the packages of Debian 12 or 13 that Lumifold needs, and nothing where all are there.
#   deploy/setup.sh          what building and running needs
#   deploy/setup.sh --tests  that, and what the tests need
set -euo pipefail

packages=(
  g++ cmake ninja-build ccache pkg-config ca-certificates
  libembree-dev libdraco-dev libmeshoptimizer-dev libwebp-dev libopenexr-dev libpng-dev libjpeg-dev libtinygltf-dev nlohmann-json3-dev
  libgrpc++-dev protobuf-compiler protobuf-compiler-grpc libprotobuf-dev libabsl-dev
  libspdlog-dev libfmt-dev libcli11-dev libyaml-cpp-dev libopencolorio-dev libsqlite3-dev libpq-dev libssl-dev libxxhash-dev libzstd-dev
  prometheus-cpp-dev libboost-dev libseccomp-dev zlib1g-dev libcurl4-openssl-dev
  libtbb-dev libeigen3-dev libhwy-dev opencl-c-headers
)
test_packages=(clang libclang-rt-dev libgtest-dev libgmock-dev libbenchmark-dev python3 git clang-format-19 clang-tidy-19
               postgresql iproute2 nftables e2fsprogs openssl
               munge slurm-wlm slurmdbd mariadb-server sqlite3 rsync
               blender python3-numpy
               chromium chromium-driver prometheus crun mmdebstrap golang-github-containers-common
               zsh fish groff-base openimageio-tools python3-jsonschema python3-grpcio python3-protobuf python3-xxhash
               help2man lintian systemd
               ocl-icd-libopencl1 pocl-opencl-icd)
# Node comes with or without npm, and not always from Debian.
command -v npm >/dev/null || test_packages+=(nodejs npm)
[ "${1:-}" = --tests ] && packages+=("${test_packages[@]}")

missing=()
for package in "${packages[@]}"; do
  dpkg-query -W -f='${Status}' "$package" 2>/dev/null | grep -q 'ok installed' || missing+=("$package")
done
[ ${#missing[@]} = 0 ] && exit 0

as_root=()
if [ "$(id -u)" != 0 ]; then
  command -v sudo >/dev/null || { echo "setup: not root and no sudo; please install: ${missing[*]}" >&2; exit 1; }
  as_root=(sudo)
fi
echo "setup: installing ${missing[*]}" >&2
export DEBIAN_FRONTEND=noninteractive
# An installation that was interrupted, whoever began it, is brought to its end: apt-get refuses to work
# before.
"${as_root[@]}" dpkg --configure -a >&2
"${as_root[@]}" apt-get update -qq >&2
"${as_root[@]}" apt-get install -y -qq --no-install-recommends "${missing[@]}" >&2
