"""Evidence against the density of a multivariate normal distribution."""

from dataclasses import replace

import numpy as np
import pytest
from scipy.stats import multivariate_normal

from pamjax.diagnosis.evidence.marginal_likelihood import LinearModel, OutsideColumns, compute_evidence
from pamjax.diagnosis.evidence.settings import EvidenceSettings

#: One possible form share and size, so that the evidence is one normal density.
CERTAIN = EvidenceSettings(
    form_shares=(0.3,),
    form_share_probabilities=(1.0,),
    generic_sizes=(2.0,),
    generic_probability=0.5,
    template_probability=0.0,
)


def build_linear_model(rng, size=40, forms=2, generic=3, prior_sd=0.7):
    """Return a model with one parameter of a finite prior, form errors and generic columns."""
    return LinearModel(
        residual=rng.standard_normal(size) * 1.5,
        jacobian=rng.standard_normal((1, size)),
        prior_offset=np.array([0.4]),
        prior_sd=np.array([prior_sd]),
        is_amplitude=np.array([False]),
        amplitude=np.zeros(1),
        forms=[rng.standard_normal((forms, size))],
        outside=OutsideColumns(rng.standard_normal((generic, size))),
    )


def compute_log_density(model, with_generic):
    """Return the log density of residual and prior row; the prior's mean is its offset times its sd."""
    size = model.residual.size
    covariance = np.eye(size) + 0.3**2 * model.forms[0].T @ model.forms[0]
    if with_generic:
        covariance += 2.0**2 * model.outside.generic.T @ model.outside.generic
    covariance += model.prior_sd[0] ** 2 * np.outer(model.jacobian[0], model.jacobian[0])
    mean = model.jacobian[0] * model.prior_offset[0] * model.prior_sd[0]
    return multivariate_normal(mean, covariance).logpdf(model.residual)


@pytest.mark.parametrize("seed", [0, 1, 2])
def test_evidence_is_the_density_of_the_residual(seed):
    model = build_linear_model(np.random.default_rng(seed))
    evidence = compute_evidence(model, 0, CERTAIN)
    constant = 0.5 * model.residual.size * np.log(2 * np.pi)
    for log_evidence, with_generic in ((evidence.alone, False), (evidence.with_generic, True)):
        expected = compute_log_density(model, with_generic) + constant + np.log(0.5)
        assert log_evidence == pytest.approx(expected, abs=1e-6)


def test_each_mechanism_costs_its_prior_probability():
    model = build_linear_model(np.random.default_rng(3))
    total_of_one, total_of_three = (compute_evidence(model, count, CERTAIN).total for count in (1, 3))
    assert total_of_three - total_of_one == pytest.approx(2 * np.log(CERTAIN.mechanism_probability))


def test_shape_of_a_residual_decides_for_or_against_a_form_error():
    rng = np.random.default_rng(4)
    form = np.sin(np.linspace(0, 9, 400))[None] * 10
    settings = EvidenceSettings()
    for coefficient, share in ((0.0, 0.0), (0.4, 0.3)):
        model = LinearModel(
            residual=coefficient * form[0] + rng.standard_normal(400),
            jacobian=np.zeros((0, 400)), prior_offset=np.zeros(0), prior_sd=np.zeros(0),
            is_amplitude=np.zeros(0, bool), amplitude=np.zeros(0),
            forms=[form], outside=OutsideColumns(rng.standard_normal((2, 400))),
        )  # fmt: skip
        evidence = compute_evidence(model, 1, settings)
        assert evidence.form_shares == (share,)
        assert evidence.form_coefficients[0] == pytest.approx([coefficient], abs=0.02)


def test_a_parameter_that_explains_nothing_loses_evidence():
    rng = np.random.default_rng(5)
    model = build_linear_model(rng, size=2000)
    useless = LinearModel(
        residual=model.residual / 1.5,
        jacobian=np.concatenate([model.jacobian, rng.standard_normal((1, 2000))]),
        prior_offset=np.array([0.0, 0.0]), prior_sd=np.array([0.7, np.inf]),
        is_amplitude=np.array([False, True]), amplitude=np.array([0.0, 0.0]),
        forms=model.forms, outside=model.outside,
    )  # fmt: skip
    without = LinearModel(
        useless.residual, model.jacobian, np.zeros(1), np.array([0.7]), np.array([False]), np.zeros(1),
        model.forms, model.outside,
    )  # fmt: skip
    # About ½ ln n = 3.8 less what noise explains by chance.
    loss = compute_evidence(without, 0, CERTAIN).total - compute_evidence(useless, 0, CERTAIN).total
    assert 1.0 < loss < 4.0


def test_evidence_of_a_template_is_that_of_a_model_with_its_column():
    rng = np.random.default_rng(6)
    size, settings = 300, EvidenceSettings()
    templates = [rng.standard_normal((2, size)), rng.standard_normal((1, size))]
    model = replace(
        build_linear_model(rng, size=size),
        outside=OutsideColumns(
            rng.standard_normal((3, size)), templates=templates, template_shares=[0.5, 0.5]
        ),
    )
    for k, template in enumerate(templates):
        with_template = replace(
            model,
            jacobian=np.concatenate([model.jacobian, template]),
            prior_offset=np.append(model.prior_offset, np.zeros(len(template))),
            prior_sd=np.append(model.prior_sd, np.full(len(template), np.inf)),
            is_amplitude=np.append(model.is_amplitude, np.ones(len(template), bool)),
            amplitude=np.append(model.amplitude, np.zeros(len(template))),
        )
        fixed = replace(settings, form_shares=(0.2,), form_share_probabilities=(1.0,))
        expected = compute_evidence(with_template, 1, fixed).alone
        expected += np.log(0.5 * settings.template_probability)
        expected -= np.log(1 - settings.generic_probability - settings.template_probability)
        assert compute_evidence(model, 1, fixed).with_templates[k] == pytest.approx(expected, abs=1e-5)
