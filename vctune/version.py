"""The version of vctune, in one place, and those of the libraries that determine a result beside it."""

from functools import cache

__version__ = "0.2.0"


@cache
def versions(ipopt: str | None) -> dict[str, str | None]:
    """Return the versions that determine a result; IPOPT's is None if it took no part."""
    from importlib.metadata import version

    return {
        "vctune": __version__,
        "casadi": version("casadi"),
        "ipopt": ipopt,
        "numpy": version("numpy"),
        "python-flint": version("python-flint"),
    }
