#!/usr/bin/env bash
# A new machine: writes NAME.hydraulics.yaml from NAME.urdf, measured pins and datasheets, checks it and
# draws it into NAME.html. Exit 0 nothing wrong; 1 an error in the description, both files are left to be
# looked at (--force writes them anew); 2 bad usage, nothing written.
#   scripts/new_robot.sh NAME.urdf --tip LINK --valve L_MIN BAR --supply BAR \
#     --cylinder JOINT PX PY CX CY BORE ROD STROKE CLOSED [--cylinder ...] [--force]
set -euo pipefail
shopt -s inherit_errexit

# shellcheck source=scripts/env.sh
source "$(dirname "${BASH_SOURCE[0]}")/env.sh"
for argument in "$@"; do
  case $argument in -h|--help) exec python -m hydro_model.new_robot --help ;; esac
done
made=$(python -m hydro_model.new_robot "$@")
drawn=${made%.hydraulics.yaml}.html
code=0
"$(hydro_exe hydro_ident check_robot)" "$made" --out "$drawn" || code=$?
if [ "$code" -eq 1 ]; then
  echo "new_robot: $made has errors and is drawn in $drawn; once corrected, --force writes both anew" >&2
fi
exit "$code"
