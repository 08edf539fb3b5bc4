"""Comparison of templates with the rest of a model, against dense least squares."""

import math

import numpy as np
import pytest

from pamjax.diagnosis.templates.template_fits import compute_cost_reductions, compute_explained_chi2
from pamjax.diagnosis.templates.templates import Template
from tests.agreement import SOLVED, agree
from tests.diagnosis.plain_fits import build_fit

N = 60
PRIOR_SD = np.array([0.5, 30.0])


def build_template(*shapes, share=1.0):
    """Return a template of force alone."""
    columns = np.stack([np.stack([shape, np.zeros(N)]) for shape in shapes])
    return Template("example", "an example", columns, share)


@pytest.fixture
def fit():
    """Return the best fit of two parameters to a force with white noise of 1 N."""
    rng = np.random.default_rng(7)
    residual, jacobian = 3 * rng.standard_normal(N), rng.standard_normal((N, 2))
    values = np.linalg.solve(jacobian.T @ jacobian + np.diag(PRIOR_SD**-2), jacobian.T @ residual)
    return build_fit(
        values, (0, 1), n=N, residual=residual - jacobian @ values, jacobian=jacobian, prior_sd=PRIOR_SD
    )


def test_explained_chi2_is_that_of_dense_least_squares(fit):
    """The comparison frees the parameters, with their priors, and the sizes of the template."""
    estimate = fit.estimate
    shapes = np.random.default_rng(8).standard_normal((2, N))
    design = np.block([[estimate.jacobian, shapes.T], [np.diag(1 / PRIOR_SD), np.zeros((2, 2))]])
    target = np.concatenate([estimate.residual, -estimate.values / PRIOR_SD])
    sizes = np.linalg.lstsq(design, target, rcond=None)[0]
    expected = np.sum(target**2) - np.sum((target - design @ sizes) ** 2)
    agree(compute_explained_chi2(fit, [build_template(*shapes)])[0], expected, SOLVED, N)


def test_a_template_that_the_parameters_imitate_explains_nothing(fit):
    template = build_template(fit.estimate.jacobian[:, 1])
    assert compute_explained_chi2(fit, [template])[0] < 0


def test_one_of_many_places_costs_more(fit):
    shape = np.random.default_rng(9).standard_normal(N)
    templates = [build_template(shape), build_template(shape, share=1 / 24)]
    first, second = compute_cost_reductions(fit, templates)
    agree(first - second, 2 * math.log(24), SOLVED)
    agree(compute_explained_chi2(fit, templates)[0] - first, math.log(N), SOLVED)
