#!/usr/bin/env bash
# Builds and tests Lumifold on another Debian than this machine's, in a root that mmdebstrap makes:
#   tests/systems/run.sh SYSTEM [STEP]
# SYSTEM is debian-12, debian-13, or arm64: Debian 13's cross compiler. STEP is one of
#   quickstart  deploy/quickstart.sh
#   unit        the unit tests
#   farm        a farm, the page in a browser, the Blender add-on, the packages; then one farm of this system and the other
#   all         quickstart, unit and farm (default)
#   tests       tests/run.sh
#   cross       compiles the programs and the renderer's tests for arm64, and runs them in an emulator: the only step of arm64
#   gate        for tests/run.sh of this system: builds everything and renders a picture, where `all` has passed once
# Roots are kept, with what was built in them, below LUMIFOLD_SYSTEMS_DIR (default:
# ~/.cache/lumifold/systems). The sources are those of the working tree. Exit code 77: it cannot run here, and
# says why.
set -euo pipefail
cd "$(dirname "$0")/../.."

system=${1:?usage: tests/systems/run.sh SYSTEM [STEP]}
step=${2:-$([ "$system" = arm64 ] && echo cross || echo all)}
declare -A suites=([debian-12]=bookworm [debian-13]=trixie [arm64]=trixie)
suite=${suites[$system]:?no such system}
root=${LUMIFOLD_SYSTEMS_DIR:-${XDG_CACHE_HOME:-$HOME/.cache}/lumifold/systems}/$system/root

skip() { echo "SKIPPED: $*"; exit 77; }
[ "$(id -u)" = 0 ] || skip "$system needs root, for chroot"
for tool in mmdebstrap rsync unshare; do command -v "$tool" >/dev/null || skip "no $tool (deploy/setup.sh --tests)"; done

make_root() {
  # Sources of software as the system has them when it is new, and services that do not start in a root.
  mkdir -p "$(dirname "$root")"
  mmdebstrap --quiet --variant=apt --include=ca-certificates \
    --architectures="$([ "$system" = arm64 ] && echo amd64,arm64 || dpkg --print-architecture)" \
    --customize-hook='printf "#!/bin/sh\nexit 101\n" >"$1/usr/sbin/policy-rc.d"; chmod +x "$1/usr/sbin/policy-rc.d"' \
    "$suite" "$root.new"
  # Authorities of this network, as the machine trusts them.
  cp -r /usr/local/share/ca-certificates/. "$root.new/usr/local/share/ca-certificates/"
  chroot "$root.new" update-ca-certificates >/dev/null
  mv "$root.new" "$root"
}

# Runs a command in the root, in the folder of the sources. Mounts end with the command.
enter() {
  unshare --mount bash -euc 'root=$1; shift
    mount -t proc proc "$root/proc"; mount --rbind /sys "$root/sys"; mount --rbind /dev "$root/dev"; mount -t tmpfs tmpfs "$root/run"
    cp /etc/resolv.conf "$root/etc/resolv.conf"
    exec chroot "$root" env -i PATH=/usr/local/sbin:/usr/local/bin:/usr/sbin:/usr/bin:/sbin:/bin HOME=/root LANG=C.UTF-8 \
      NODE_EXTRA_CA_CERTS=/etc/ssl/certs/ca-certificates.crt LUMIFOLD_SCENES_DIR=/scenes bash -euc "cd /lumifold; $*"' bash "$root" "$@"
}

copy_sources() {
  mkdir -p "$root/lumifold"
  # Without times: what did not change is not built again. Files that are gone go, builds and Git's data stay.
  git ls-files --cached --others --exclude-standard | while read -r file; do if [ -e "$file" ]; then echo "$file"; fi; done |
    rsync -rlp --checksum --files-from=- . "$root/lumifold.new/"
  rsync -rlp --checksum --delete --exclude=/build "$root/lumifold.new/" "$root/lumifold/"
  rm -rf "$root/lumifold.new"
  if [ -n "${LUMIFOLD_SCENES_DIR:-}" ]; then rsync -rl "$LUMIFOLD_SCENES_DIR/" "$root/scenes/"; fi
}

# The tools of this processor, and the libraries of arm64. What is the same on all has no architecture in its
# name.
install_cross='
  tools=(crossbuild-essential-arm64 cmake ninja-build ccache pkg-config protobuf-compiler protobuf-compiler-grpc qemu-user python3
         libgtest-dev libgmock-dev:arm64 libbenchmark-dev:arm64)
  eval "$(sed -n "/^packages=(/,/^)/p" deploy/setup.sh)"
  apt-get update -qq
  for package in "${packages[@]}"; do
    case $package in lib*|*-dev) ;; *) continue ;; esac
    apt-cache show "$package" | grep -qx "Architecture: all" && tools+=("$package") || tools+=("$package:arm64")
  done
  DEBIAN_FRONTEND=noninteractive apt-get install -y -qq --no-install-recommends "${tools[@]}"'
build='deploy/setup.sh --tests; cmake --preset gate >/dev/null; cmake --build --preset gate;'
run_step() {
  echo "== $system: $1"
  case $1 in
    quickstart) enter deploy/quickstart.sh ;;
    unit) enter "$build ctest --preset gate --label-regex unit" ;;
    farm)
      enter "$build ctest --preset gate --tests-regex '^(blender\\.|deploy\\.packages|slow\\.install|integration\\.(farm|page_browser)\$)'"
      LUMIFOLD_OTHER_SYSTEM=$root LUMIFOLD_BIN=${LUMIFOLD_BIN:-$PWD/build/release/bin} PYTHONPATH=tests/support \
        python3 tests/systems/two_systems_test.py
      ;;
    tests) enter tests/run.sh ;;
    cross)
      enter "$install_cross"
      enter "cmake --preset arm64 >/dev/null
        cmake --build --preset arm64 --target lumifold_client lumifold_server lumifold_worker render_test
        qemu-aarch64 build/arm64/bin/lumifold-worker --version
        qemu-aarch64 build/arm64/bin/render_test --gtest_filter='Determinism*:EmbreeScene*:Approximations*'"
      ;;
    gate) enter "$build deploy/quickstart.sh" ;;
    *) echo "systems: no step '$1'" >&2; exit 2 ;;
  esac
}

# Whoever interrupts a step leaves a root in which little is built: no part of the gate, which would build the
# rest.
passed=$(dirname "$root")/passed
[ "$step" != gate ] || [ -e "$passed" ] || skip "$system has not passed here before (tests/systems/run.sh $system)"
[ -d "$root" ] || make_root
copy_sources
steps=$step
[ "$step" = all ] && steps="quickstart unit farm"
for one in $steps; do run_step "$one"; done
[ "$step" != all ] || touch "$passed"
