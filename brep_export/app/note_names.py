"""Names of the notes that a command may show, by which a user can silence them. Light: the front desk asks."""

from collections.abc import Collection

from recon.errors import BadOption

__all__ = ["NOTES", "require_names"]

NOTES = (
    "reading",
    "thinned",
    "piece",
    "thin-wall",
    "volume",
    "placing",
    "hole-left-out",
    "closed-holes",
    "folds",
    "off-limit",
    "ground",
    "clipped",
    "blocks",
    "dropped",
    "not-merged",
    "flat-facets",
    "mixed-faces",
    "axes-not-snapped",
    "not-snapped",
    "left-sharp",
    "wrong-side",
    "large-file",
    "several-solids",
    "limit",
    "repaired",
    "trimmed",
)


def require_names(names: Collection[str]) -> None:
    """Raises BadOption for a name that no note has."""
    for name in names:
        if name not in NOTES:
            raise BadOption("--silence", f"{name} is no note's name; there are {', '.join(NOTES)}")
