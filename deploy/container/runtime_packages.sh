#!/usr/bin/env bash
# Prints the Debian packages of the shared libraries that PROGRAM names, a line each: what an image of it
# installs.
#   deploy/container/runtime_packages.sh PROGRAM
set -euo pipefail
program=$1
needed=$(objdump -p "$program" | awk '$1 == "NEEDED" { print $2 }')
# dpkg may know a file of /usr by its name before the folders were merged.
ldd "$program" | awk -v needed="$needed" 'BEGIN { n = split(needed, names); for (i in names) want[names[i]] } $1 in want && $3 { print $3 }' |
  xargs realpath | sed 'p; s:^/usr::' | { xargs dpkg-query -S 2>/dev/null || true; } | cut -d: -f1 | sort -u
