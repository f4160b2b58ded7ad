"""What this package raises on purpose."""

from __future__ import annotations

from hydro_model.errors import HydroError


class ControlError(HydroError):
    """A controller that cannot be set up as asked, or a reference that it refuses."""
