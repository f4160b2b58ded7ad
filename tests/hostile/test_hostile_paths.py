"""Files that lead elsewhere, and elsewhere files: no other folder reached, little of it shown."""

from __future__ import annotations

import shutil
from collections.abc import Callable
from pathlib import Path

import pytest

from hydro_hw_bridge.protocol.codec import Codec
from hydro_ident.inspecting.named_robot import look_for
from hydro_ident.study.fuzz.targets import NAME, shipped_mapping
from hydro_model.errors import HydroError
from hydro_model.robot_files import load_robot, shipped_robots

#: Reads (path, target): what was said, and the notes beside a bag.
Read = Callable[[Path, str], str]


def _robot_text() -> str:
    return shipped_robots()[NAME].read_text(encoding="utf-8")


@pytest.mark.parametrize(
    ("old", "new", "expected"),
    [
        ("urdf: xs031.urdf", "urdf: /dev/zero", "no URDF at /dev/zero"),
        ("urdf: xs031.urdf", f"urdf: {'x' * 300}", "'urdf' should be a file"),
        ("urdf: xs031.urdf", 'urdf: "x\\0"', "'urdf' should be a file"),
        ("robot: xs031", "robot: ../../evil", "'robot' should be a name without '/'"),
        ("robot: xs031", "robot: .evil", "'robot' should be a name"),
    ],
)
def test_names_of_a_robot_file_that_are_none(
    read: Read, tmp_path: Path, old: str, new: str, expected: str
) -> None:
    text = _robot_text()
    assert old in text
    path = tmp_path / "robot.yaml"
    path.write_text(text.replace(old, new, 1), encoding="utf-8")
    assert expected in read(path, "robot")


@pytest.mark.parametrize("outside", ["../xs031.urdf", "WHOLE"])
def test_paths_that_lead_out_of_the_folder(tmp_path: Path, outside: str) -> None:
    """A file that its user names may name any URDF, one that a bag's name led to may not."""
    shipped = shipped_robots()[NAME].with_name("xs031.urdf")
    shutil.copy(shipped, tmp_path)
    folder = tmp_path / "robots"
    folder.mkdir()
    text = _robot_text().replace("robot: xs031", "robot: mine")
    path = folder / "mine.hydraulics.yaml"
    named_urdf = outside.replace("WHOLE", str(shipped))
    path.write_text(text.replace("urdf: xs031.urdf", f"urdf: {named_urdf}"))
    assert load_robot(path).joint_names == load_robot(NAME).joint_names
    with pytest.raises(HydroError, match="'urdf' should be a file in or below"):
        load_robot(path, bounded=True)
    named = look_for({"robot": "mine"}, [folder])
    assert named.robot is None
    assert "'urdf' should be a file in or below" in named.troubles[0]


@pytest.mark.parametrize("new", ["dbc: ../xs031.dbc", "dbc: /dev/zero", "name: a/b\ndbc: x.dbc"])
def test_mappings_that_lead_out_of_the_folder(read: Read, tmp_path: Path, new: str) -> None:
    text = shipped_mapping().read_text(encoding="utf-8").replace("name: ", "old_name: ", 1)
    extra = "" if new.startswith("name") else "name: x\n"
    path = tmp_path / "case.yaml"
    path.write_text(
        text.replace("dbc: xs031.dbc", extra + new).replace("old_name: xs031\n", ""),
        encoding="utf-8",
    )
    said = read(path, "mapping")
    assert "should be a file in or below" in said or "should be a name without" in said, said


SECRET = "root:x:0:0:kept-to-itself:/root:/bin/bash\n" * 20


@pytest.fixture
def linked(tmp_path: Path) -> Path:
    """A folder with what is shipped of robot and bus, and a file beside it that is none of it."""
    folder = tmp_path / "folder"
    folder.mkdir()
    for file in (shipped_robots()[NAME], shipped_mapping()):
        shutil.copy(file, folder)
        suffix = ".urdf" if file == shipped_robots()[NAME] else ".dbc"
        shutil.copy(file.with_name(f"{NAME}{suffix}"), folder)
    (tmp_path / "secret").write_text(SECRET, encoding="utf-8")
    return folder


@pytest.mark.parametrize(("suffix", "target"), [("urdf", "robot"), ("dbc", "mapping")])
@pytest.mark.parametrize("link", ["../secret", "/etc/hostname", "/dev/zero", "gone/../.."])
def test_links_that_lead_out_of_the_folder(
    linked: Path, suffix: str, target: str, link: str
) -> None:
    named = linked / "here"
    named.symlink_to(link)
    source = shipped_robots()[NAME] if target == "robot" else shipped_mapping()
    text = (linked / source.name).read_text(encoding="utf-8")
    (linked / source.name).write_text(text.replace(f"{NAME}.{suffix}", "here"), encoding="utf-8")
    with pytest.raises(HydroError, match=f"'{suffix}' should be a file in or below") as caught:
        _loaded(linked / source.name, target)
    assert "kept-to-itself" not in str(caught.value)


def test_a_link_to_itself_is_no_file(linked: Path) -> None:
    (linked / f"{NAME}.urdf").unlink()
    (linked / f"{NAME}.urdf").symlink_to(f"{NAME}.urdf")
    with pytest.raises(HydroError, match="urdf"):
        _loaded(linked / f"{NAME}.hydraulics.yaml", "robot")


def _loaded(path: Path, target: str) -> object:
    robot = load_robot(path if target == "robot" else NAME, bounded=True)
    return robot if target == "robot" else Codec.load(None, path, robot)


@pytest.mark.parametrize(
    ("name", "target"), [(f"{NAME}.hydraulics.yaml", "robot"), (f"{NAME}.mapping.yaml", "mapping")]
)
def test_links_of_folders_and_of_installed_files_are_followed(
    linked: Path, name: str, target: str
) -> None:
    (linked.parent / "link").symlink_to(linked)
    assert _loaded(linked.parent / "link" / name, target)
    # As `colcon build --symlink-install` leaves them: a folder whose files are links to links.
    for here, there in (("build", linked), ("share", linked.parent / "build")):
        (linked.parent / here).mkdir()
        for file in sorted(there.iterdir()):
            (linked.parent / here / file.name).symlink_to(there / file.name)
    assert _loaded(linked.parent / "share" / name, target)
    # And of a folder with one file below and one link within it.
    below = linked / "below"
    below.mkdir()
    suffix = "urdf" if target == "robot" else "dbc"
    (linked / f"{NAME}.{suffix}").rename(below / "real")
    (linked / f"{NAME}.{suffix}").symlink_to("below/real")
    assert _loaded(linked / name, target)


@pytest.mark.parametrize("target", ["robot", "mapping", "dbc", "urdf"])
@pytest.mark.parametrize(
    "text", [SECRET, SECRET.replace("\n", " "), "<a>" + SECRET, "\t" + SECRET]
)
def test_little_of_a_file_that_is_something_else_is_shown(
    read: Read, tmp_path: Path, target: str, text: str
) -> None:
    path = tmp_path / f"case.{target}"
    path.write_text(text, encoding="utf-8")
    said = read(path, target)
    assert said
    assert said.count("kept-to-itself") <= 2
    assert len(said.replace(str(path), "")) < 260
