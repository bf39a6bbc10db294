"""The version of vctune, and the versions of the libraries that affect a result."""

from functools import cache

__version__ = "0.5.0"


@cache
def versions(ipopt: str | None) -> dict[str, str | None]:
    """Return the versions that affect a result; IPOPT's is None if the result did not need IPOPT."""
    from importlib.metadata import version

    return {
        "vctune": __version__,
        "casadi": version("casadi"),
        "ipopt": ipopt,
        "numpy": version("numpy"),
    }
