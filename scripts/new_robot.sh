#!/usr/bin/env bash
# A new machine: writes NAME.hydraulics.yaml from NAME.urdf, measured pins and datasheets, checks it and
# draws it into NAME.html. Exit 0 nothing wrong; 1 an error in the description, both files are left to be
# looked at (--force writes them anew); 2 bad usage, nothing written.
#   scripts/new_robot.sh NAME.urdf --tip LINK --valve L_MIN BAR [--valve ...] --supply BAR \
#     --cylinder JOINT PX PY CX CY BORE ROD STROKE CLOSED [--cylinder ...] \
#     [--rated-voltage V] [--rate HZ] [--pressure-range BAR] [--force] [--json F]
set -euo pipefail
shopt -s inherit_errexit

# shellcheck source=scripts/env.sh
source "$(dirname "${BASH_SOURCE[0]}")/env.sh"
description=() json=()
while (($#)); do
  case $1 in
    -h|--help)
      python -m hydro_model.new_robot --help
      printf '\n%s\n%s\n' "and of the check that follows:" \
        "  --json F              its findings as JSON; - for standard output, and nothing else there"
      exit 0 ;;
    --json)
      if (($# < 2)); then
        echo "new_robot: --json: expected a file, or - for standard output; found nothing" >&2
        exit 2
      fi
      json=(--json "$2")
      shift ;;
    --json=*) json=("$1") ;;
    *) description+=("$1") ;;
  esac
  shift
done
made=$(python -m hydro_model.new_robot "${description[@]}")
drawn=${made%.hydraulics.yaml}.html
code=0
"$(hydro_exe hydro_ident check_robot)" "$made" --out "$drawn" "${json[@]}" || code=$?
if [ "$code" -eq 1 ]; then
  echo "new_robot: $made has errors and is drawn in $drawn; once corrected, --force writes both anew" >&2
fi
exit "$code"
