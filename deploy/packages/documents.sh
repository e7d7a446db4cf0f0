#!/usr/bin/env bash
# The documents of a Debian package, in the folder `share`: manual pages and completion as the program prints
# them, changelogs, and the inventory of the libraries it is linked with.
# With the client comes the Blender add-on.
#   documents.sh PACKAGE BIN SHARE CONTACT
set -euo pipefail
package=$1 bin=$2 share=$3 contact=$4
root=$(cd "$(dirname "$0")/../.." && pwd)
program=$bin/$package
[ "$package" = python3-lumifold ] && program=$bin/lumifold  # its version is that of the client
version=$("$program" --version | sed -nE "s/^$(basename "$program") ([0-9.]+).*/\1/p")
# The same sources make the same packages.
seconds=${SOURCE_DATE_EPOCH:-$(git -C "$root" log -1 --format=%ct 2>/dev/null || stat -c %Y "$root/CHANGELOG.md")}

write() {  # write FILE: compressed, from standard input
  mkdir -p "$(dirname "$share/$1")"
  gzip -9n >"$share/$1.gz"
}

if [ "$package" = lumifold ]; then
  "$program" man | write man/man1/lumifold.1
  for command in $("$program" man | sed -n 's/^\.BR lumifold\\-\([a-z\\-]*\) (1)$/\1/p' | tr -d '\\'); do
    "$program" man "$command" | write "man/man1/lumifold-$command.1"
  done
  for shell in bash-completion/completions/lumifold zsh/vendor-completions/_lumifold fish/vendor_completions.d/lumifold.fish; do
    mkdir -p "$(dirname "$share/$shell")"
    name=${shell%%/*}
    "$program" completion "${name%-completion}" >"$share/$shell"
  done
  mkdir -p "$share/lumifold/blender"
  "$root/deploy/blender/package.sh" "$share/lumifold/blender" >/dev/null
elif [ "$package" != python3-lumifold ]; then
  # The first line of the help is the summary; the version is without the numeric class of this machine.
  name=$("$program" --help | sed -n 1p)
  SOURCE_DATE_EPOCH=$seconds help2man --no-info --section 8 --name "${name%%[:.]*}" --version-string "$package $version" "$program" | write "man/man8/$package.8"
fi

write "doc/$package/changelog" <"$root/CHANGELOG.md"
write "doc/$package/changelog.Debian" <<END
$package ($version-1) stable; urgency=medium

  * See changelog.gz.

 -- $contact  $(LC_ALL=C date -u -R -d "@$seconds")
END
[ "$package" = python3-lumifold ] && exit  # it is linked with nothing
"$root/deploy/packages/inventory.py" "$program" --time "$seconds" >"$share/doc/$package/$package.cdx.json"
