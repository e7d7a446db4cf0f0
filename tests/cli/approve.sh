#!/bin/sh
# Writes down what the program says now as what it should say: tests/cli/approve.sh [BIN_DIR]. Look at the
# difference before you commit it.
set -eu
cd "$(dirname "$0")"
LUMIFOLD_BIN_DIR=$(cd "${1:-../../build/release/bin}" && pwd)
export LUMIFOLD_BIN_DIR
LUMIFOLD_APPROVE=1 PYTHONDONTWRITEBYTECODE=1 python3 -m unittest words_test completion_test job_file_test
