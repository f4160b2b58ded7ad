#!/usr/bin/env bash
# The fault campaign: faults between machine, bridge and controller, measured at the rig's valves.
#   scripts/faults.sh [--json FILE] [--injections N] [--processes N] [--seed S]
# Results for the documentation: scripts/faults.sh --json hydro_msgs_docs/results/faults.json
# ROS_DOMAIN_ID should be one of its own: it clears trips and publishes commands.
set -euo pipefail
shopt -s inherit_errexit

case ${1:-} in -h|--help) sed -n '2,5s/^# \{0,1\}//p' "${BASH_SOURCE[0]}"; exit 0 ;; esac
# shellcheck source=scripts/env.sh
source "$(dirname "${BASH_SOURCE[0]}")/env.sh"
exec python -m hydro_ident.study.faults "$@"
