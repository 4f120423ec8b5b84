"""What is said where an extra is not installed."""

import pytest

from rimless_gym.checks import MissingExtraError, extra


def test_a_missing_package_is_named_with_the_extra_that_brings_it():
    told = r"no_such_package .* 'rimless-gym\[learn\]'"
    with pytest.raises(MissingExtraError, match=told), extra("learn"):
        import no_such_package  # noqa: F401


def test_the_innermost_extra_is_the_one_that_is_named():
    with pytest.raises(MissingExtraError, match=r"\[learn\]"), extra("docs"), extra("learn"):
        import no_such_package  # noqa: F401


def test_other_errors_pass():
    with pytest.raises(ValueError, match="other"), extra("learn"):
        raise ValueError("other")
