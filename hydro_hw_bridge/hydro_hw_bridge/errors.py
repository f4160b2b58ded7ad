"""What the bridge and its commands raise on purpose."""

from __future__ import annotations

from hydro_model.errors import HydroError


class BridgeError(HydroError):
    """A bus, file, parameter or machine that the bridge cannot work with."""


class CalibrationError(BridgeError):
    """A calibration that the machine's answers do not support."""

    exit_code = 1
