#!/usr/bin/env bash
# The main job on the simulated rig: drive an excitation run and the paper's parallelogram with
# datasheet parameters, identify from the recorded bag, drive the parallelogram again, compare.
#   scripts/demo.sh [--out DIR] [--real-time]
# Options:
#   --out DIR      where bags, parameters and report go (default out/demo-YYYYMMDD-HHMMSS)
#   --real-time    the rig runs at 500 Hz of wall time instead of in lockstep
#   --seed N       seed of the rig's sensor noise (default 1)
# In lockstep the numbers do not depend on how busy the machine is.
set -euo pipefail
shopt -s inherit_errexit

here=$(cd "$(dirname "${BASH_SOURCE[0]}")" && pwd)
bad() { printf 'demo: %s\n' "$*" >&2; exit 2; }
out=out/demo-$(date +%Y%m%d-%H%M%S) clock=lockstep seed=1
while [[ $# -gt 0 ]]; do
  case $1 in
    --out) [[ $# -ge 2 ]] || bad "--out needs a folder"; out=$2; shift 2 ;;
    --seed) [[ $# -ge 2 ]] || bad "--seed needs a number"; seed=$2; shift 2 ;;
    --real-time) clock=real_time; shift ;;
    -h|--help) sed -n '2,9s/^# \{0,1\}//p' "${BASH_SOURCE[0]}"; exit 0 ;;
    *) bad "unknown option '$1' (see --help)" ;;
  esac
done
[[ ! -e $out/tracking.json ]] || bad "$out holds the results of an earlier demo; choose another --out"
mkdir -p "$out" || bad "cannot make the folder $out"
out=$(realpath "$out")
log_dir=$out/logs
mkdir -p "$log_dir"

# shellcheck source=scripts/env.sh
source "$here/env.sh"
# shellcheck source=scripts/processes.sh
source "$here/processes.sh"

# A domain and a port of its own, so that a demo neither hears nor disturbs another.
export ROS_DOMAIN_ID=${ROS_DOMAIN_ID:-$((BASHPID % 90 + 10))}
bus=udp_multicast:239.74.163.2:$((43200 + BASHPID % 2000))
robots=$(python -c 'from hydro_model.robot_files import shipped_robots as s; print(s()["xs031"].parent)')
parallelogram=$robots/parallelogram.yaml
gains=$(python -c 'from hydro_control.gains import shipped_gains; print(shipped_gains())')
paper_gains=$(python -c 'from hydro_control.gains import shipped_gains; print(shipped_gains("paper_table3"))')

seconds_of() {
  python -c 'import sys; from hydro_model.paths import load_path
print(f"{load_path(sys.argv[1]).duration_s + float(sys.argv[2]):.3f}")' "$1" "$2"
}

# bring_up NODE LOG TRANSITION...
bring_up() {
  local node=$1 log=$2 transition
  for transition in "${@:3}"; do
    "$lifecycle" "$transition" "/$node" || fail_with_log "$node did not $transition:" "$log"
  done
}

# drive NAME ROBOT PATH GAINS: one run of rig, bridge, recorder and controller as processes.
drive() {
  local name=$1 robot=$2 path=$3 gains=$4 began=$SECONDS duration
  duration=$(seconds_of "$path" 2.5)
  local seconds=${duration%.*}
  note "run $name: $duration s of machine time"
  start rig "$(hydro_exe hydro_hw_bridge sim_rig)" --robot xs031 --truth realistic --can "$bus" \
    "--${clock/_/-}" --seed "$seed" --tip 2.0 0.0 -1.2 --duration "$duration" \
    --truth-out "$out/truth/$name.npz"
  start bridge "$(hydro_exe hydro_hw_bridge can_bridge)" --ros-args -p robot:=xs031 \
    -p "can:=$bus" -p "clock:=$clock" \
    -p "required_subscribers:=/joint_states:2 /chamber_pressures:2 /valve_state:1"
  start recorder "$(hydro_exe hydro_ident recorder)" --out "$out/bags" --name "$name" \
    --robot xs031 --attach "controller=$gains"
  start controller "$(hydro_exe hydro_control controller)" --ros-args --params-file "$gains" \
    -p "robot:=$robot" -p "path:=$path" -p required_recorders:=1
  wait_for rig ready
  wait_for recorder recording
  bring_up can_bridge bridge configure activate
  bring_up controller controller configure activate
  wait_end rig $((seconds * 6 + 60))
  stop controller bridge recorder
  for process in rig bridge recorder controller; do
    mv "$log_dir/$process.log" "$log_dir/$name.$process.log"
  done
  process_order=()
  note "run $name: done in $((SECONDS - began)) s"
}

bag_of() { printf '%s\n' "$out"/bags/*_"$1"; }

lifecycle=$(hydro_exe hydro_control lifecycle)
mkdir -p "$out/bags" "$out/truth"
hydro() { "$(hydro_exe hydro_ident "$1")" "${@:2}"; }

hydro excite --robot xs031 --out "$out/experiment" --start-tip 2.0 0.0 -1.2
drive excitation xs031 "$out/experiment/excitation.yaml" "$gains"
drive validation xs031 "$out/experiment/validation.yaml" "$gains"
hydro identify "$(bag_of excitation)" --robot xs031 --validate "$(bag_of validation)" \
  --out "$out/identified"

# As in the paper's Table IV, the nominal rows use the identified viscous friction.
hydro nominal --robot xs031 --friction-from "$out/identified/model.yaml" \
  --out "$out/nominal_35bar/model.yaml"
hydro nominal --robot xs031 --friction-from "$out/identified/model.yaml" \
  --edge-coefficient 6.30e-7 --out "$out/nominal_70bar/model.yaml"

for row in nominal_70bar nominal_35bar identified; do
  drive "$row" "$out/$row/model.yaml" "$parallelogram" "$gains"
done
drive paper_gains "$out/identified/model.yaml" "$parallelogram" "$paper_gains"

rows=()
for row in nominal_70bar nominal_35bar identified paper_gains; do
  rows+=("$row=$(bag_of "$row"),$out/truth/$row.npz")
done
hydro compare_tracking "${rows[@]}" --robot xs031 --json "$out/tracking.json"
cat <<TEXT
bags         $out/bags
parameters   $out/identified/result.json, model.yaml, controller.yaml
report       $out/identified/report.html
tracking     $out/tracking.json
TEXT
