"""Writes `controller.yaml`: the ROS parameters that run the controller on an identified model."""

from __future__ import annotations

from dataclasses import asdict
from pathlib import Path

import yaml

from hydro_control.gains import Gains

NODE = "controller"


def controller_text(model: Path, gains: Gains | None = None) -> str:
    """The content of a controller file.

    Parameters
    ----------
    model : Path
        Of the model file; made absolute, since ROS parameters know no file of their own.
    gains : Gains, optional
        The controller's defaults.

    Returns
    -------
    str
        A ROS parameters file: gains and the path of the model, nothing twice.
    """
    values = {name: float(value) for name, value in asdict(gains or Gains()).items()}
    parameters = {NODE: {"ros__parameters": {"robot": str(model.absolute()), **values}}}
    head = (
        "# Written by hydro_ident, for `hydro_control controller --ros-args --params-file FILE`.\n"
        "# Gains are the package's defaults: a machine that was driven with its own goes on with"
        " its own\n# file, and with this model by `-p robot:=`.\n"
    )
    return head + yaml.safe_dump(parameters, sort_keys=False)
