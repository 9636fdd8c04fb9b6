"""Property-based tests draw the same examples on every run, and new ones under `make test-all`; see `second_kernel`."""

import os

from hypothesis import settings

pytest_plugins = ("second_kernel",)

settings.register_profile("repeatable", derandomize=True, deadline=None)
settings.register_profile("searching", derandomize=False, deadline=None)
settings.load_profile(os.environ.get("HYPOTHESIS_PROFILE", "repeatable"))
