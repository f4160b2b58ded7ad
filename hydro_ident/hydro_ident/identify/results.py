"""Result files of identification, written together or not at all."""

from __future__ import annotations

import json
import os
import shutil
import tempfile
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

from hydro_ident.errors import IdentError
from hydro_ident.estimate.flows.summed_flow import summed_dict
from hydro_ident.identify.consistent_robot import physical_dict
from hydro_ident.identify.estimator_choice import Chosen
from hydro_ident.identify.identification import Identification
from hydro_ident.identify.validation_results import (
    channel_rollout,
    comparison_dict,
    free_run_dict,
)
from hydro_ident.json_numbers import finite
from hydro_ident.parameters.parameters import Parameter
from hydro_model.command_line.output import unwritable
from hydro_model.description.safe_yaml import parse

SCHEMA = "hydro_ident/identification/1"
RESULT_FILE, REPORT_FILE = "result.json", "report.html"
MODEL_FILE, CONTROLLER_FILE = "model.yaml", "controller.yaml"
URDF_FILE = "identified.urdf"
#: Everything the command may write: what a run leaves out is removed with the old result.
OWN_FILES = (RESULT_FILE, REPORT_FILE, MODEL_FILE, CONTROLLER_FILE, URDF_FILE)


#: What the estimators of the force channels do, in words.
METHODS = {
    "ols": "ordinary least squares",
    "wls": "least squares, each channel of each bag weighted by its residual",
    "robust": "as wls, with Tukey's biweight on the residuals and outliers cleaned away",
    "iv": "as wls, with the recorded references as instruments",
}


@dataclass(frozen=True, slots=True)
class Provenance:
    """Where a result comes from.

    Attributes
    ----------
    command : str
    version : str
        Of hydro_ident.
    robot : str
        The robot that was given, as given.
    bags, validation : mapping of str to str
        Bag name and the SHA-256 of its files.
    robot_files : mapping of str to str
        The robot's files by name, with their SHA-256: hydraulics or model, and URDF.
    compared : mapping of str to str
        The same of an earlier model that this was compared with.
    """

    command: str
    version: str
    robot: str
    bags: Mapping[str, str]
    validation: Mapping[str, str]
    robot_files: Mapping[str, str] = field(default_factory=dict)
    compared: Mapping[str, str] = field(default_factory=dict)

    def as_dict(self) -> dict[str, Any]:
        """For the result file and the model file."""
        return {
            "command": self.command,
            "version": self.version,
            "robot": self.robot,
            "robot_files": _hashes(self.robot_files),
            "bags": _hashes(self.bags),
            "validation": _hashes(self.validation),
            "compared": _hashes(self.compared),
        }


def _hashes(files: Mapping[str, str]) -> list[dict[str, str]]:
    return [{"name": name, "sha256": digest} for name, digest in files.items()]


def result_dict(found: Identification, origin: Provenance) -> dict[str, Any]:
    """The content of result.json.

    Parameters
    ----------
    found : Identification
    origin : Provenance

    Returns
    -------
    dict
        The contract's keys; `training` (scores on the rows fitted), `recordings`, `problems`,
        `notes`, `estimator`, `method` and `provenance` are added,
        and to a parameter `held`, `model_error` (physics is left out of its channels), `dof` and
        `reason`. What was held, or has no data that bear on it, is without `std` and `ci95`.
    """
    settings = found.settings
    data = {
        "schema": SCHEMA,
        "verdict": found.verdict,
        "robot": found.given.name,
        "parameters": [_parameter_dict(p) for p in found.parameters],
        "channels": _channels(found),
        "training": {channel.name: channel.summary() for channel in found.fitted},
        "recordings": [one.as_dict() for one in found.recordings],
        "losses": [
            {"bag": loss.bag, "channel": loss.channel, "reason": loss.reason}
            for loss in found.losses
        ],
        "free_run": free_run_dict(found.free_run),
        "physical": physical_dict(found.physical),
        "summed_flow": {c.cylinder: summed_dict(c) for c in found.summed},
        "problems": list(found.problems),
        "notes": list(found.notes),
        "estimator": _estimator_dict(found.estimator),
        "method": {
            "force": METHODS["wls" if found.estimator is None else found.estimator.name],
            "flow": "integrated mass balance per chamber, chambers combined by information",
            "covariance": (
                "autoregressive noise per channel, Student's t (Satterthwaite);"
                " in forces, zeros of pressure transducers too"
            ),
            "differentiation_hz": settings.filters.differentiation_hz,
            "parallel_filter_hz": settings.filters.parallel_hz,
            "filter_order": settings.filters.order,
            "window_s": settings.windows.length_s,
        },
        "provenance": origin.as_dict(),
    }
    if found.comparison is not None:
        data["compare"] = comparison_dict(found.comparison)
    return data


def _channels(found: Identification) -> dict[str, Any]:
    """Scores by channel, each with its joint's roll-outs."""
    return {
        channel.name: {**channel.summary(), **channel_rollout(found.free_run, channel.name)}
        for channel in found.channels
    }


def _estimator_dict(chosen: Chosen | None) -> dict[str, str]:
    return {} if chosen is None else {"name": chosen.name, "reason": chosen.reason}


def _parameter_dict(p: Parameter) -> dict[str, Any]:
    row: dict[str, Any] = {
        "name": p.name,
        "value": p.value,
        "std": None if p.untold else finite(p.std),
        "ci95": None if p.ci95 is None else [finite(bound) for bound in p.ci95],
        "unit": p.unit,
        "datasheet": p.datasheet,
        "identifiable": p.identifiable,
        "held": p.held,
        "model_error": p.model_error,
        "dof": finite(p.dof),
    }
    if p.combination:
        row["combination"] = dict(p.combination)
    if p.reason:
        row["reason"] = p.reason
    return row


def result_json(found: Identification, origin: Provenance) -> str:
    """result.json as text: the same input gives the same text.

    `origin` says where the numbers come from.
    """
    return json.dumps(result_dict(found, origin), indent=1, allow_nan=False) + "\n"


def write_together(
    folder: Path, fill: Callable[[Path], None], own: Sequence[str] = OWN_FILES
) -> None:
    """Write a folder's files so that a failure leaves what was there before.

    Everything is written into a new folder beside it first. A new `folder` is then that folder
    renamed; into one that exists, the files are moved one by one, the result itself last, which
    is not there meanwhile. Files of `own` that this run did not write are removed, so that no old
    model stands beside a new verdict, and with the model the URDF that was copied beside it.

    Parameters
    ----------
    folder : Path
    fill : callable
        Writes the files into the folder it is given.
    own : sequence of str
        Names that belong to one result, the result itself first.

    Raises
    ------
    IdentError
        The folder cannot be written.
    """
    folder = folder.absolute()
    if folder.exists() and not folder.is_dir():
        raise IdentError(f"{folder}: expected a folder to write into, found a file")
    try:
        folder.parent.mkdir(parents=True, exist_ok=True)
        fresh = Path(tempfile.mkdtemp(prefix=f".{folder.name}.", dir=folder.parent))
    except OSError as error:
        raise IdentError(unwritable(folder, error)) from error
    try:
        fill(fresh)
        _move(fresh, folder, own)
    except OSError as error:
        raise IdentError(unwritable(folder, error)) from error
    finally:
        shutil.rmtree(fresh, ignore_errors=True)


def _move(fresh: Path, folder: Path, own: Sequence[str]) -> None:
    # mkdtemp makes private folders; results are as readable as anything else the user writes.
    mask = os.umask(0)
    os.umask(mask)
    fresh.chmod(0o777 & ~mask)
    if not folder.exists():
        fresh.rename(folder)
        return
    written = {file.name for file in fresh.iterdir()}
    old = _copied_urdf(folder, own)
    # Whoever finds a result finds all of it, and no part of another.
    result = next(iter(own), None)
    for name in own:
        if name not in written or name == result:
            (folder / name).unlink(missing_ok=True)
    if old is not None and old.name not in written:
        old.unlink(missing_ok=True)
    for name in sorted(written, key=lambda name: (name == result, name)):
        os.replace(fresh / name, folder / name)


def _copied_urdf(folder: Path, own: Sequence[str]) -> Path | None:
    """The URDF that stands beside the old model; None where it may be anything else's, too."""
    model = folder / MODEL_FILE
    if MODEL_FILE not in own or not model.is_file():
        return None
    # Of a folder with robot files of the user's own it is these files' URDF.
    if any(f.suffix in (".yaml", ".yml") and f.name not in own for f in folder.iterdir()):
        return None
    try:
        told = parse(model.read_text(encoding="utf-8"))
    except ValueError:
        return None
    name = str(told.get("urdf", "")) if isinstance(told, dict) else ""
    beside = Path(name).name == name and Path(name).suffix == ".urdf"
    return folder / name if beside else None


def write_outcome(
    folder: Path, result: str, report: str | None, write_robot: Callable[[Path], None] | None
) -> None:
    """Write the files of an identification or a diagnosis, or none.

    Parameters
    ----------
    folder : Path
    result : str
        Text of `result.json`.
    report : str or None
        Of `report.html`; None where what draws it is not installed.
    write_robot : callable or None
        Writes `model.yaml` and what else belongs to it into a folder; None where no robot was
        found, and then there is no `controller.yaml` either.

    Raises
    ------
    IdentError
        The folder cannot be written; what was there stays.
    """
    from hydro_ident.identify.controller_file import controller_text

    def fill(fresh: Path) -> None:
        (fresh / RESULT_FILE).write_text(result, encoding="utf-8")
        if report is not None:
            (fresh / REPORT_FILE).write_text(report, encoding="utf-8")
        if write_robot is not None:
            write_robot(fresh)
            text = controller_text(folder / MODEL_FILE)
            (fresh / CONTROLLER_FILE).write_text(text, encoding="utf-8")

    write_together(folder, fill)
