# Sourced: child processes of a script, started with a log each and taken down in order.
# shellcheck shell=bash
#
#   start NAME COMMAND ...     in a session of its own, output to $log_dir/NAME.log; gets SIGTERM should
#                              the script be killed, where util-linux's setpriv can see to it
#   transition NODE NAME WHAT  lifecycle transition of NODE, the process NAME; ends with its error
#   wait_for NAME TEXT [S]     until NAME's log shows TEXT, at most S seconds (120)
#   parameter NAME VALUE       a ROS parameter as `-p` takes it, whatever is in its value
#   absent NODE ...            ends with what is there where a node of one of these names is
#   unused_domain FROM         the first ROS domain from FROM on that nobody here takes part in
#   follow NAME                hear NAME's log from its first line on
#   hear NAME NODE             the next that NODE has said there, into $line; 1 where there is none yet
#   stop NAME ...              SIGTERM, then SIGKILL after 10 s; waits; 0 V comes first where
#                              the caller names the controller and the bridge first
# Children have sessions of their own, so that a terminal's Ctrl-C reaches the script alone and the
# order is the script's.

declare -A process_of=()
process_order=()
lifecycle=$(hydro_exe hydro_control lifecycle)
log_dir=${log_dir:-$(mktemp -d -t hydro-logs.XXXXXX)}

# Of a script that is killed the children end with 0 V.
# shellcheck source=scripts/parent.sh
source "$(CDPATH='' cd -- "$(dirname "${BASH_SOURCE[0]}")" && pwd)/parent.sh"

note() { printf '%s\n' "$*" >&2; }

# rcl reads the value as YAML, where ` #`, `: ` and numbers are something else: it is quoted.
parameter() {
  local quote=\'
  printf '%s\n' "$1:=$quote${2//$quote/$quote$quote}$quote"
}

start() {
  local name=$1
  shift
  # There at once, for who reads what it says.
  : >"$log_dir/$name.log"
  (trap - EXIT INT TERM HUP && exec setsid "${with_parent[@]}" "$@") >"$log_dir/$name.log" 2>&1 </dev/null &
  process_of[$name]=$!
  process_order+=("$name")
}

# Of 10 to 99, FROM among them. Who takes part in a domain listens on some of the 250 UDP ports from
# 7400 + 250 times the domain on.
unused_domain() {
  local port k domain used=' '
  while read -r _ port _; do
    used+="$(((16#${port##*:} - 7400) / 250)) "
  done < <(tail -qn +2 /proc/net/udp /proc/net/udp6 2>/dev/null)
  for ((k = 0; k < 90; k++)); do
    domain=$((($1 - 10 + k) % 90 + 10))
    [[ $used == *" $domain "* ]] || { printf '%s\n' "$domain"; return; }
  done
  note "all ROS domains from 10 to 99 are in use on this computer"
  return 1
}

running() { [[ -n ${process_of[$1]:-} ]] && kill -0 "${process_of[$1]}" 2>/dev/null; }

fail_with_log() {
  note "$1"
  tail -n 15 "$log_dir/$2.log" >&2 || true
  return 1
}

# last_line NAME: the last that it said which is not blank.
last_line() { sed -n '/[^[:space:]]/h; ${x; p}' "$log_dir/$1.log"; }

# ended NAME: leave the script as the process NAME left: its last line, its exit code.
ended() {
  local code=0
  wait "${process_of[$1]}" || code=$?
  unset "process_of[$1]"
  last_line "$1" >&2
  exit $((code == 0 ? 1 : code))
}

# The lifecycle client that runs: it goes on asking, and must not outlive the script.
client=
transition() {
  local node=$1 name=$2 what=$3
  running "$name" || ended "$name"
  (trap - EXIT INT TERM HUP && exec "$lifecycle" "$what" "/$node" --timeout 120) \
    >>"$log_dir/lifecycle.log" 2>&1 &
  client=$!
  while kill -0 "$client" 2>/dev/null; do
    sleep 0.05
    if ! running "$name"; then
      kill "$client" 2>/dev/null || true
      wait "$client" 2>/dev/null || true
      client=
      ended "$name"
    fi
  done
  local code=0
  wait "$client" || code=$?
  client=
  ((code == 0)) || fail_with_log "$node did not $what:" "$name"
}

# Several are asked about at once, as each takes seconds; one line says it.
absent() {
  local node code
  local -A asked=()
  for node in "$@"; do
    "$lifecycle" absent "/$node" 2>"$log_dir/absent_$node.log" &
    asked[$node]=$!
  done
  for node in "$@"; do
    code=0
    wait "${asked[$node]}" || code=$?
    ((code == 0)) && continue
    cat "$log_dir/absent_$node.log" >&2
    exit "$code"
  done
}

wait_for() {
  local name=$1 text=$2 seconds=${3:-120} i
  for ((i = 0; i < seconds * 20; i++)); do
    if grep -qF -- "$text" "$log_dir/$name.log" 2>/dev/null; then return 0; fi
    running "$name" || ended "$name"
    sleep 0.05
  done
  fail_with_log "$name was not ready within $seconds s (no '$text' in its output):" "$name"
}

# How the controller's log begins to tell that what was asked for is not driven; the gate may go on driving
# its 0 V.
undriven='(0 V: |stamps went back |path refused, |holding: the motion was dropped)'

# Logs that are followed: where each is read, and the beginning of a line that is being written.
declare -A log_of=() part_of=()
follow() {
  local log
  exec {log}<"$log_dir/$1.log"
  log_of[$1]=$log part_of[$1]=
}

hear() {
  local part
  while IFS= read -r -u "${log_of[$1]}" part || { part_of[$1]+=$part; return 1; }; do
    line=${part_of[$1]}$part part_of[$1]=
    [[ $line == *"[$2]: "* ]] || continue
    line=${line#*"[$2]: "}
    return 0
  done
}

# wait_end NAME SECONDS: until it ends by itself; its exit code.
wait_end() {
  local name=$1 seconds=$2 i
  for ((i = 0; i < seconds * 5; i++)); do
    running "$name" || break
    sleep 0.2
  done
  if running "$name"; then
    fail_with_log "$name did not end within $seconds s:" "$name"
    return 1
  fi
  local code=0
  wait "${process_of[$name]}" || code=$?
  unset "process_of[$name]"
  return "$code"
}

stop() {
  local name i code=0
  for name in "$@"; do
    [[ -n ${process_of[$name]:-} ]] || continue
    kill -TERM "${process_of[$name]}" 2>/dev/null || true
    for ((i = 0; i < 100; i++)); do
      running "$name" || break
      sleep 0.1
    done
    if running "$name"; then
      note "$name did not end on SIGTERM within 10 s: killed"
      kill -KILL "${process_of[$name]}" 2>/dev/null || true
      code=1
    fi
    wait "${process_of[$name]}" 2>/dev/null || true
    unset "process_of[$name]"
    # Where the bag is, and what is not in it.
    [[ $name != recorder ]] || sed -n '/^recorded /,$p' "$log_dir/$name.log" >&2
  done
  return "$code"
}

# Latest started first, but for the order that matters: commands stop before what carries them.
stop_all() {
  local names=() name i
  for name in controller bridge recorder; do
    for i in "${process_order[@]}"; do [[ $i != *"$name" ]] || names+=("$i"); done
  done
  for ((i = ${#process_order[@]} - 1; i >= 0; i--)); do names+=("${process_order[i]}"); done
  stop "${names[@]}" || true
}

# A child that is killed before it became its command still is this script: it must stop nobody.
main_process=$BASHPID
on_exit() {
  local code=$?
  # Who asks again, or closes the terminal, must not leave the bridge behind.
  trap '' INT TERM HUP
  trap - EXIT
  [[ $BASHPID == "$main_process" ]] || exit "$code"
  [[ -z $client ]] || kill "$client" 2>/dev/null || true
  stop_all
  exit "$code"
}
trap on_exit EXIT
trap 'exit 129' HUP
trap 'exit 130' INT
trap 'exit 143' TERM
