#!/usr/bin/env bash
# Runs rig, bridge and controller in real time and prints a histogram of the times from sensor frame
# to valve frame, the cycles that were lost, the gate's trips (each cleared), and how the memory of
# every process grew.
#   scripts/soak.sh [--minutes 10] [--json F]
set -euo pipefail
shopt -s inherit_errexit

case ${1:-} in -h|--help) sed -n '2,5s/^# \{0,1\}//p' "${BASH_SOURCE[0]}"; exit 0 ;; esac
# shellcheck source=scripts/env.sh
source "$(dirname "${BASH_SOURCE[0]}")/env.sh"
exec python -m hydro_ident.bench.soak "$@"
