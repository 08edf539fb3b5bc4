"""Results that are kept as long as their fit."""

import gc
import weakref

from pamjax.diagnosis.refit.memoise import memoise_per_fit
from tests.diagnosis.plain_fits import build_fit

calls = []


@memoise_per_fit(lambda k: k)
def count(problem, fit, k):
    calls.append(k)
    return fit if k == 0 else build_fit(n=k)


def test_each_result_is_computed_once_for_each_fit():
    calls.clear()
    first, second = build_fit(), build_fit()
    assert count(None, first, 2) is count(None, first, 2)
    assert count(None, first, 3) is not count(None, first, 2)
    assert count(None, second, 2) is not count(None, first, 2)
    assert calls == [2, 3, 2]


def test_a_fit_is_not_kept_alive_by_its_results():
    fit = build_fit()
    assert count(None, fit, 0) is fit
    assert count(None, fit, 0) is fit
    count(None, fit, 2)
    reference = weakref.ref(fit)
    del fit
    gc.collect()
    assert reference() is None
