#!/usr/bin/env bash
# Sets up everything the other scripts need; a second run finds it done and returns at once.
#   no ROS sourced:    virtual environment .venv from requirements.lock (ROS 2 Jazzy wheels included)
#   ROS Jazzy sourced: virtual environment over the system's packages, only what is missing is added
# Then builds ros2_ws with colcon.  --force does it all again; HYDRO_PYTHON names another Python;
# HYDRO_IGNORE_ROS=1 takes the wheels although ROS is sourced.
set -euo pipefail
shopt -s inherit_errexit

# Where it is set, `cd` looks elsewhere first and prints where it went.
unset CDPATH
root=$(cd "$(dirname "${BASH_SOURCE[0]}")/.." && pwd)
cd "$root"

say() { printf '%s\n' "$*" >&2; }
die() { say "setup: $*"; exit 2; }

force=false
for argument in "$@"; do
  case $argument in
    --force) force=true ;;
    -h|--help) sed -n '2,6s/^# \{0,1\}//p' "${BASH_SOURCE[0]}"; exit 0 ;;
    *) die "unknown option '$argument' (known: --force, --help)" ;;
  esac
done

# Executables begin with the path of their Python, in which the system takes no space.
[[ $root != *[[:space:]]* ]] || die "expected a path without spaces, found '$root': move it"

ros=wheels
if [[ -n ${HYDRO_IGNORE_ROS:-} ]]; then
  unset PYTHONPATH LD_LIBRARY_PATH AMENT_PREFIX_PATH CMAKE_PREFIX_PATH ROS_DISTRO
elif [[ ${ROS_DISTRO:-} == jazzy ]]; then
  ros=system
elif [[ -n ${ROS_DISTRO:-} ]]; then
  die "ROS '$ROS_DISTRO' is sourced, expected jazzy (or a plain shell, or HYDRO_IGNORE_ROS=1)"
fi

# Pythons to choose from, but for that of our own environment, which set-up may delete.
candidates() {
  local name
  for name in "${HYDRO_PYTHON:-}" python3 /usr/bin/python3 python3.{12,11,13,10,14}; do
    [[ -z $name ]] || type -aP "$name" 2>/dev/null || true
  done | grep -vF "$root/.venv/" || true
}

supported='import sys; sys.exit(not (3, 10) <= sys.version_info[:2] <= (3, 14))'
find_python() {
  local candidate
  while read -r candidate; do
    "$candidate" -c "$supported" 2>/dev/null || continue
    [[ $ros == wheels ]] || "$candidate" -c 'import rclpy' 2>/dev/null || continue
    printf '%s\n' "$candidate"
    return
  done < <(candidates)
  [[ $ros == wheels ]] || die "ROS jazzy is sourced, but no Python here can import rclpy"
  die "no Python from 3.10 to 3.14 found (python3 is $(python3 --version 2>&1 || echo absent))"
}

# make_venv PYTHON [OPTION]: .venv with pip. Debian and Ubuntu ship the venv module apart.
make_venv() {
  local python=$1 apt=(apt-get -qq)
  if ! "$python" -c 'import ensurepip, venv' 2>/dev/null && command -v apt-get >/dev/null; then
    if [[ $(id -u) -ne 0 ]] && sudo -n true 2>/dev/null; then apt=(sudo "${apt[@]}"); fi
    if [[ $(id -u) -eq 0 || ${apt[0]} == sudo ]]; then
      say "setup: installing python3-venv"
      { "${apt[@]}" update && "${apt[@]}" install -y python3-venv; } >/dev/null || true
    fi
  fi
  if "$python" -c 'import ensurepip, venv' 2>/dev/null; then
    "$python" -m venv "${@:2}" .venv
  elif "$python" -m pip --version >/dev/null 2>&1; then
    "$python" -m venv --without-pip "${@:2}" .venv
    "$python" -m pip --python .venv/bin/python install --quiet pip
  else
    die "$python has neither venv with pip nor pip; install it: sudo apt install python3-venv"
  fi
}

# By halves, side by side: unpacking takes one core alone, and no wheel asks for another one.
install_wheels() {
  local half failed=0
  for half in 0 1; do awk "NR % 2 == $half" requirements.lock >".venv/half_$half.txt"; done
  # What is used is compiled when it is first imported.
  "${pip[@]}" --no-compile --no-deps -r .venv/half_0.txt &
  "${pip[@]}" --no-compile --no-deps -r .venv/half_1.txt || failed=$?
  wait "$!" || failed=$?
  return "$failed"
}

install_python_packages() {
  local pip=(.venv/bin/python -m pip install --quiet --disable-pip-version-check)
  if [[ $ros == wheels ]]; then
    make_venv "$python"
    install_wheels
    return
  fi
  make_venv "$python" --system-site-packages
  # ROS's compiled messages are bound to the system's numpy, and scipy and numba follow numpy;
  # everything else is pinned as in the lock.
  {
    "$python" -c 'import numpy; print(f"numpy=={numpy.__version__}")'
    grep -vE '^(ros-|numpy|scipy|numba|llvmlite|optype)' requirements.lock
  } >.venv/constraints.txt
  "${pip[@]}" --upgrade-strategy only-if-needed -c .venv/constraints.txt -r requirements.in \
    -r requirements-test.in colcon-common-extensions 'setuptools<80'
}

build_workspace() {
  # The environment's own interpreter, so that the executables' first line names it.
  PATH="$root/.venv/bin:$PATH"
  export PATH
  cd ros2_ws
  mkdir -p log
  python -m colcon build --symlink-install --event-handlers console_direct- status- \
    >log/build.txt 2>&1
}

python=$(find_python)
# What the environment depends on; the stamps are written last, so a broken run starts again.
fingerprint=$(cat requirements*.in requirements.lock scripts/setup.sh | sha256sum | cut -c1-16)
wanted="$ros $("$python" --version 2>&1) $fingerprint"
packages=(ros2_ws/src/hydro_model hydro_hw_bridge hydro_control hydro_ident hydro_msgs_docs)
recipe=$(cat "${packages[@]/%//setup.py}" "${packages[@]/%//package.xml}" \
  "${packages[@]/%//setup.cfg}" | sha256sum | cut -c1-16)
python_done() { [[ $(cat .venv/.setup.done 2>/dev/null) == "$wanted" ]]; }
build_done() { [[ $(cat ros2_ws/install/.setup.done 2>/dev/null) == "$recipe" ]]; }

mkdir -p .venv
exec 9>.venv/.setup.lock 8>.venv/.in_use.lock
flock 9
if ! $force && python_done && build_done; then exit 0; fi
# Scripts hold this lock while their processes run: nothing is pulled away under a moving machine.
flock -n 8 || die "the sources changed, but processes of this workspace are running: stop them first"

if $force || ! python_done; then
  say "setup: Python environment in .venv ($("$python" --version 2>&1), ROS from $ros)"
  rm -rf .venv/.setup.done .venv/bin .venv/lib .venv/lib64 .venv/include
  rm -rf ros2_ws/install ros2_ws/build
  install_python_packages
  printf '%s\n' "$wanted" >.venv/.setup.done
fi
if $force || ! build_done; then
  say "setup: building ros2_ws"
  rm -rf ros2_ws/install ros2_ws/build
  if ! (build_workspace); then
    tail -n 30 ros2_ws/log/build.txt >&2
    die "colcon build failed (ros2_ws/log/build.txt)"
  fi
  printf '%s\n' "$recipe" >ros2_ws/install/.setup.done
fi
