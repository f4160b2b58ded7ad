# Sourced: commands that end with the script that runs them.
# shellcheck shell=bash

# with_parent: in front of a command, has the kernel send it SIGTERM should the script be killed, which can
# stop nobody any more; nothing where util-linux's setpriv cannot see to it.
with_parent=(setpriv --pdeathsig TERM)
"${with_parent[@]}" true 2>/dev/null || with_parent=()
