"""The platform on which JAX computes, chosen before JAX is loaded."""

from __future__ import annotations

from collections.abc import Mapping


def choose_platform(variables: Mapping[str, str]) -> dict[str, str]:
    """Return the environment variables that let JAX use the CPU; none if the user chose a platform.

    A command runs many small programs, which are slower on a GPU. On a GPU, JAX also reserves three quarters
    of its memory for each process.

    Args:
        variables: the environment.

    >>> choose_platform({})
    {'JAX_PLATFORMS': 'cpu'}
    >>> choose_platform({"JAX_PLATFORMS": "cuda"})
    {}
    """
    is_chosen = "JAX_PLATFORMS" in variables or "JAX_PLATFORM_NAME" in variables
    return {} if is_chosen else {"JAX_PLATFORMS": "cpu"}
