#!/usr/bin/env bash
# The main job on the simulated rig: drive an excitation run and the paper's parallelogram with
# datasheet parameters, identify from the recorded bag, drive the parallelogram again, diagnose what
# the model leaves out, drive it once more with that in the controller, compare.
#   scripts/demo.sh [--out DIR] [--real-time]
# Options:
#   --out DIR      where bags, parameters and report go (default out/demo-YYYYMMDD-HHMMSS)
#   --real-time    the rig runs at 500 Hz of wall time instead of in lockstep
#   --seed N       seed of the rig's sensor noise (default 1)
# In lockstep the numbers do not depend on how busy the machine is.
set -euo pipefail
shopt -s inherit_errexit

here=$(CDPATH='' cd -- "$(dirname "${BASH_SOURCE[0]}")" && pwd)
bad() { printf 'demo: %s\n' "$*" >&2; exit 2; }
out=out/demo-$(date +%Y%m%d-%H%M%S) clock= seed=1
while [[ $# -gt 0 ]]; do
  case $1 in
    --out) [[ $# -ge 2 ]] || bad "--out needs a folder"; out=$2; shift 2 ;;
    --seed) [[ $# -ge 2 ]] || bad "--seed needs a number"; seed=$2; shift 2 ;;
    --real-time) clock=--real-time; shift ;;
    -h|--help) sed -n '2,10s/^# \{0,1\}//p' "${BASH_SOURCE[0]}"; exit 0 ;;
    *) bad "unknown option '$1' (see --help)" ;;
  esac
done
[[ ! -e $out/tracking.json ]] || bad "$out holds the results of an earlier demo; choose another --out"
# Bags are found by their names: a second one of a name would be taken with the first.
for begun in experiment bags truth logs identified nominal_35bar nominal_70bar discovered; do
  [[ ! -e $out/$begun ]] || bad "$out holds the beginning of an earlier demo ($begun), which cannot" \
    "be gone on with: remove the folder or choose another --out"
done
mkdir -p "$out" || bad "cannot make the folder $out"
out=$(realpath "$out")

# shellcheck source=scripts/env.sh
source "$here/env.sh"
# shellcheck source=scripts/files.sh
source "$here/files.sh"
# shellcheck source=scripts/parent.sh
source "$here/parent.sh"
parallelogram=xs031/parallelogram
paper_gains=$(shipped_gains paper_table3)

# drive NAME ROBOT PATH [option]: one run of rig, bridge, recorder and controller as processes.
drive() {
  "${with_parent[@]}" "$here/rig_run.sh" --name "$1" --robot "$2" --path "$3" --out "$out" --seed "$seed" \
    ${clock:+"$clock"} "${@:4}"
}

bag_of() { printf '%s\n' "$out"/bags/*_"$1"; }

hydro() { "${with_parent[@]}" "$(hydro_exe hydro_ident "$1")" "${@:2}"; }

hydro excite --robot xs031 --out "$out/experiment" --start-tip 2.0 0.0 -1.2
drive excitation xs031 "$out/experiment/excitation.yaml"
drive validation xs031 "$out/experiment/validation.yaml"
hydro identify "$(bag_of excitation)" --robot xs031 --validate "$(bag_of validation)" \
  --out "$out/identified"

# As in the paper's Table IV, the nominal rows use the identified viscous friction.
hydro nominal --robot xs031 --friction-from "$out/identified/model.yaml" \
  --out "$out/nominal_35bar/model.yaml"
hydro nominal --robot xs031 --friction-from "$out/identified/model.yaml" \
  --edge-coefficient 6.30e-7 --out "$out/nominal_70bar/model.yaml"

rows=()
for row in nominal_70bar nominal_35bar identified; do
  drive "$row" "$out/$row/model.yaml" "$parallelogram"
  rows+=("$row=$(bag_of "$row"),$out/truth/$row.npz")
done
drive paper_gains "$out/identified/model.yaml" "$parallelogram" --controller "$paper_gains"

# From the same bags: what the datasheet's structure leaves out, named, sized and verified.
hydro diagnose "$(bag_of excitation)" --robot xs031 --validate "$(bag_of validation)" \
  --out "$out/discovered"
drive discovered "$out/discovered/model.yaml" "$parallelogram" \
  --controller "$out/discovered/controller.yaml"
rows+=("discovered=$(bag_of discovered),$out/truth/discovered.npz")

code=0
printf '\nthe paper'"'"'s Table III with filter weight 0.04, on the identified model, apart from the table:\n'
hydro tracking "$(bag_of paper_gains)" --truth "$out/truth/paper_gains.npz" --robot xs031 \
  --json "$out/tracking_paper_gains.json"
printf '\n'
hydro compare_tracking "${rows[@]}" --robot xs031 --against identified \
  --json "$out/tracking.json" || code=$?
cat <<TEXT

bags         $out/bags
parameters   $out/identified/result.json, model.yaml, controller.yaml
report       $out/identified/report.html
discovered   $out/discovered/result.json, model.yaml, controller.yaml, report.html
tracking     $out/tracking.json
TEXT
exit "$code"
