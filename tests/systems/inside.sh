#!/usr/bin/env bash
# Runs a program of another Debian's root (tests/systems/run.sh) on this machine's files:
#   tests/systems/inside.sh SYSTEM PROGRAM [ARGUMENT...]
# The folder of the sources, /tmp and LUMIFOLD_SCENES_DIR are seen there at the same paths; the folder stays the
# same.
set -euo pipefail
PATH=$PATH:/usr/sbin
system=${1:?usage: tests/systems/inside.sh SYSTEM PROGRAM [ARGUMENT...]}
root=${LUMIFOLD_SYSTEMS_DIR:-${XDG_CACHE_HOME:-$HOME/.cache}/lumifold/systems}/$system/root
sources=$(realpath "$(dirname "$0")/../..")
exec unshare --mount bash -euc 'root=$1; sources=$2; here=$PWD; shift 3
  for folder in "$sources" /tmp ${LUMIFOLD_SCENES_DIR:+"$LUMIFOLD_SCENES_DIR"}; do
    mkdir -p "$root$folder"; mount --rbind "$folder" "$root$folder"
  done
  mount -t proc proc "$root/proc"; mount --rbind /sys "$root/sys"; mount --rbind /dev "$root/dev"
  exec chroot "$root" env -i --chdir="$here" PATH=/usr/local/sbin:/usr/local/bin:/usr/sbin:/usr/bin:/sbin:/bin HOME=/root \
    LANG=C.UTF-8 "$@"' bash "$root" "$sources" "$@"
