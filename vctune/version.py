"""The version of vctune, in one place, and those of the libraries that determine a result beside it."""

__version__ = "0.1.0"


def versions(ipopt: str | None) -> dict[str, str | None]:
    """Return the versions that determine a result; IPOPT's is None where it took no part."""
    from importlib.metadata import version

    return {
        "vctune": __version__,
        "casadi": version("casadi"),
        "ipopt": ipopt,
        "numpy": version("numpy"),
        "python-flint": version("python-flint"),
    }
