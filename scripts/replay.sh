#!/usr/bin/env bash
# Plays a bag back onto the topics: with rosbag2 where it is installed, else with hydro_ident player.
#   scripts/replay.sh BAG [options of `ros2 bag play`, or of the player]
set -euo pipefail
shopt -s inherit_errexit

case ${1:-} in
  -h|--help) sed -n '2,3s/^# \{0,1\}//p' "${BASH_SOURCE[0]}"; exit 0 ;;
  ''|-*) printf 'replay: expected a BAG first (see --help)\n' >&2; exit 2 ;;
esac
[[ -e $1 ]] || { printf "replay: no bag at '%s'\n" "$1" >&2; exit 2; }
# shellcheck source=scripts/env.sh
source "$(dirname "${BASH_SOURCE[0]}")/env.sh"
if command -v ros2 >/dev/null && ros2 bag play --help >/dev/null 2>&1; then
  exec ros2 bag play "$@"
fi
exec "$(hydro_exe hydro_ident player)" "$@"
