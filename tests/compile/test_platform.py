"""JAX uses the CPU, unless the user chose a platform."""

import pytest

from pamjax.compile.platform import choose_platform


@pytest.mark.parametrize(
    ("variables", "added"),
    [
        ({}, {"JAX_PLATFORMS": "cpu"}),
        ({"PATH": "/bin"}, {"JAX_PLATFORMS": "cpu"}),
        ({"JAX_PLATFORMS": "cuda"}, {}),
        ({"JAX_PLATFORMS": ""}, {}),
        ({"JAX_PLATFORM_NAME": "cuda"}, {}),
    ],
)
def test_choice_of_the_user_is_kept(variables, added):
    assert choose_platform(variables) == added
