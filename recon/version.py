"""The version of the distribution, named in every header and report."""

__version__ = "0.1.0"
