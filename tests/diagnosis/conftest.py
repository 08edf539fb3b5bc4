"""Method of the diagnoses of the bank."""

import pytest


@pytest.fixture
def method(pytestconfig):
    """Return the method of `--diagnosis-method`; without this option, that of a diagnosis that names none."""
    # Not at the top: the cache folder of the tests must be set before.
    from tests.diagnosis.bank import DEFAULT_METHOD

    return pytestconfig.getoption("diagnosis_method") or DEFAULT_METHOD
