"""calibration.json, in which an identified robot travels."""

import json
from collections.abc import Mapping
from dataclasses import asdict
from hashlib import sha256
from importlib.metadata import version
from pathlib import Path
from typing import Any, Literal

import numpy as np
from jaxtyping import Float
from pydantic import BaseModel, ConfigDict, ValidationError

from identify.model.calibration import (
    FACE,
    Calibration,
    Discrepancy,
    Errors,
    Finding,
    Residual,
    SharedValue,
    Term,
    fingerprints,
    summarize,
)
from identify.model.files import InputError, Mistake, read_text, write_text
from identify.model.io.entries import cell_entry, cell_from_entry

__all__ = [
    "Calibration",
    "Discrepancy",
    "Errors",
    "Finding",
    "Residual",
    "SharedValue",
    "Term",
    "calibration_entry",
    "fingerprints",
    "read_calibration",
    "summarize",
    "write_calibration",
]
FORMAT = 2  # of calibration.json; a file without a number is of the first version
UNITS = {"mm": 1.0, "deg": np.pi / 180}


class _Strict(BaseModel):
    model_config = ConfigDict(extra="forbid", allow_inf_nan=False)


class _Parameter(_Strict):
    name: str
    unit: str
    nominal: float
    value: float
    sigma: float
    status: Literal["estimated", "eliminated", "fixed"]
    combination: dict[str, float]


class _Face(_Strict):
    name: str
    offset_mm: float
    sigma: float


class _Shared(_Strict):
    name: str
    unit: Literal["mm", "deg"]
    value: float
    sigma: float
    prior: float


class _File(_Strict):
    """calibration.json."""

    format: Literal[1, 2] = 1
    touchcal: str
    inputs: dict[str, str]
    cell: dict[str, Any]
    parameters: list[_Parameter]
    covariance: list[list[float]]
    scatter: float
    scatter_significant: bool
    fit: Errors
    held_out: Errors | None
    outliers: dict[str, float]
    weak: list[str]
    residuals: dict[str, Residual]
    fingerprints: list[str]
    iterations: int
    solve_s: float
    choice: list[Term] = []
    findings: list[Finding] = []
    sources: dict[str, str]
    faces: list[_Face] = []
    shared: list[_Shared] = []
    discrepancy: Discrepancy | None = None
    promise: dict[str, float] | None = None
    spans: dict[str, tuple[float, float]] = {}
    checksums: dict[str, str] = {}


def write_calibration(path: Path | str, calibration: Calibration) -> None:
    """Write calibration.json, whole or not at all."""
    path = Path(path)
    entry = json.loads(json.dumps(calibration_entry(calibration)))
    write_text(path, json.dumps(entry | {"checksums": _checksums(entry)}, indent=1) + "\n")


def _checksums(entry: Mapping[str, Any]) -> dict[str, str]:
    """Eight digits for what stands at each key."""
    return {key: sha256(json.dumps(value, sort_keys=True).encode()).hexdigest()[:8] for key, value in entry.items()}


def _require_unedited(path: Path, entry: dict[str, Any]) -> None:
    """Raise InputError, naming the keys, if a hand has changed a file that holds checksums."""
    stated = entry.pop("checksums", {})
    now = _checksums(entry)
    edited = [key for key in stated | now if stated.get(key) != now.get(key)] if stated else []
    if edited:
        raise _wrong(
            path,
            f"{', '.join(edited)} changed since touchcal wrote the file: its numbers no longer belong together; "
            "identify again, or delete the key checksums if you answer for the change",
        )


def calibration_entry(c: Calibration) -> dict[str, Any]:
    """What calibration.json holds, in file units."""
    unit = c.cell.robot.parameter_unit()
    robot = c.cell.robot
    columns = zip(robot.parameters, robot.units, c.start / unit, c.theta / unit, c.sigma / unit, strict=True)
    scale = np.concatenate([unit[c.index], [UNITS[shared.unit] for shared in c.shared]])
    C = (c.joint_covariance + c.joint_covariance.T) / 2 / np.outer(scale, scale)
    parameters = [
        _Parameter(
            name=name,
            unit=unit_name,
            nominal=float(nominal),
            value=float(value),
            sigma=float(sigma),
            status=c.status(name),
            combination=dict(c.combinations.get(name, {})),
        )
        for name, unit_name, nominal, value, sigma in columns
    ]
    return {
        "format": FORMAT,
        "touchcal": version("touchcal"),
        "inputs": dict(c.inputs),
        "cell": cell_entry(c.cell),
        "parameters": [parameter.model_dump() for parameter in parameters],
        "covariance": C.tolist(),
        **_shared_entry(c, np.sqrt(np.diag(C))[len(c.estimated) :]),
        "discrepancy": None if c.discrepancy is None else asdict(c.discrepancy),
        "promise": None if c.promise is None else dict(c.promise),
        "spans": {name: list(span) for name, span in c.spans.items()},
        "scatter": c.scatter,
        "scatter_significant": c.scatter_significant,
        "fit": asdict(c.fit),
        "held_out": None if c.held_out is None else asdict(c.held_out),
        "outliers": dict(c.outliers),
        "weak": list(c.weak),
        "residuals": {name: asdict(residual) for name, residual in c.residuals.items()},
        "fingerprints": sorted(c.fingerprints),
        "iterations": c.iterations,
        "solve_s": c.solve_s,
        "choice": [asdict(term) for term in c.choice],
        "findings": [asdict(finding) for finding in c.findings],
        "sources": dict(c.cell.sources),
    }


def _shared_entry(c: Calibration, sigma: Float[np.ndarray, " shared"]) -> dict[str, list[dict[str, Any]]]:
    """What measurements share, in file units; the offsets of faces once more by the names of the faces."""
    values = [shared.value / UNITS[shared.unit] for shared in c.shared]
    shared = [
        _Shared(name=s.name, unit=s.unit, value=value, sigma=float(deviation), prior=s.scale / UNITS[s.unit])
        for s, value, deviation in zip(c.shared, values, sigma, strict=True)
    ]
    faces = [
        _Face(name=s.name.removeprefix(FACE), offset_mm=s.value, sigma=s.sigma)
        for s in shared
        if s.name.startswith(FACE) and s.name.removeprefix(FACE) in (c.cell.jig.by_name if c.cell.jig else {})
    ]
    return {"faces": [face.model_dump() for face in faces], "shared": [entry.model_dump() for entry in shared]}


def read_calibration(path: Path | str) -> Calibration:
    """Read calibration.json, of this version or of the first; raises InputError if it is not one."""
    path = Path(path)
    text = read_text(path)
    try:
        file = _File.model_validate_json(text)
        cell = cell_from_entry(file.cell, file.sources)
    except ValidationError as error:
        first = error.errors()[0]
        where = ".".join(str(part) for part in first["loc"]) or "the file"
        raise _wrong(path, f"not a calibration: {where}: {first['msg']}") from None
    except InputError as error:
        raise _wrong(path, f"not a calibration: {error}") from None
    if [p.name for p in file.parameters] != list(cell.robot.parameters):
        raise _wrong(path, "its parameters are not those of its robot")
    unit = cell.robot.parameter_unit()
    estimated = tuple(p.name for p in file.parameters if p.status == "estimated")
    own = unit[[p.status == "estimated" for p in file.parameters]]
    scale = np.concatenate([own, [UNITS[shared.unit] for shared in file.shared]])
    covariance = _covariance(path, file.covariance, len(scale)) * np.outer(scale, scale)
    _require_unedited(path, json.loads(text))
    return Calibration(
        cell=cell,
        theta=np.array([p.value for p in file.parameters]) * unit,
        start=np.array([p.nominal for p in file.parameters]) * unit,
        estimated=estimated,
        combinations={p.name: p.combination for p in file.parameters if p.status == "eliminated"},
        covariance=covariance[: len(own), : len(own)],
        shared=tuple(
            SharedValue(s.name, s.unit, s.value * UNITS[s.unit], s.prior * UNITS[s.unit]) for s in file.shared
        ),
        shared_covariance=covariance[len(own) :],
        discrepancy=file.discrepancy,
        promise=file.promise,
        spans=file.spans,
        scatter=file.scatter,
        scatter_significant=file.scatter_significant,
        weak=tuple(file.weak),
        outliers=file.outliers,
        fit=file.fit,
        held_out=file.held_out,
        residuals=file.residuals,
        fingerprints=frozenset(file.fingerprints),
        iterations=file.iterations,
        solve_s=file.solve_s,
        choice=tuple(file.choice),
        findings=tuple(file.findings),
        inputs=file.inputs,
    )


def _covariance(path: Path, rows: list[list[float]], size: int) -> Float[np.ndarray, "estimated estimated"]:
    """The covariance of a file, in file units."""
    if len(rows) != size or any(len(row) != size for row in rows):
        widths = " or ".join(map(str, sorted({len(row) for row in rows}))) or "0"
        raise _wrong(path, f"its covariance is {len(rows)} x {widths}, expected {size} x {size}, a row a parameter")
    C = np.array(rows).reshape(size, size)
    if not np.allclose(C, C.T, rtol=1e-6, atol=0) or (size and np.linalg.eigvalsh(_correlation(C))[0] < -1e-6):
        raise _wrong(path, "its covariance is not one: variances and covariances do not fit each other")
    return C


def _correlation(C: Float[np.ndarray, "size size"]) -> Float[np.ndarray, "size size"]:
    """A covariance in units of its deviations; one that is none where a variance is not above 0."""
    deviation = np.sqrt(np.maximum(np.diag(C), 0.0))
    return C / deviation / deviation[:, None] if (deviation > 0).all() else -np.eye(len(C))


def _wrong(path: Path, text: str) -> InputError:
    return InputError([Mistake(str(path), 0, f"{text}; make it again with touchcal identify")])
