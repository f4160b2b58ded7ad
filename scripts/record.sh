#!/usr/bin/env bash
# Records the contract's topics into bags/YYYYMMDD-HHMMSS_NAME until Ctrl-C.
#   scripts/record.sh NAME [--out DIR] [--robot ROBOT] [--note TEXT] [other recorder options]
set -euo pipefail
shopt -s inherit_errexit

case ${1:-} in
  -h|--help) sed -n '2,3s/^# \{0,1\}//p' "${BASH_SOURCE[0]}"; exit 0 ;;
  ''|-*) printf 'record: expected a NAME first (see --help)\n' >&2; exit 2 ;;
esac
name=$1
shift
# shellcheck source=scripts/env.sh
source "$(dirname "${BASH_SOURCE[0]}")/env.sh"
# shellcheck source=scripts/files.sh
source "$(dirname "${BASH_SOURCE[0]}")/files.sh"
out=(--out bags) mapping=$(default_mapping xs031)
for argument in "$@"; do
  [[ $argument != --out* ]] || out=()
  # Another robot has another bus; whoever names one attaches its mapping.
  [[ $argument != --robot* && $argument != mapping=* ]] || mapping=
done
exec "$(hydro_exe hydro_ident recorder)" --name "$name" "${out[@]}" \
  ${mapping:+--attach "mapping=$mapping"} "$@"
