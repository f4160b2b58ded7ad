"""The pages say what the code does: topics, QoS, examples, the bus's frames, links."""

from __future__ import annotations

import importlib
import re
from collections.abc import Iterator
from pathlib import Path
from typing import Any
from urllib.parse import unquote

import pytest
import yaml

from hydro_msgs_docs import topics

ROOT = Path(__file__).resolve().parents[1]
DOCS = ROOT / "hydro_msgs_docs"
PAGES = DOCS / "topics"
#: Where built or downloaded files lie; hidden folders are left out too.
NOT_OURS = {"build", "install", "log", "out", "bags", "identified", "node_modules"}

#: Page of each topic with its type; pressure readings have names per cylinder.
PRESSURE_PAGE = "pressure"
PAGE_TYPES = {name.strip("/"): kind for name, kind in topics.MESSAGE_TYPES.items()} | {
    PRESSURE_PAGE: "sensor_msgs/msg/FluidPressure"
}
TOPIC_CONSTANTS = {
    value
    for name, value in vars(topics).items()
    if name.isupper() and isinstance(value, str) and value.startswith("/")
}


def markdown_files() -> list[Path]:
    """Every Markdown file of the repository."""
    found = []
    for path in ROOT.rglob("*.md"):
        folders = path.relative_to(ROOT).parts[:-1]
        if not any(part.startswith(".") or part in NOT_OURS for part in folders):
            found.append(path)
    return sorted(set(found))


def without_blocks(text: str) -> str:
    """Markdown without its fenced blocks."""
    return re.sub(r"^```.*?^```", "", text, flags=re.M | re.S)


def without_code(text: str) -> str:
    """Markdown without fenced blocks and code spans."""
    return re.sub(r"`[^`\n]*`", "", without_blocks(text))


def anchors(text: str) -> set[str]:
    """Anchors that a Markdown page's headings make."""
    found: list[str] = []
    for title in re.findall(r"^#+ +(.+?) *$", without_blocks(text), re.M):
        plain = re.sub(r"\[([^\]]*)\]\([^)]*\)", r"\1", title).lower()
        found.append(re.sub(r"[^\w\- ]", "", plain).replace(" ", "-"))
    again = {f"{a}-{i}" for a in found for i in range(1, found.count(a))}
    return set(found) | again


def sections(text: str) -> dict[str, str]:
    """Body of each second- and third-level section by its title."""
    parts = re.split(r"^#{2,3} +(.+?) *$", text, flags=re.M)
    return dict(zip(parts[1::2], parts[2::2], strict=True))


def message_class(kind: str) -> Any:
    """The class of `package/msg/Name` or `package/Name`."""
    package, *_, name = kind.split("/")
    return getattr(importlib.import_module(f"{package}.msg"), name)


def build(kind: str, value: Any) -> Any:
    """A message from the mapping of an example; fails on a field that is not there."""
    message = message_class(kind)()
    known = message.get_fields_and_field_types()
    for field, given in value.items():
        assert field in known, f"{kind} has no field '{field}' (fields: {', '.join(known)})"
        setattr(message, field, _field(known[field], given))
    return message


def _field(kind: str, given: Any) -> Any:
    if sequence := re.fullmatch(r"sequence<([^,>]+).*>", kind):
        return [_field(sequence[1], item) for item in given]
    if "/" in kind:
        return build(kind, given)
    return bytes([given]) if kind == "octet" else given


def qos_text(topic: str) -> str:
    """QoS of a topic in the words of the pages, from the profile that the code makes."""
    profile = topics.latched() if topic == topics.BASE_PARAMETERS else topics.reliable()
    words = [profile.reliability.name.lower(), profile.history.name.lower()]
    return f"{words[0]}, {words[1]} {profile.depth}, {profile.durability.name.lower()}"


def test_every_topic_constant_has_a_type() -> None:
    assert set(topics.MESSAGE_TYPES) == TOPIC_CONSTANTS


def test_every_topic_has_a_page_and_every_page_a_topic() -> None:
    assert {p.stem for p in PAGES.glob("*.md")} - {"README"} == set(PAGE_TYPES)


def test_index_links_every_page_with_its_type() -> None:
    rows = (PAGES / "README.md").read_text(encoding="utf-8").splitlines()
    for page, kind in PAGE_TYPES.items():
        row = [r for r in rows if r.startswith("|") and f"]({page}.md)" in r]
        assert len(row) == 1, f"index has {len(row)} rows for {page}"
        assert f"`{kind}`" in row[0]
        assert f"`/{page}" in row[0]


@pytest.mark.parametrize("page", sorted(PAGE_TYPES))
class TestPage:
    def text(self, page: str) -> str:
        return (PAGES / f"{page}.md").read_text(encoding="utf-8")

    def test_names_topic_type_qos_and_stamp(self, page: str) -> None:
        text = self.text(page)
        assert text.startswith(f"# `/{page}")
        assert re.search(rf"^\| Type \| `{re.escape(PAGE_TYPES[page])}`", text, re.M)
        assert f"| QoS | {qos_text('/' + page)} |" in text
        for row in ("Rate", "Published by", "Read by", "Stamp"):
            assert re.search(rf"^\| {row} \| \S", text, re.M), f"{page}.md has no row {row}"

    def test_names_every_field(self, page: str) -> None:
        text = self.text(page)
        for field in message_class(PAGE_TYPES[page]).get_fields_and_field_types():
            row = rf"^\| `{field}(\.|\[|`)"
            assert re.search(row, text, re.M), f"{page}.md says nothing of field '{field}'"

    def test_example_is_a_message_of_the_type(self, page: str) -> None:
        blocks = re.findall(r"^```yaml\n(.*?)^```", self.text(page), re.M | re.S)
        assert blocks, f"{page}.md has no example"
        for block in blocks:
            message = build(PAGE_TYPES[page], yaml.safe_load(block))
            if PAGE_TYPES[page].endswith("/JointState"):
                lengths = {len(message.position), len(message.velocity), len(message.effort)}
                assert lengths <= {0, len(message.name)}


def robot_names(robot: Any, page: str) -> tuple[str, ...]:
    if page == "chamber_pressures":
        return tuple(robot.pressure_names)
    return tuple(robot.valve_names if page.startswith("valve") else robot.joint_names)


@pytest.mark.parametrize(
    "page",
    ["joint_states", "chamber_pressures", "valve_command", "valve_state", "joint_reference"],
)
def test_examples_carry_the_names_of_the_shipped_robot(page: str) -> None:
    from hydro_model.robot_files import load_robot

    text = (PAGES / f"{page}.md").read_text(encoding="utf-8")
    [block] = re.findall(r"^```yaml\n(.*?)^```", text, re.M | re.S)
    assert tuple(yaml.safe_load(block)["name"]) == robot_names(load_robot("xs031"), page)


def test_example_of_pressures_holds_the_example_of_the_pose() -> None:
    """The three example messages belong together: forces of the pressures carry the arm."""
    from hydro_model.robot_files import load_robot

    robot = load_robot("xs031")
    example = {
        page: yaml.safe_load(
            re.findall(
                r"^```yaml\n(.*?)^```",
                (PAGES / f"{page}.md").read_text(encoding="utf-8"),
                re.M | re.S,
            )[0]
        )
        for page in ("chamber_pressures", "joint_reference")
    }
    absolute = dict(
        zip(
            example["chamber_pressures"]["name"],
            example["chamber_pressures"]["effort"],
            strict=True,
        )
    )
    for cylinder, force in zip(robot.cylinders, example["joint_reference"]["effort"], strict=True):
        p_a, p_b = (absolute[f"{cylinder.name}/{s}"] - robot.atmospheric_pressure_pa for s in "ab")
        held = p_a * cylinder.area_a_m2 - p_b * cylinder.area_b_m2
        assert held == pytest.approx(force, rel=1e-3)


def dbc_files() -> list[Path]:
    return sorted((DOCS / "can").glob("*.dbc"))


def test_bus_page_has_the_frames_of_the_dbc() -> None:
    import cantools

    text = (DOCS / "bus.md").read_text(encoding="utf-8")
    parts = sections(text)
    assert dbc_files(), "no DBC in hydro_msgs_docs/can"
    for path in dbc_files():
        assert f"can/{path.name}" in text
        database: Any = cantools.database.load_file(path)
        for message in database.messages:
            row = rf"^\| `{message.name}` \| 0x{message.frame_id:03X} \| {message.length} \|"
            assert re.search(row, text, re.M), f"bus.md: no row for {message.name} as in the DBC"
            body = parts.get(f"`{message.name}`", "")
            for signal in message.signals:
                bits = f"{signal.start}, {signal.length}"
                assert re.search(rf"^\| `{signal.name}` \| {bits} \|", body, re.M), (
                    f"bus.md, {message.name}: no row for signal {signal.name} ({bits})"
                )


def test_bus_page_states_the_load_that_the_bridge_prints() -> None:
    from hydro_hw_bridge.protocol.codec import Codec
    from hydro_model.robot_files import load_robot

    layout = Codec.load(None, None, load_robot("xs031")).layout
    text = (DOCS / "bus.md").read_text(encoding="utf-8")
    assert f"by {100 * layout.bus_load:.1f} %" in text


def test_bus_page_names_every_key_of_a_mapping() -> None:
    from hydro_hw_bridge.protocol.mapping import ROLES, STATUS_NAMES

    text = (DOCS / "bus.md").read_text(encoding="utf-8")
    mapping = yaml.safe_load((DOCS / "can" / "xs031.mapping.yaml").read_text(encoding="utf-8"))
    for key in [*mapping, *STATUS_NAMES, *ROLES]:
        assert re.search(rf"`{key}[`.]", text), f"bus.md says nothing of '{key}'"


def test_effects_page_is_what_the_catalogue_prints() -> None:
    from hydro_model.effects.page import page

    text = (DOCS / "effects.md").read_text(encoding="utf-8")
    assert text == page(), "run: python -m hydro_model.effects.page > hydro_msgs_docs/effects.md"


def test_method_page_has_the_base_parameters_of_the_reference_crane() -> None:
    from hydro_model.multibody.base_parameters import base_map
    from hydro_model.robot_files import load_robot

    base = base_map(load_robot("xs031"))
    text = (DOCS / "method.md").read_text(encoding="utf-8")
    [block] = [b for b in re.findall(r"^```text\n(.*?)^```", text, re.M | re.S) if ".mcx" in b]
    written = {w.strip() for w in re.split(r"\n|  +", block) if w.strip()}
    assert written == {base.readable(i) for i in range(len(base.names))}


@pytest.mark.parametrize(
    "module", ["hydro_hw_bridge.node.parameters", "hydro_control.node.parameters"]
)
def test_parameter_tables_are_those_of_the_code(module: str) -> None:
    table = importlib.import_module(module).markdown_table()
    text = (DOCS / "parameters.md").read_text(encoding="utf-8")
    assert table in text, f"parameters.md differs from {module}; expected\n{table}"


@pytest.mark.parametrize(
    ("module", "parameters"),
    [
        ("hydro_ident.identify.identification_node", "_MEANT"),
        ("hydro_msgs_docs.visual_node", "_PARAMETERS"),
    ],
)
def test_parameters_of_the_other_nodes_are_those_of_the_code(module: str, parameters: str) -> None:
    declared = getattr(importlib.import_module(module), parameters)
    rows = declared.items() if isinstance(declared, dict) else declared
    text = (DOCS / "parameters.md").read_text(encoding="utf-8")
    heading = {"identification_node": "identification_node", "visual_node": "visual_joints"}
    section = text.split(f"## `{heading[module.split('.')[-1]]}`")[1].split("\n## ")[0]
    told = re.findall(r"^\| `(\w+)` \| [\w ]+ \| (.*) \| (.*) \|$", section, re.M)
    expected = [
        (row[0], f"`{row[2]}`" if len(row) > 2 and row[2] is not None else "(needed)", row[1])
        for row in rows
    ]
    assert told == expected


def links() -> Iterator[tuple[Path, str]]:
    for path in markdown_files():
        text = without_code(path.read_text(encoding="utf-8"))
        for target in re.findall(r"\]\(\s*<?([^)\s>]+)>?[^)]*\)", text):
            if not re.match(r"[a-z][a-z0-9+.-]*:", target):
                yield path, target


def test_relative_links_resolve() -> None:
    broken = []
    for path, target in links():
        name, _, anchor = unquote(target).partition("#")
        aim = (path.parent / name).resolve() if name else path
        inside = aim == ROOT or ROOT in aim.parents
        if name.startswith("/") or not inside or not aim.exists():
            broken.append(f"{path.relative_to(ROOT)}: {target}")
        elif anchor and aim.suffix == ".md" and anchor not in anchors(aim.read_text("utf-8")):
            broken.append(f"{path.relative_to(ROOT)}: no heading for {target}")
    assert not broken, "\n".join(broken)


def test_no_page_mentions_a_path_of_one_machine() -> None:
    pattern = re.compile(r"(?<![\w.~/*-])/(?:home|root|work|Users|mnt)/\S*|\b[A-Z]:\\\S*")
    found = [
        f"{path.relative_to(ROOT)}: {hit}"
        for path in markdown_files()
        for hit in pattern.findall(path.read_text(encoding="utf-8"))
    ]
    assert not found, "\n".join(found)
