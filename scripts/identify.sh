#!/usr/bin/env bash
# Identifies the parameters from bags; without --out into identified/YYYYMMDD-HHMMSS.
#   scripts/identify.sh BAG... [--robot ROBOT] [--validate BAG...] [--out DIR]
set -euo pipefail
shopt -s inherit_errexit

case ${1:-} in
  -h|--help) sed -n '2,3s/^# \{0,1\}//p' "${BASH_SOURCE[0]}"; exit 0 ;;
  ''|-*) printf 'identify: expected a BAG first (see --help)\n' >&2; exit 2 ;;
esac
# shellcheck source=scripts/env.sh
source "$(dirname "${BASH_SOURCE[0]}")/env.sh"
robot=(--robot xs031) out=(--out "identified/$(date +%Y%m%d-%H%M%S)")
for argument in "$@"; do
  case $argument in
    --robot|--robot=*) robot=() ;;
    --out|--out=*) out=() ;;
  esac
done
exec "$(hydro_exe hydro_ident identify)" "$@" "${robot[@]}" "${out[@]}"
