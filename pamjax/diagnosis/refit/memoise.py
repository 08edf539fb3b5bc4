"""Results of functions of a fit, computed once: the steps of a diagnosis ask for the same refits."""

from __future__ import annotations

import functools
import weakref
from collections.abc import Callable, Hashable
from typing import Any, TypeVar, cast
from weakref import WeakKeyDictionary

from pamjax.diagnosis.library.library_problem import LibraryProblem
from pamjax.diagnosis.refit.model_fit import ModelFit

FitFunction = TypeVar("FitFunction", bound=Callable[..., Any])


def memoise_per_fit(key: Callable[..., Hashable]) -> Callable[[FitFunction], FitFunction]:
    """Return a decorator that keeps the results of a function of a problem and a fit while the fit exists.

    The problem is not part of the key: a fit belongs to the one problem from which it was computed.

    Args:
        key: returns what the result depends on besides the fit, from the arguments after the fit.
    """

    def decorate(function: FitFunction) -> FitFunction:
        results: WeakKeyDictionary[ModelFit, dict[Hashable, Callable[[], Any]]] = WeakKeyDictionary()

        @functools.wraps(function)
        def call_once(problem: LibraryProblem, fit: ModelFit, *args):
            results_of_fit, name = results.setdefault(fit, {}), key(*args)
            if name not in results_of_fit:
                result = function(problem, fit, *args)
                # A fit that is its own result must not keep itself alive.
                results_of_fit[name] = weakref.ref(fit) if result is fit else lambda: result
            return results_of_fit[name]()

        return cast(FitFunction, call_once)

    return decorate
