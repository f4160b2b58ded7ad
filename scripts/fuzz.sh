#!/usr/bin/env bash
# Fuzzes every loader (bags, robots, URDF, DBC, mappings, CSV logs) from the corpus in tests/corpus.
#   scripts/fuzz.sh [--minutes M] [--json FILE] [--first-run N] [--keep DIR]
# Results for the documentation: scripts/fuzz.sh --minutes 4 --json hydro_msgs_docs/results/fuzz.json
# With --minutes 0 that file only says anew which sources have changed since its run.
set -euo pipefail
shopt -s inherit_errexit

case ${1:-} in -h|--help) sed -n '2,5s/^# \{0,1\}//p' "${BASH_SOURCE[0]}"; exit 0 ;; esac
# shellcheck source=scripts/env.sh
source "$(dirname "${BASH_SOURCE[0]}")/env.sh"
exec python -m hydro_ident.study.fuzz --corpus "$hydro_root/tests/corpus" "$@"
