"""Form errors in the attributes of a posterior, which commands and designs neglect."""

import json

from pamjax.control.posterior_draws import list_form_errors


def test_only_mechanisms_with_a_form_error_are_listed():
    shares = {"one": {"contact_pressure": 0.3, "braid_friction": 0.0}, "two": {"contact_pressure": 0.1}}
    assert list_form_errors({"form_errors": json.dumps(shares)}) == ("contact_pressure",)
    assert list_form_errors({"form_errors": "{}"}) == ()
    assert list_form_errors({}) == ()
