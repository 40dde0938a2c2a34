"""Components of a matrix file: built, or a reason why not."""

import contextlib
import glob
from collections.abc import Callable, Iterable, Iterator
from pathlib import Path
from typing import Any

from geovp.provenance import nested
from geovp_benchmarks.failure import ERRORS, Failure
from geovp_benchmarks.matrix.values import Spec
from geovp_classic import registry
from geovp_classic.data.formats.sequence_paths import SEQUENCE
from geovp_classic.data.frames.image_frames import file_digest
from geovp_classic.errors import GeovpError, Incompatible, MissingExtra
from geovp_classic.types import PrivilegedInput


def build(
    role: str, name: str, spec: Spec, try_out: Callable[[Any], object] = lambda component: None
) -> Any:
    """Build the component of an entry and try it; return a Failure if it cannot work here.

    Mistakes in the file are raised: an unknown name or field, or a value that its component
    refuses.
    """
    try:
        component = registry.build(role, spec, f"{role}.{name}")
        has_needs = isinstance(getattr(component, "needs", None), PrivilegedInput)
        if role in ("pose_sources", "renderers", "predictors") and not has_needs:
            raise TypeError(
                f"{name!r} does not say what it needs: give it `needs`, PrivilegedInput.NONE for "
                "the frames alone"
            )
        try_out(component)
    except ERRORS as error:
        if isinstance(error, GeovpError) and not isinstance(error, (Incompatible, MissingExtra)):
            raise
        return Failure.of(error)  # an error of a plug-in: its methods fail, the others go on
    return component


def on_device(device: str | None) -> contextlib.AbstractContextManager[None]:
    """Build networks for this device unless they name one; None keeps their defaults."""
    return registry.defaults() if device is None else registry.defaults(device=device)


def weights_of(components: Iterable[object]) -> list[str]:
    """Return the notes on weights that components and nested ones have as `weights_note`."""
    notes = (getattr(component, "weights_note", "") for component in nested(components))
    return [str(note) for note in dict.fromkeys(notes) if note]


def files_of(components: Iterable[object]) -> Iterator[str]:
    """Yield path and hash of each file that settings of components name, or that is in a folder.

    Of a file, the size and a sample of bytes are read. Only components of geovp_classic count:
    those with weights have a fingerprint, and plug-ins may have a folder that they write.
    """
    for component in nested(components):
        is_classic = component.__module__.startswith("geovp_classic.")
        for path in vars(component).values() if is_classic else ():
            if isinstance(path, Path):
                # Of all sequences, so that further clips do not change the hashes
                pattern = glob.escape(str(path)).replace(SEQUENCE, "**/*")
                roots = map(Path, glob.glob(pattern, recursive=True))
                files = {file for root in roots for file in (root, *root.rglob("*"))}
                for file in sorted(filter(Path.is_file, files)):
                    yield f"{file} {file_digest(file, 4096).hex()}"
