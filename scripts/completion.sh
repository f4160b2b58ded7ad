#!/usr/bin/env bash
# Sourced by you, in bash: the executables by their names, with tab completion.
#   source scripts/env.sh && source scripts/completion.sh
#   identify --<Tab>            options
#   identify --robot <Tab>      names of shipped robots, and files
# The names are functions of this shell: other programs that are called so (python-can's can_bridge,
# ImageMagick's convert) stay what they are elsewhere, and `command convert` is theirs here, too.
# Needs argcomplete (it comes with colcon); without it the names still work.

if [[ ${BASH_SOURCE[0]} == "$0" ]]; then
  [[ ${1:-} == --help || ${1:-} == -h ]] && sed -n '2,8s/^# \{0,1\}//p' "$0" && exit 0
  printf 'completion.sh: source it: source scripts/env.sh && source scripts/completion.sh\n' >&2
  exit 2
fi
hydro_names=()
for hydro_package in hydro_hw_bridge hydro_control hydro_ident hydro_msgs_docs; do
  for hydro_path in "$hydro_root/ros2_ws/install/$hydro_package/lib/$hydro_package"/*; do
    hydro_names+=("${hydro_path##*/}")
    eval "$(printf 'function %s { %q "$@"; }' "${hydro_path##*/}" "$hydro_path")"
  done
done
if command -v register-python-argcomplete >/dev/null; then
  eval "$(register-python-argcomplete "${hydro_names[@]}")"
else
  printf 'completion.sh: no argcomplete here: names only\n' >&2
fi
unset hydro_names hydro_package hydro_path
