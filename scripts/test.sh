#!/usr/bin/env bash
# Runs linters, types, then pytest over all packages (arguments go to pytest).
#   scripts/test.sh                 in one process more than there are cores (at most 4)
#   scripts/test.sh --all           with the thorough tests, twenty minutes more
#   scripts/test.sh -m 'not ros'    without the tests that start ROS processes
#   scripts/test.sh -n 0 FILE       in one process, whose output is seen (-s) and debugged (--pdb)
set -euo pipefail
shopt -s inherit_errexit

case ${1:-} in -h|--help) sed -n '2,6s/^# \{0,1\}//p' "${BASH_SOURCE[0]}"; exit 0 ;; esac
# shellcheck source=scripts/env.sh
source "$(dirname "${BASH_SOURCE[0]}")/env.sh"
cd "$hydro_root"
# A -m of one's own comes after it, and pytest takes the last.
if [[ ${1:-} == --all ]]; then shift; else set -- -m 'not thorough' "$@"; fi

packages=(ros2_ws/src/hydro_model/hydro_model hydro_msgs_docs/hydro_msgs_docs
  hydro_hw_bridge/hydro_hw_bridge hydro_control/hydro_control hydro_ident/hydro_ident)

for script in scripts/*.sh .ci/run; do bash -n "$script"; done
ruff check .
ruff format --check .
# Types are checked while the first tests run, which have the right of way: told at the end.
types=$(mktemp) kernels=$(mktemp)
trap 'rm -f "$types" "$kernels"' EXIT
nice mypy "${packages[@]}" >"$types" 2>&1 &
checking=$!
failed=0
# Once, where every worker would do it at the same time: workers collect the tests meanwhile, and
# the first test waits until nobody has the file locked any more (conftest.py).
exec {lock}>"$kernels"
flock "$lock"
compiling=()
for half in model rest; do
  python tests/compile_kernels.py "$half" &
  compiling+=($!)
done
exec {lock}>&-
export HYDRO_TESTS_WAIT_FOR=$kernels
# Tests with processes on buses share one worker and come first (conftest.py); it mostly waits.
cores=$(env -u OMP_NUM_THREADS nproc)
workers=$((cores < 3 ? cores + 1 : 4))
python -m pytest -n "$workers" --dist loadfile --no-loadscope-reorder "$@" || failed=$?
for half in "${compiling[@]}"; do wait "$half" || failed=1; done
wait "$checking" || failed=1
cat "$types"
exit "$failed"
