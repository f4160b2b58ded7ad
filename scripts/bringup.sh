#!/usr/bin/env bash
# Brings the crane up: bridge and controller, until Ctrl-C, which ends with the valves at zero.
#   scripts/bringup.sh --can can0 --robot xs031             read and publish only (bridge inactive)
#   scripts/bringup.sh --can can0 --robot xs031 --calibration FILE --drive     drive the valves
#   scripts/bringup.sh --sim [--drive]                      the simulated rig instead of a machine: the
#                      reference crane, or a robot of another name exactly as its file says
#   scripts/bringup.sh --sim --rig FILE --robot model.yaml  a model that was identified, on the simulated
#                      machine that FILE describes: such a model is none that a rig could be
# Options:
#   --robot ROBOT      shipped name, *.hydraulics.yaml or model.yaml (default xs031)
#   --controller FILE  ROS parameters of the controller (gains; default: the package's gains.yaml)
#   --bridge FILE      ROS parameters of the bridge (limits of its gate; default: its own)
#   --path FILE        path that the controller plays once it drives
#   --mapping FILE, --dbc FILE      the lab's own I/O (default: those of the robot)
#   --calibration FILE what `calibrate` wrote: no model file carries it
#   --no-calibration   drive on --can with the mapping's own zeros, offsets and signs
#   --record NAME      record a bag into ./bags
#   --bus BUS          bus of --sim (default udp_multicast:239.74.163.2:43113)
# It starts only where no other one is up in its ROS domain: ROS_DOMAIN_ID tells machines apart. --sim takes
# an unused domain where none is set, and says which.
set -euo pipefail
shopt -s inherit_errexit

here=$(CDPATH='' cd -- "$(dirname "${BASH_SOURCE[0]}")" && pwd)
usage() { sed -n '2,21s/^# \{0,1\}//p' "${BASH_SOURCE[0]}"; }
bad() { printf 'bringup: %s\n' "$*" >&2; exit 2; }

can= robot=xs031 rig= controller= bridge= path= mapping= dbc= calibration= record= sim=false drive=false uncalibrated=false
bus=udp_multicast:239.74.163.2:43113
while [[ $# -gt 0 ]]; do
  case $1 in
    --sim) sim=true; shift ;;
    --drive) drive=true; shift ;;
    --no-calibration) uncalibrated=true; shift ;;
    -h|--help) usage; exit 0 ;;
    --can|--robot|--rig|--controller|--bridge|--path|--mapping|--dbc|--calibration|--record|--bus)
      [[ $# -ge 2 ]] || bad "$1 needs a value"
      printf -v "${1#--}" '%s' "$2"; shift 2 ;;
    *) bad "unknown option '$1' (see --help)" ;;
  esac
done
if $sim && [[ -n $can ]]; then bad "--sim and --can exclude each other"; fi
if ! $sim && [[ -z $can ]]; then bad "expected --can INTERFACE or --sim (see --help)"; fi
if ! $sim && [[ -n $rig ]]; then bad "--rig is what --sim simulates: with --can there is a machine"; fi
if $uncalibrated && [[ -n $calibration ]]; then
  bad "--no-calibration and --calibration exclude each other"
fi
if $drive && ! $sim && ! $uncalibrated && [[ -z $calibration ]]; then
  bad "--drive on $can needs --calibration FILE (what calibrate wrote: zeros, offsets and valve" \
    "signs; a model file has none); --no-calibration drives without"
fi
for name in rig controller bridge calibration mapping dbc; do
  [[ -z ${!name} || -f ${!name} ]] || bad "--$name: expected a file, found none at '${!name}'"
done
if $sim; then can=$bus; fi

# shellcheck source=scripts/env.sh
source "$here/env.sh"
# shellcheck source=scripts/files.sh
source "$here/files.sh"
# shellcheck source=scripts/processes.sh
source "$here/processes.sh"

[[ -z $bridge ]] || check_parameters hydro_hw_bridge "$bridge" robot can clock mapping dbc calibration
[[ -z $controller ]] || check_parameters hydro_control "$controller" robot ${path:+path}
parameters=(${bridge:+--params-file "$(realpath "$bridge")"})
parameters+=(-p "$(parameter robot "$robot")" -p "$(parameter can "$can")" -p clock:=real_time)
for name in mapping dbc calibration; do
  [[ -z ${!name} ]] || parameters+=(-p "$(parameter "$name" "$(realpath "${!name}")")")
done
gains=${controller:-$(shipped_gains)}
control=(--ros-args --params-file "$(realpath "$gains")" -p "$(parameter robot "$robot")")
# A path that is no file may be a shipped one: the controller knows them.
if [[ -f $path ]]; then path=$(realpath "$path"); fi
[[ -z $path ]] || control+=(-p "$(parameter path "$path")")

if $sim && [[ -z ${ROS_DOMAIN_ID:-} ]]; then
  # A rehearsal must neither hear nor disturb a machine.
  ROS_DOMAIN_ID=$(unused_domain $((BASHPID % 90 + 10)))
  export ROS_DOMAIN_ID
  note "in a ROS domain of its own: first of all in other terminals, export ROS_DOMAIN_ID=$ROS_DOMAIN_ID"
fi
# What is asked of one is asked of all of that name in the domain.
absent can_bridge controller

if $sim; then
  # Whatever model of the reference crane is driven, the rig is that crane as it truly is; of any other robot
  # nothing is known but its file. It speaks the bus that the bridge is told of.
  name=$(robot_name "${rig:-$robot}")
  device=(--robot xs031)
  if [[ $name != xs031 ]]; then device=(--robot "${rig:-$robot}" --truth ideal); fi
  for name in mapping dbc; do
    [[ -z ${!name} ]] || device+=("--$name" "${!name}")
  done
  start rig "$(hydro_exe hydro_hw_bridge sim_rig)" "${device[@]}" --can "$can" --real-time
  wait_for rig ready
fi
start bridge "$(hydro_exe hydro_hw_bridge can_bridge)" --ros-args "${parameters[@]}"
start controller "$(hydro_exe hydro_control controller)" "${control[@]}"

# What both say of themselves, from their logs: whether it drives its gate alone knows, and the controller
# alone whether that is what it was asked for.
follow bridge
follow controller
state='' latched=''
say_driving() {
  note "driving $robot on $can; Ctrl-C stops with the valves at zero"
  [[ -z $latched ]] || note "  NOT moved, unless the controller was activated anew since: $latched"
}
# look_at_bridge: take what it has said since the last look, and tell what changes for who stands by.
look_at_bridge() {
  local line
  while hear bridge can_bridge; do
    case $line in
      driving)
        [[ $state == driving ]] || say_driving
        state=driving ;;
      tripped:*)
        note "NOT driving $robot, valves at zero: the gate $line"
        note "  once its cause is gone: $lifecycle clear_trip /can_bridge"
        state=tripped ;;
      inactive:* | waiting* | 'nothing from the device'*)
        [[ $state != driving ]] || note "NOT driving $robot any more: the bridge is $line"
        # A gate that drove and waits for a command again: the controller was deactivated.
        [[ $state != driving || $line != 'waiting for a first command' ]] || latched=
        state=$line ;;
    esac
  done
}
# look_at_controller: as look_at_bridge. Of a gate that drives 0 V the bridge has nothing to say.
look_at_controller() {
  local line
  while hear controller controller; do
    [[ $line =~ ^$undriven ]] || continue
    if [[ $line == *activate*anew* ]]; then
      latched=$line
      note "NOT moving $robot, valves at zero: the controller says $line"
      note "  once its cause is gone: $lifecycle deactivate /controller, then $lifecycle activate /controller"
    else
      note "NOT moving $robot as asked: the controller says $line"
    fi
  done
}

transition can_bridge bridge configure
transition controller controller configure
if [[ -n $record ]]; then
  attached=(--attach "controller_parameters=$(realpath "$gains")")
  [[ -z $bridge ]] || attached+=(--attach "bridge_parameters=$(realpath "$bridge")")
  mapping=${mapping:-$(default_mapping "$robot")}
  [[ -z $mapping ]] || attached+=(--attach "mapping=$(realpath "$mapping")")
  [[ -z $dbc ]] || attached+=(--attach "dbc=$(realpath "$dbc")")
  [[ -z $calibration ]] || attached+=(--attach "calibration=$(realpath "$calibration")")
  start recorder "$(hydro_exe hydro_ident recorder)" --out bags --name "$record" \
    --robot "$robot" "${attached[@]}"
  wait_for recorder recording
fi
if $drive; then
  # The controller's path starts with its first sample: the bridge must be driving by then.
  transition can_bridge bridge activate
  transition controller controller activate
  # An active node is no valve that is driven: the gate may have tripped before its first command.
  for ((i = 0; i < 100; i++)); do
    look_at_bridge
    [[ $state != driving && $state != tripped ]] || break
    if ! running bridge || ! running controller; then break; fi
    sleep 0.1
  done
  [[ $state == driving || $state == tripped ]] ||
    note "NOT driving $robot yet: the bridge is ${state:-silent}"
  note "Ctrl-C ends (logs in $log_dir)"
else
  note "reading $robot on $can, valves not driven (--drive drives); Ctrl-C ends (logs in $log_dir)"
fi

recording=$record
while running bridge && running controller; do
  look_at_bridge
  look_at_controller
  if [[ -n $recording ]] && ! running recorder; then
    recording=
    note "NOT RECORDING any more, and going on: recorder: $(last_line recorder)"
  fi
  sleep 0.2
done
for name in bridge controller; do
  running "$name" || { note "$name ended:"; ended "$name"; }
done
