"""The truth plant is a second implementation: it may know the robot, never the model."""

import ast
from pathlib import Path

import hydro_hw_bridge.rig as rig

FOLDER = Path(rig.__file__).parent
#: The robot description with its reader, and what every command shares.
COMMANDS = {"command_line.command", "command_line.output"}
ALLOWED = {"errors", "robot", "robot_files", "description.fields", *COMMANDS}


def _imported(path: Path) -> set[str]:
    names = set()
    for node in ast.walk(ast.parse(path.read_text(encoding="utf-8"))):
        if isinstance(node, ast.Import):
            names |= {alias.name for alias in node.names}
        elif isinstance(node, ast.ImportFrom):
            assert node.level == 0, f"{path.name}: relative imports hide what they reach"
            names |= {f"{node.module}.{alias.name}" for alias in node.names}
            names.add(str(node.module))
        elif isinstance(node, ast.Call):
            called = ast.unparse(node.func)
            assert "import_module" not in called, path.name
            assert "__import__" not in called, path.name
    return names


def test_rig_imports_only_the_robot_description() -> None:
    files = sorted(FOLDER.rglob("*.py"))
    assert len(files) > 8
    for path in files:
        for name in _imported(path):
            package, *rest = name.split(".")
            assert package not in ("hydro_control", "hydro_ident", "rclpy"), (path.name, name)
            if package == "hydro_model":
                assert rest, (path.name, name)
                assert {rest[0], ".".join(rest[:2])} & ALLOWED, (path.name, name)


def test_plant_knows_neither_bus_nor_codec() -> None:
    names = ("plant", "truth", "instruments", "amplifier", "core", "pose", "compiled")
    kernels = sorted(FOLDER.glob("kernel*.py"))
    assert kernels
    for path in (*(FOLDER / f"{name}.py" for name in names), *kernels):
        for name in _imported(path):
            assert name.split(".")[0] not in ("can", "cantools"), (path.name, name)
            if name.startswith("hydro_hw_bridge."):
                assert name.split(".")[1] in ("rig", "errors"), (path.name, name)
