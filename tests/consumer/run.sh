#!/usr/bin/env bash
# Installs the filter library of a build folder into a folder of its own, then configures, builds and runs a
# foreign project against the install: tests/consumer/run.sh BUILD_DIR
set -euo pipefail
build=$(cd "${1:?usage: tests/consumer/run.sh BUILD_DIR}" && pwd)
here=$(cd "$(dirname "$0")" && pwd)
work=$(mktemp -d)
trap 'rm -rf "$work"' EXIT

cmake --install "$build" --component filter --prefix "$work/installed" >/dev/null
cp "$here/CMakeLists.txt" "$here/consumer.cc" "$work/"  # out of the tree: our headers must not be found there
cmake -S "$work" -B "$work/build" -G Ninja -DCMAKE_BUILD_TYPE=Release -DCMAKE_PREFIX_PATH="$work/installed" >/dev/null
cmake --build "$work/build"
"$work/build/consumer"
