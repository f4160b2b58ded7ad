#!/usr/bin/env bash
# Measures speed against what a user would take instead, a floor or a limit, and prints ratios.
#   scripts/bench.sh [--json F] [--rounds N] [--only GROUP...] [--growth MINUTES MINUTES...]
# Results for the documentation: scripts/bench.sh --json hydro_msgs_docs/results/bench.json
#   scripts/bench.sh --publish hydro_msgs_docs
set -euo pipefail
shopt -s inherit_errexit

case ${1:-} in -h|--help) sed -n '2,5s/^# \{0,1\}//p' "${BASH_SOURCE[0]}"; exit 0 ;; esac
# shellcheck source=scripts/env.sh
source "$(dirname "${BASH_SOURCE[0]}")/env.sh"
exec python -m hydro_ident.bench --root "$hydro_root" "$@"
