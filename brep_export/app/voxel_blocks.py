"""What `recon voxels` does for a volume by blocks: when, on which workers, and to a shape."""

import math
from collections.abc import Callable, Iterator, Mapping
from contextlib import contextmanager
from typing import Any

from brep_export.app.batch.cluster import workers
from brep_export.app.voxel_bodies import VoxelBody, boundary_body
from brep_export.app.workshop import Bench
from recon.errors import BadOption, InputError, ReconError, Refusal
from recon.geometry.volume_source import SolidSource, VolumeSource, solid_source, source_labels
from recon.readers.volume_windows import volume_shape
from recon.voxel_mesh.blocks import boundary_by_blocks
from recon.voxel_mesh.pipeline import VoxelOptions

__all__ = ["block_bodies", "block_size", "solid_sources"]

Each = Callable[..., Iterator[Any]]

WHOLE = 2**28  # voxels up to which a volume is taken as a whole: some 4 GB
USUAL = 256  # voxels a side of a block where none is said: some hundreds of MB
MOST_LABELS = 1000


def block_size(request: Mapping[str, Any], bench: Bench) -> int | None:
    """Voxels a side of the blocks by which the volume is made; None as a whole.

    Raises  BadOption for options that look at a whole volume, beside --block.
    """
    whole = next((name for name in ("analytic", "largest") if request[name]), None)
    whole = "min-voxels" if request["min_voxels"] > 1 else "features" if request["features"] == "paper" else whole
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
    solids: list[SolidSource], options: VoxelOptions, size: int, scheduler: str | None, bench: Bench
) -> list[VoxelBody]:
    """Planar faces of every solid, by blocks of `size` voxels, on the workers of a scheduler where there is one."""
    bodies = []
    with _calls(scheduler) as each:
        for solid in solids:
            with bench.phase("reconstruct", "finding the boundary"):
                boundary = boundary_by_blocks(solid, options, size=size, each=each, doing=bench.doing)
            figures = boundary.figures() | {"block": size}
            bodies.append(boundary_body(boundary.mesh, boundary.errors, solid.voxel, figures, bench))
    return bodies


@contextmanager
def _calls(scheduler: str | None) -> Iterator[Each]:
    """What calls a function for every entry of sequences: here, or on the workers of a scheduler."""
    if scheduler is None:
        yield map
        return
    with workers(scheduler, 0) as client:

        def each(function: Callable[..., Any], *sequences: Any) -> Iterator[Any]:
            # all are handed out before the first is waited for
            futures = [client.submit(_told, function, *given, pure=False) for given in zip(*sequences)]
            for number, future in enumerate(futures):
                yield _found(future.result())
                futures[number] = None  # what came back needs no place on its worker any more

        yield each


def _told(function: Callable[..., Any], *given: Any) -> tuple[bool, Any]:
    """What a function returns, or the sentence with which it refuses: errors of ours do not travel."""
    try:
        return True, function(*given)
    except InputError as problem:
        return False, ("input", str(problem))
    except ReconError as problem:
        return False, ("refusal", str(problem))


def _found(answer: tuple[bool, Any]) -> Any:
    done, value = answer
    if done:
        return value
    kind, sentence = value
    raise InputError(sentence) if kind == "input" else Refusal(sentence)
