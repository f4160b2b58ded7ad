#!/usr/bin/env bash
# Breaks the diagnosis on purpose, one fault at a time in a copy of the sources, and sees that the
# test named for each fault passes without it and fails with it (about 4 minutes for all).
#   scripts/sabotage.sh [--list] [--json FILE] [NAME...]
# Results for the documentation: scripts/sabotage.sh --json hydro_msgs_docs/results/sabotage.json
set -euo pipefail
shopt -s inherit_errexit

case ${1:-} in -h|--help) sed -n '2,5s/^# \{0,1\}//p' "${BASH_SOURCE[0]}"; exit 0 ;; esac
# shellcheck source=scripts/env.sh
source "$(dirname "${BASH_SOURCE[0]}")/env.sh"
exec python -m hydro_ident.study.sabotage --root "$hydro_root" "$@"
