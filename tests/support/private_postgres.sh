#!/usr/bin/env bash
# Runs a PostgreSQL server for one test, on a Unix socket in a folder of its own, as user postgres where this
# is root. With an address as its argument it also listens there, for clients of that network. Prints the URI
# of an empty database, whose password is "secret/word". Then obeys the lines "stop" (as by a power cut) and
# "start" on standard input, and answers each with "done". At the end of its input it removes everything. Ends
# with 77 where PostgreSQL is not installed.
set -euo pipefail

for bin in $(ls -d /usr/lib/postgresql/*/bin 2>/dev/null | sort -rV) "$(dirname "$(command -v initdb || echo /none/initdb)")"; do
  [ -x "$bin/initdb" ] && break
done
[ -x "$bin/initdb" ] || { echo "private_postgres: PostgreSQL is not installed (deploy/setup.sh --tests)" >&2; exit 77; }

listen=${1:-}
as=()
folder=$(mktemp -d "${TMPDIR:-/tmp}/lumifold_postgres_XXXXXX")
if [ "$(id -u)" = 0 ]; then
  as=(setpriv --reuid=postgres --regid=postgres --clear-groups)
  chown postgres:postgres "$folder"
fi
postgres() { "${as[@]}" env HOME="$folder" LC_ALL=C.UTF-8 "$@"; }
server() { postgres "$bin/pg_ctl" -D "$folder/data" -m immediate "$@" >>"$folder.log" 2>&1 </dev/null; }
start() {
  # Nothing here survives the test, so nothing is synced.
  server -w -t 120 -l "$folder/log" -o "-c listen_addresses='$listen' -c unix_socket_directories=$folder -c fsync=off" start
}
finish() {
  server stop || true
  rm -rf "$folder" "$folder.log"
}
trap finish EXIT

password='secret/word'
postgres bash -c "printf '%s' '$password' >'$folder/password'"
postgres "$bin/initdb" -D "$folder/data" -U lumifold -A scram-sha-256 --pwfile="$folder/password" -E UTF8 --no-sync \
  >>"$folder.log" 2>&1 </dev/null
if [ -n "$listen" ]; then
  postgres bash -c "echo 'host all all $listen/24 scram-sha-256' >>'$folder/data/pg_hba.conf'"
fi
start
PGPASSWORD=$password postgres "$bin/createdb" -h "$folder" -U lumifold farm </dev/null
echo "postgresql://lumifold:secret%2Fword@/farm?host=${listen:-$folder}"
while read -r line; do
  case "$line" in
    stop) server stop ;;
    start) start ;;
  esac
  echo "done"
done
