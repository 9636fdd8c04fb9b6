"""What `recon voxels` does for a volume by blocks: when, on which workers, and to a shape."""

import math
from collections.abc import Iterator, Mapping
from contextlib import contextmanager
from dataclasses import replace
from os import getpid
from pathlib import Path
from tempfile import gettempdir
from typing import Any

import numpy as np

from brep_export.app.cluster_calls import calls
from brep_export.app.voxel_bodies import VoxelBody, boundary_body, dropped_bodies
from brep_export.app.workshop import Bench
from recon.errors import BadOption, NotWritten
from recon.geometry.volume_source import SolidSource, VolumeSource, solid_source, source_labels
from recon.readers.volume_windows import open_volume, volume_shape
from recon.voxel_mesh.block_bodies import body_table, wanted_bodies, write_bodies
from recon.voxel_mesh.blocks import blocks_of, boundary_by_blocks
from recon.voxel_mesh.pipeline import VoxelOptions

__all__ = ["block_bodies", "block_size", "solid_sources"]

WHOLE = 2**28  # voxels up to which a volume is taken as a whole: some 4 GB
USUAL = 256  # voxels a side of a block where none is said: some hundreds of MB
MOST_LABELS = 1000


def block_size(request: Mapping[str, Any], bench: Bench) -> int | None:
    """Voxels a side of the blocks by which the volume is made; None as a whole.

    Raises  BadOption for options that look at a whole volume, beside --block.
    """
    whole = next((name for name in ("analytic", "smooth") if request[name]), None)
    whole = "features" if request["features"] == "paper" else whole
    if request["block"] is not None:
        if whole is not None:
            raise BadOption(f"--{whole}", "looks at the whole volume: not with --block")
        return int(request["block"])
    if request["scheduler"] is not None:
        raise BadOption("--scheduler", "shares blocks out: say how large they are with --block")
    shape = None if whole else volume_shape(request["inputs"][0])
    if shape is None or math.prod(shape) <= WHOLE:
        return None
    size = " x ".join(map(str, shape))
    bench.note(
        f"{size} voxels are made by blocks of {USUAL}, to spare memory; --block sets another size", name="blocks"
    )
    return USUAL


def solid_sources(volume: VolumeSource, request: Mapping[str, Any]) -> list[SolidSource]:
    """The solid that was asked for, or one a label."""
    if request["scheduler"] is not None and not volume.is_windowed:
        raise BadOption("--scheduler", f"{volume.name} is packed, so its blocks cannot be read alone; store it raw")
    threshold, label = request["threshold"], request["label"]
    if label != "all":
        try:
            return [solid_source(volume, threshold=threshold, label=None if label is None else float(label))]
        except ValueError:
            raise BadOption("--label", f"needs a number or all, not {label!r}") from None
    if threshold is not None:
        raise BadOption("--label", "give a threshold or labels, not both")
    labels = source_labels(volume)
    if len(labels) > MOST_LABELS:
        raise BadOption("--label", f"{volume.name} has {len(labels)} values; that is a grey volume, give a threshold")
    return [solid_source(volume, label=value) for value in labels]


def block_bodies(
    solids: list[SolidSource], options: VoxelOptions, size: int, request: Mapping[str, Any], bench: Bench
) -> list[VoxelBody]:
    """Planar faces of every solid, by blocks of `size` voxels, on the workers of a scheduler where there is one."""
    bodies = []
    with calls(request["scheduler"]) as each:
        for number, solid in enumerate(solids):
            with (
                bench.phase("reconstruct", "finding the boundary"),
                _cleaned(solid, size, number, request, bench) as kept,
            ):
                boundary = boundary_by_blocks(kept, options, size=size, each=each, doing=bench.doing)
            figures = boundary.figures() | {"block": size}
            bodies.append(boundary_body(boundary.mesh, boundary.errors, solid.voxel, figures, bench))
    return bodies


@contextmanager
def _cleaned(
    solid: SolidSource, size: int, number: int, request: Mapping[str, Any], bench: Bench
) -> Iterator[SolidSource]:
    """The solid without the bodies that are not wanted, in a file that goes with the block; what is dropped is said."""
    if not request["largest"] and request["min_voxels"] <= 1:
        yield solid
        return
    lattice = blocks_of(solid.shape, size)
    bench.doing("counting bodies")
    table = body_table(solid, lattice)
    keep = wanted_bodies(table, largest=request["largest"], min_voxels=request["min_voxels"])
    if len(keep) and not keep.any():
        most = int(table.sizes.max())
        raise BadOption("--min-voxels", f"leaves nothing of {solid.name}; its largest body has {most} voxels")
    if keep.all():
        yield solid
        return
    dropped, left = np.sort(table.sizes[~keep])[::-1], int(table.sizes[keep].sum())
    bench.note(dropped_bodies(solid.name, dropped, left), name="dropped")
    beside = Path(request["outputs"][0]).parent if request["outputs"] else Path(gettempdir())
    path = beside / f".kept.{getpid()}.{number}.npy"
    bench.staged(path)
    try:
        write_bodies(solid, lattice, table, keep, path, doing=bench.doing)
        yield solid_source(replace(open_volume(path), **_place(solid)), label=1.0)
    except OSError as failure:
        raise NotWritten(str(path), f"the disk refuses it ({failure.strerror})") from failure
    finally:
        path.unlink(missing_ok=True)


def _place(solid: SolidSource) -> dict[str, Any]:
    return {key: getattr(solid, key) for key in ("spacing", "origin", "direction", "name")}
