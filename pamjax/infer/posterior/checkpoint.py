"""Checkpoint of a chain on disk, safe against interruption at any time.

A folder contains `identity.json`, `start.npz` and the chunks `draws-000000.npz`, … . Every file is written
atomically. A chunk contains the sampler's state after it, so a resumed chain equals an uninterrupted one.
The HDF file of emcee is not used, because an interrupted write can damage it.
"""

from __future__ import annotations

import hashlib
import json
from collections.abc import Mapping, Sequence
from importlib.metadata import version
from pathlib import Path
from typing import Any

import numpy as np

from pamjax.errors import BadInput
from pamjax.infer.problem.parameter_space import ParameterSpace
from pamjax.records.case import Case
from pamjax.records.files import write_atomically

_CHAIN_SCHEMA = "pamjax.chain/1"

Arrays = dict[str, np.ndarray]


def build_identity(
    cases: Sequence[Case],
    space: ParameterSpace,
    law: str,
    mechanisms: Sequence[str],
    priors: Mapping[str, Mapping[str, Any]],
    sampler: str,
    seed: int,
    form_shares: Mapping[str, Mapping[str, float]],
) -> dict[str, Any]:
    """Return the identity of a chain: data, model, priors, sampler and seed.

    Args:
        cases, space, law, mechanisms: as in the fit.
        priors: priors that replace those of the fit.
        sampler, seed: of the chain.
        form_shares: by case, the sizes of the form errors by mechanism; empty for exact equations.
    """
    prior_arrays = [
        [float(f"{v:.12g}") for v in np.asarray(a)] for a in (space.low, space.high, space.mean, space.sd)
    ]
    return {
        "schema": _CHAIN_SCHEMA,
        "pamjax": version("pamjax"),
        "data": {case.name: case.checksum for case in cases},
        "model": {
            "law": law,
            "mechanisms": list(mechanisms),
            "numbers": list(space.names),
            "memory": {case.name: [case.gaps, case.before] for case in cases},
            "form_errors": {name: dict(shares) for name, shares in form_shares.items()},
        },
        "priors": hashlib.sha256(json.dumps([prior_arrays, priors], sort_keys=True).encode()).hexdigest(),
        "sampler": sampler,
        "seed": seed,
    }


class Checkpoint:
    """The folder of one chain.

    Args:
        folder: the folder; None saves nothing.
        identity: identity of the chain, see `build_identity`.

    Raises:
        BadInput: if the folder contains another chain.
    """

    def __init__(self, folder: Path | None, identity: dict[str, Any]) -> None:
        self.folder = folder
        if folder is None:
            return
        folder.mkdir(parents=True, exist_ok=True)
        identity_file = folder / "identity.json"
        if identity_file.exists():
            _check_identity(json.loads(identity_file.read_text(encoding="utf-8")), identity, folder)
        else:
            with write_atomically(identity_file) as path:
                path.write_text(json.dumps(identity, indent=2) + "\n", encoding="utf-8")

    def read_start(self) -> Arrays | None:
        """Return the saved start of the chain, or None."""
        return None if self.folder is None else _read_arrays(self.folder / "start.npz")

    def write_start(self, arrays: Arrays) -> None:
        """Save the start of the chain."""
        self._write_arrays("start", arrays)

    def read_draws(self) -> tuple[list[Arrays], Arrays | None]:
        """Return every saved chunk of draws, and the sampler's state after the last."""
        chunks: list[Arrays] = []
        state = None
        while (
            self.folder is not None
            and (content := _read_arrays(self.folder / _format_chunk_name(len(chunks)))) is not None
        ):
            chunks.append({k: v for k, v in content.items() if not k.startswith("state_")})
            state = {k.removeprefix("state_"): v for k, v in content.items() if k.startswith("state_")}
        return chunks, state

    def save_chunk(self, number: int, draws: Arrays, state: Arrays) -> None:
        """Save a chunk of draws with the state after it."""
        self._write_arrays(
            _format_chunk_name(number).removesuffix(".npz"),
            draws | {f"state_{k}": v for k, v in state.items()},
        )

    def _write_arrays(self, name: str, arrays: Arrays) -> None:
        if self.folder is None:
            return
        with write_atomically(self.folder / f"{name}.npz") as path, path.open("wb") as file:
            np.savez(file, **arrays)  # pyright: ignore[reportArgumentType]


def _format_chunk_name(number: int) -> str:
    return f"draws-{number:06d}.npz"


def _read_arrays(path: Path) -> Arrays | None:
    if not path.exists():
        return None
    with np.load(path) as file:
        return dict(file)


def _check_identity(saved_identity: dict[str, Any], expected: dict[str, Any], folder: Path) -> None:
    for key, value in expected.items():
        if saved_identity.get(key) != value:
            differences = {"data": "another recording", "model": "another model", "priors": "other priors"}
            rule = f"a saved chain can only be resumed with the same {key}"
            remedy = "Use another `--out`, or delete that folder to start a new chain."
            raise BadInput.from_rule(
                rule, differences.get(key, f"{saved_identity.get(key)!r}, not {value!r}"), str(folder), remedy
            )
