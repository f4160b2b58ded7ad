#!/usr/bin/env bash
# One run on the simulated rig: rig, bridge, recorder and controller as processes, until the path
# is played; leaves a bag and the rig's true states. Exit code 1 where the path was not driven to its end.
#   scripts/rig_run.sh --name NAME --path PATH --out DIR [options]
# Writes DIR/bags/*_NAME, DIR/truth/NAME.npz and DIR/logs/NAME.*.log.
# Options:
#   --rig ROBOT        the machine, and what the bridge takes it for (default xs031)
#   --mapping FILE, --dbc FILE      its I/O (default: those shipped for it, or made by new_bus)
#   --robot ROBOT      the controller's robot file (default: the machine's)
#   --controller FILE  ROS parameters of the controller: gains (default: the package's gains.yaml)
#   --truth TRUTH      what the rig really is (default realistic; of another robot than xs031 ideal)
#   --tip "X Y Z", --joints "Q ..."    where its tip starts (xs031: "2.0 0.0 -1.2"), or its joints
#   --seed N           of the rig's sensor noise (default 1)
#   --real-time        500 Hz of wall time instead of lockstep
#   --duration S       end after this machine time (default: the path, and 2.5 s)
#   --bus BUS          (default: a multicast port of its own)
set -euo pipefail
shopt -s inherit_errexit

here=$(CDPATH='' cd -- "$(dirname "${BASH_SOURCE[0]}")" && pwd)
bad() { printf 'rig_run: %s\n' "$*" >&2; exit 2; }
name= path= out= rig=xs031 robot= controller= truth= tip= joints= mapping= dbc= seed=1
clock=lockstep duration= bus=udp_multicast:239.74.163.2:$((43200 + BASHPID % 2000))
while [[ $# -gt 0 ]]; do
  case $1 in
    --real-time) clock=real_time; shift ;;
    -h|--help) sed -n '2,17s/^# \{0,1\}//p' "${BASH_SOURCE[0]}"; exit 0 ;;
    --name|--path|--out|--rig|--robot|--controller|--truth|--tip|--joints|--mapping|--dbc|--seed|\
    --duration|--bus)
      [[ $# -ge 2 ]] || bad "$1 needs a value"
      printf -v "${1#--}" '%s' "$2"; shift 2 ;;
    *) bad "unknown option '$1' (see --help)" ;;
  esac
done
for needed in name path out; do [[ -n ${!needed} ]] || bad "expected --$needed (see --help)"; done
if [[ -n $duration && ! $duration =~ ^([0-9]+([.][0-9]*)?|[.][0-9]+)$ ]]; then
  bad "--duration: expected seconds such as 12.5, found '$duration'"
fi
[[ -z $tip || -z $joints ]] || bad "--tip and --joints exclude each other"
for given in mapping dbc; do
  [[ -z ${!given} || -f ${!given} ]] || bad "--$given: expected a file, found none at '${!given}'"
done
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
if [[ $rig == xs031 ]]; then
  [[ -n $joints ]] || tip=${tip:-2.0 0.0 -1.2}
  truth=${truth:-realistic}
fi
robot=${robot:-$rig}
# What is shipped is found by the robot's name; for another one a bus is made.
if [[ -z $mapping ]]; then mapping=$(default_mapping "$rig"); fi
if [[ -z $mapping ]]; then
  # Other robots' runs may have left theirs there.
  made=$("$(hydro_exe hydro_hw_bridge new_bus)" --robot "$rig" --out "$out/bus" --force)
  note "$made"
  mapping=$(grep '\.mapping\.yaml$' <<<"$made")
fi
io=(--mapping "$mapping" ${dbc:+--dbc "$dbc"})
pose=()
if [[ -n $tip ]]; then
  read -ra pose <<<"$tip"
  pose=(--tip "${pose[@]}")
elif [[ -n $joints ]]; then
  read -ra pose <<<"$joints"
  pose=(--joints "${pose[@]}")
fi
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
start "$name.rig" "$(hydro_exe hydro_hw_bridge sim_rig)" --robot "$rig" --truth "${truth:-ideal}" \
  "${io[@]}" --can "$bus" "--${clock/_/-}" --seed "$seed" "${pose[@]}" --duration "$duration" \
  --truth-out "$out/truth/$name.npz"
wait_for "$name.rig" ready
start "$name.bridge" "$(hydro_exe hydro_hw_bridge can_bridge)" --ros-args \
  -p "$(parameter robot "$rig")" -p "$(parameter mapping "$mapping")" \
  ${dbc:+-p "$(parameter dbc "$dbc")"} -p "$(parameter can "$bus")" -p "clock:=$clock" \
  "${deep_history[@]}" \
  -p "required_subscribers:=/joint_states:2 /chamber_pressures:2 /valve_state:2"
start "$name.recorder" "$(hydro_exe hydro_ident recorder)" --out "$out/bags" --name "$name" \
  --robot "$robot" --attach "controller_parameters=$gains" --attach "mapping=$mapping"
start "$name.controller" "$(hydro_exe hydro_control controller)" --ros-args \
  --params-file "$gains" -p "$(parameter robot "$robot")" -p "$(parameter path "$path")" \
  -p required_recorders:=1 \
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
sleep 0.3 # the controller says what it has to say within 0.1 s
stop "$name.controller" "$name.bridge" "$name.recorder"
# In real time the gate also trips behind the rig that has ended: what counts is how that saw its end.
at_end=off
if [[ $clock == real_time ]]; then at_end=$(valves_at_end "$out/truth/$name.npz"); fi
# What was recorded from then on is no run of this path.
if [[ $at_end == off ]] && why=$(grep -om1 'tripped: .*' "$log_dir/$name.bridge.log"); then
  fail_with_log "run $name is cut short, the gate $why (log $log_dir/$name.bridge.log)" "$name.bridge"
fi
if why=$(grep -oEm1 "\[controller\]: $undriven.*" "$log_dir/$name.controller.log"); then
  why="${why#*: } (log $log_dir/$name.controller.log)"
  fail_with_log "run $name did not drive its path, the controller says $why" "$name.controller"
fi
note "run $name: $duration s of machine time in $((SECONDS - began)) s"
