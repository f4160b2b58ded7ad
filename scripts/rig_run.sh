#!/usr/bin/env bash
# One run on the simulated rig: rig, bridge, recorder and controller as processes, until the path
# is played; leaves a bag and the rig's true states.
#   scripts/rig_run.sh --name NAME --path PATH --out DIR [options]
# Writes DIR/bags/*_NAME, DIR/truth/NAME.npz and DIR/logs/NAME.*.log.
# Options:
#   --robot ROBOT      the controller's robot file (default xs031)
#   --controller FILE  ROS parameters of the controller: gains (default: the package's gains.yaml)
#   --truth TRUTH      what the rig really is (default realistic)
#   --tip "X Y Z"      where its tip starts (default "2.0 0.0 -1.2")
#   --seed N           of the rig's sensor noise (default 1)
#   --real-time        500 Hz of wall time instead of lockstep
#   --duration S       end after this machine time (default: the path, and 2.5 s)
#   --bus BUS          (default: a multicast port of its own)
set -euo pipefail
shopt -s inherit_errexit

here=$(CDPATH='' cd -- "$(dirname "${BASH_SOURCE[0]}")" && pwd)
bad() { printf 'rig_run: %s\n' "$*" >&2; exit 2; }
name= path= out= robot=xs031 controller= truth=realistic tip='2.0 0.0 -1.2' seed=1
clock=lockstep duration= bus=udp_multicast:239.74.163.2:$((43200 + BASHPID % 2000))
while [[ $# -gt 0 ]]; do
  case $1 in
    --real-time) clock=real_time; shift ;;
    -h|--help) sed -n '2,15s/^# \{0,1\}//p' "${BASH_SOURCE[0]}"; exit 0 ;;
    --name|--path|--out|--robot|--controller|--truth|--tip|--seed|--duration|--bus)
      [[ $# -ge 2 ]] || bad "$1 needs a value"
      printf -v "${1#--}" '%s' "$2"; shift 2 ;;
    *) bad "unknown option '$1' (see --help)" ;;
  esac
done
for needed in name path out; do [[ -n ${!needed} ]] || bad "expected --$needed (see --help)"; done
if [[ -n $duration && ! $duration =~ ^([0-9]+([.][0-9]*)?|[.][0-9]+)$ ]]; then
  bad "--duration: expected seconds such as 12.5, found '$duration'"
fi
mkdir -p "$out/logs" "$out/truth" "$out/bags" || bad "cannot make folders in $out"
out=$(realpath "$out")

# shellcheck source=scripts/env.sh
source "$here/env.sh"
# shellcheck source=scripts/files.sh
source "$here/files.sh"
# shellcheck source=scripts/processes.sh
log_dir=$out/logs
source "$here/processes.sh"

# A domain of its own whatever the shell says: a run must neither hear nor disturb a machine, nor
# another run on this computer.
ROS_DOMAIN_ID=$(unused_domain $((BASHPID % 90 + 10)))
export ROS_DOMAIN_ID
mapping=$(default_mapping xs031)
gains=$(realpath "${controller:-$(shipped_gains)}")
planned=$(path_seconds "$path" 2.5)
duration=${duration:-$planned}

# In lockstep cycles come as fast as they can; the recorder may be behind by more than ten of them.
deep_history=()
for topic in joint_states chamber_pressures valve_state valve_command joint_reference tip_reference
do
  deep_history+=(-p "qos_overrides./$topic.publisher.depth:=1000")
done
began=$SECONDS
read -ra tip <<<"$tip"
start "$name.rig" "$(hydro_exe hydro_hw_bridge sim_rig)" --robot xs031 --truth "$truth" \
  --can "$bus" "--${clock/_/-}" --seed "$seed" --tip "${tip[@]}" --duration "$duration" \
  --truth-out "$out/truth/$name.npz"
wait_for "$name.rig" ready
start "$name.bridge" "$(hydro_exe hydro_hw_bridge can_bridge)" --ros-args -p robot:=xs031 \
  -p "can:=$bus" -p "clock:=$clock" "${deep_history[@]}" \
  -p "required_subscribers:=/joint_states:2 /chamber_pressures:2 /valve_state:2"
start "$name.recorder" "$(hydro_exe hydro_ident recorder)" --out "$out/bags" --name "$name" \
  --robot "$robot" --attach "controller_parameters=$gains" --attach "mapping=$mapping"
start "$name.controller" "$(hydro_exe hydro_control controller)" --ros-args \
  --params-file "$gains" -p "robot:=$robot" -p "path:=$path" -p required_recorders:=1 \
  "${deep_history[@]}"
transition can_bridge "$name.bridge" configure
transition controller "$name.controller" configure
wait_for "$name.recorder" "receiving /joint_states"
wait_for "$name.recorder" "receiving /chamber_pressures"
if [[ $clock == lockstep ]]; then
  # The machine stands still until the bridge drives, so nothing of the run is missed.
  transition controller "$name.controller" activate
  wait_for "$name.recorder" "receiving /tip_reference"
  transition can_bridge "$name.bridge" activate
else
  # The controller's path starts with its first sample: the bridge must be driving by then.
  transition can_bridge "$name.bridge" activate
  transition controller "$name.controller" activate
fi
whole=${duration%.*} # nothing in front of the point of .5; 08 is eight
wait_end "$name.rig" $((10#${whole:-0} * 10 + 60)) || fail_with_log "the rig failed:" "$name.rig"
running "$name.recorder" || ended "$name.recorder"
stop "$name.controller" "$name.bridge" "$name.recorder"
# From then on the valves had 0 V: what was recorded is no run of this path. (In real time the gate
# also trips behind the rig that has ended.)
if [[ $clock == lockstep ]] && why=$(grep -om1 'tripped: .*' "$log_dir/$name.bridge.log"); then
  fail_with_log "run $name is cut short, the gate $why" "$name.bridge"
fi
note "run $name: $duration s of machine time in $((SECONDS - began)) s"
