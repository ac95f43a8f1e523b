"""Tests of the installed package; `make test-install` runs them."""
