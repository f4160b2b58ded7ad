"""Which robots are inside the package. Imports nothing heavy: tab completion waits for it."""

from __future__ import annotations

from importlib import resources
from pathlib import Path


def shipped_robots() -> dict[str, Path]:
    """Robots inside the package: name -> path of the hydraulics file."""
    folder = Path(str(resources.files("hydro_model"))) / "robots"
    return {p.name.split(".")[0]: p for p in sorted(folder.glob("*/*.hydraulics.yaml"))}
