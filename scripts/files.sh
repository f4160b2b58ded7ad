# Sourced: files that the packages ship.
# shellcheck shell=bash

# shipped_gains [NAME]: ROS parameters of the controller.
shipped_gains() {
  python -c 'import sys; from hydro_control.gains import shipped_gains
print(shipped_gains(*sys.argv[1:]))' "$@"
}

# default_mapping ROBOT: the bus mapping shipped for a robot; nothing where there is none.
default_mapping() {
  python -c 'import sys
from hydro_model.robot_files import load_robot
from hydro_msgs_docs.errors import ContractError
from hydro_msgs_docs.shipped_mapping import default_mapping
try:
    print(default_mapping(load_robot(sys.argv[1]).name))
except ContractError:
    pass' "$1"
}

# robot_name ROBOT: the name that a robot's file says.
robot_name() {
  python -c 'import sys
from hydro_model.command_line.command import run_command
from hydro_model.robot_files import load_robot

def name(arguments):
    print(load_robot(arguments[0]).name)
    return 0

sys.exit(run_command("bringup", name))' "$1"
}

# path_seconds PATH EXTRA: how long a path takes, and EXTRA seconds.
path_seconds() {
  python -c 'import sys
from hydro_model.command_line.command import run_command
from hydro_model.motion.paths import load_path

def seconds(arguments):
    print(f"{load_path(arguments[0]).duration_s + float(arguments[1]):.3f}")
    return 0

sys.exit(run_command("path", seconds))' "$@"
}

# valves_at_end FILE: `enabled` or `off`, as the simulated rig's valves were in the last cycle of its side
# file.
valves_at_end() {
  python -c 'import sys
from pathlib import Path
from hydro_hw_bridge.rig.truth_log import read_truth_log
from hydro_model.command_line.command import run_command

def valves(arguments):
    enabled = read_truth_log(Path(arguments[0])).column("enabled")
    print("enabled" if len(enabled) and enabled[-1] else "off")
    return 0

sys.exit(run_command("rig_run", valves))' "$1"
}

# check_parameters PACKAGE FILE [NAME ...]: refuse ROS parameters of a package's node that it would not
# take from there, beside those named, which are given as options.
check_parameters() {
  python -c 'import sys
from importlib import import_module
from pathlib import Path
from hydro_model.command_line.command import run_command

def check(arguments):
    package, file, *given = arguments
    import_module(f"{package}.node.parameter_file").check_parameter_file(Path(file), given)
    return 0

sys.exit(run_command("bringup", check))' "$@"
}
