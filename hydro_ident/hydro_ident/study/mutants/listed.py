"""What is changed, and the tests that have to notice."""

from __future__ import annotations

from dataclasses import dataclass

_TEST = "hydro_hw_bridge/test"


@dataclass(frozen=True, slots=True)
class Target:
    """A module whose tests are tried.

    Attributes
    ----------
    name : str
    module : str
        As it is imported.
    tests : tuple of str
        Files or folders, from the repository's top.
    """

    name: str
    module: str
    tests: tuple[str, ...]

    @property
    def file(self) -> str:
        """From the repository's top."""
        return f"{self.module.partition('.')[0]}/{self.module.replace('.', '/')}.py"


@dataclass(frozen=True, slots=True)
class Harmless:
    """A change that no test can or need notice.

    Attributes
    ----------
    target : str
        Name of the module's target.
    where : str
        Class and function.
    before, after : str
    why : str
    """

    target: str
    where: str
    before: str
    after: str
    why: str


TARGETS: tuple[Target, ...] = (
    Target("gate", "hydro_hw_bridge.gate", (f"{_TEST}/gate",)),
    Target(
        "plausibility",
        "hydro_hw_bridge.plausibility",
        (f"{_TEST}/test_plausibility.py", f"{_TEST}/test_plausibility_limits.py"),
    ),
    Target(
        "bridge_core",
        "hydro_hw_bridge.bridge_core",
        (f"{_TEST}/test_bridge_core.py", f"{_TEST}/test_watchdogs.py"),
    ),
    Target("link", "hydro_hw_bridge.link", (f"{_TEST}/test_watchdogs.py",)),
    Target("amplifier", "hydro_hw_bridge.rig.amplifier", (f"{_TEST}/test_rig_amplifier.py",)),
)
