"""Versions of what a result rests on, from what is installed; nothing of it is imported. Light: the front desk asks."""

import platform
from importlib.metadata import PackageNotFoundError, version

from recon.version import __version__

__all__ = ["kernel_version", "versions"]

KERNEL = "cadquery-ocp"
THREE_JS = "0.187.0"  # of the script that pages hold
LIBRARIES = ("cadquery", "numpy", "scipy", "numba", "shapely", "trimesh", "manifold3d", "pyvista", "matplotlib")


def kernel_version() -> str:
    """Version of OpenCascade: the first three numbers of that of its Python binding."""
    return ".".join(_installed(KERNEL).split(".")[:3])


def versions() -> dict[str, str]:
    """By name: this package, the kernel, the libraries, Python and the system."""
    return {
        "recon-brep": __version__,
        "OpenCascade": kernel_version(),
        KERNEL: _installed(KERNEL),
        **{name: _installed(name) for name in LIBRARIES},
        "three.js": THREE_JS,
        "Python": platform.python_version(),
        "system": f"{platform.system()} {platform.machine()}",
    }


def _installed(name: str) -> str:
    try:
        return version(name)
    except PackageNotFoundError:
        return "not installed as a package"
