"""What this package raises on purpose."""

from __future__ import annotations

from hydro_model.errors import HydroError


class ContractError(HydroError):
    """What is not as the contract between the packages has it: messages, parameters, files."""
