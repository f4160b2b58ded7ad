#!/usr/bin/env bash
# Changes the gate and the watchdogs in one place at a time, and sees that their tests notice
# (some minutes; needs pip install -c requirements.lock -r scripts/requirements-mutation.in).
#   scripts/mutants.sh [--list] [--json FILE [--again]] [NAME...]
# Results for the documentation: scripts/mutants.sh --json hydro_msgs_docs/results/mutants.json
set -euo pipefail
shopt -s inherit_errexit

case ${1:-} in -h|--help) sed -n '2,5s/^# \{0,1\}//p' "${BASH_SOURCE[0]}"; exit 0 ;; esac
# shellcheck source=scripts/env.sh
source "$(dirname "${BASH_SOURCE[0]}")/env.sh"
exec python -m hydro_ident.study.mutants --root "$hydro_root" "$@"
