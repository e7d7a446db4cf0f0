#!/bin/sh
# Deletes the file that a compiler command names with -o, then runs the command.
output=
previous=
for argument in "$@"; do
  [ "$previous" = -o ] && output=$argument
  previous=$argument
done
[ -n "$output" ] && rm -f "$output"
exec "$@"
