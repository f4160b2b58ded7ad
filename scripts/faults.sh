#!/usr/bin/env bash
# The fault campaign: faults between machine, bridge and controller, measured at the rig's valves.
#   scripts/faults.sh [--json FILE] [--injections N] [--processes N] [--seed S]
# Results for the documentation: scripts/faults.sh --json hydro_msgs_docs/results/faults.json
# Either number may be 0: what is not run stays in FILE, and the page says which sources are new.
# It takes a ROS domain in which nobody on this computer takes part.
set -euo pipefail
shopt -s inherit_errexit

case ${1:-} in -h|--help) sed -n '2,6s/^# \{0,1\}//p' "${BASH_SOURCE[0]}"; exit 0 ;; esac
# shellcheck source=scripts/env.sh
source "$(dirname "${BASH_SOURCE[0]}")/env.sh"
exec python -m hydro_ident.study.faults --root "$hydro_root" "$@"
