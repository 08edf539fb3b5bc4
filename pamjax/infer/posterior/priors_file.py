"""Reader of a TOML file with priors that replace those of muscle.toml and of mechanisms.

["thread.modulus"]
value = "90 GPa"
sd = "10 GPa"
low = "50 GPa"      # each entry is optional; bounds must be within the physical ones
"""

from __future__ import annotations

from pathlib import Path
from typing import Any

from pamjax.errors import BadInput, suggest_word
from pamjax.infer.posterior.ar1_likelihood import find_noise_units
from pamjax.model.parameters import find_meaning
from pamjax.parameter import Meaning
from pamjax.records.files import read_bytes
from pamjax.records.toml_text import parse_toml
from pamjax.units import format_quantity, parse_number

_PRIOR_KEYS = ("value", "sd", "low", "high")


def read_priors(path: Path) -> dict[str, dict[str, float]]:
    """Return the priors by name, SI.

    Raises:
        BadInput: if the file cannot be read, or has an unknown parameter or entry, or a wrong unit.
    """
    document = parse_toml(read_bytes(path), path.name)
    return {name: _parse_prior(name, entries, path.name) for name, entries in document.items()}


def _parse_prior(name: str, entries: Any, file: str) -> dict[str, float]:
    if not isinstance(entries, dict) or any(isinstance(v, dict) for v in entries.values()):
        remedy = f'Write ["{name}...."] with the quotes, then value and sd.'
        raise BadInput.from_rule(
            "a prior is a table with the name of its parameter in quotes", f"{name}", file, remedy
        )
    meaning = _find_meaning(name)
    prior = {}
    for key, text in entries.items():
        if key not in _PRIOR_KEYS:
            raise BadInput.from_rule(
                f"a prior has no entry {key!r}", f"[{name}]", file, suggest_word(key, _PRIOR_KEYS)
            )
        prior[key] = parse_number(str(text), meaning.unit, f"[{name}] of {file}")
    if not prior.get("sd", 1.0) > 0:
        raise BadInput.from_rule(
            "`sd` of a prior must be positive",
            format_quantity(prior["sd"], meaning.show),
            f"[{name}] of {file}",
        )
    return prior


def _find_meaning(name: str) -> Meaning:
    """Return a parameter's meaning; for noise only its unit."""
    bare = name.rpartition("/")[2]
    if bare.startswith("noise."):
        return Meaning(*find_noise_units(bare), 0.0, 1.0, "linear", "", "")
    return find_meaning(bare)
