# Sourced by the other scripts (and by you): the environment of the built workspace.
#   source scripts/env.sh
# Topics stay on this machine unless ROS_AUTOMATIC_DISCOVERY_RANGE says otherwise.

[ -n "${BASH_VERSION:-}" ] || { echo "env.sh: source it in bash" >&2; return 2; }
hydro_root=$(CDPATH='' cd -- "$(dirname "${BASH_SOURCE[0]}")/.." && pwd)
"$hydro_root/scripts/setup.sh" || return 2

if [[ -n ${HYDRO_IGNORE_ROS:-} ]]; then
  unset PYTHONPATH LD_LIBRARY_PATH AMENT_PREFIX_PATH CMAKE_PREFIX_PATH ROS_DISTRO
fi
# colcon's and venv's own scripts read unset variables.
case $- in *u*) hydro_nounset=true; set +u ;; *) hydro_nounset=false ;; esac
# shellcheck disable=SC1091
source "$hydro_root/.venv/bin/activate"
# shellcheck disable=SC1091
source "$hydro_root/ros2_ws/install/setup.bash"
if $hydro_nounset; then set -u; fi
unset hydro_nounset

# A script and what it starts keep set-up from replacing the workspace under them.
if [[ $- != *i* ]]; then
  exec {hydro_lock}<>"$hydro_root/.venv/.in_use.lock"
  flock -s "$hydro_lock"
fi

# Without kept bytecode every process compiles what it imports: 4 s of the processor instead of 1.5.
# Packages come without it (setup.sh): what is used is kept when it is first imported.
unset PYTHONDONTWRITEBYTECODE

export ROS_AUTOMATIC_DISCOVERY_RANGE=${ROS_AUTOMATIC_DISCOVERY_RANGE:-LOCALHOST}
export RCUTILS_LOGGING_BUFFERED_STREAM=1
# One thread a process: the products are small, and results do not depend on the core count.
export OMP_NUM_THREADS=${OMP_NUM_THREADS:-1} OPENBLAS_NUM_THREADS=${OPENBLAS_NUM_THREADS:-1}

# hydro_exe PACKAGE EXECUTABLE: the path that `ros2 run PACKAGE EXECUTABLE` runs.
hydro_exe() {
  local path=$hydro_root/ros2_ws/install/$1/lib/$1/$2
  if [[ ! -x $path ]]; then
    printf 'no executable %s in package %s\n' "$2" "$1" >&2
    return 2
  fi
  printf '%s\n' "$path"
}
