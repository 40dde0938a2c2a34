"""Reader of pickled torch files that executes nothing of them.

Tensors and plain containers are rebuilt. Any other class or function that a file names is replaced
by an `Inert` object, which holds the state that the file gives it and does nothing.
"""

import collections
import io
import pickle
import types
import warnings
from pathlib import Path
from typing import Any

import torch
from torch import Tensor

from geovp_classic import files

LIMIT_BYTES = 4096 * files.MIB
REBUILT: dict[tuple[str, str], Any] = {
    ("collections", "OrderedDict"): collections.OrderedDict,
    ("torch", "Size"): torch.Size,
    # wrapped, so that a file cannot change attributes of torch's own functions
    ("torch._utils", "_rebuild_tensor"): lambda *given: torch._utils._rebuild_tensor(*given),
    ("torch._utils", "_rebuild_tensor_v2"): lambda *given: torch._utils._rebuild_tensor_v2(*given),
    ("torch._utils", "_rebuild_parameter"): lambda tensor, *_: tensor,
    ("torch.nn.parameter", "Parameter"): lambda tensor, *_: tensor,
}


class Inert:
    """What stands for an object of a class that is not loaded."""

    def __new__(cls, *_: Any, **__: Any) -> "Inert":
        """Return an object without attributes, whatever it is called with."""
        return object.__new__(cls)

    def __setstate__(self, state: Any) -> None:
        if isinstance(state, dict):
            self.__dict__.update(state)

    def __setitem__(self, key: Any, value: Any) -> None:
        self.__dict__[str(key)] = value


class Unpickler(pickle.Unpickler):
    """An unpickler that knows the names in `REBUILT` alone."""

    def find_class(self, module: str, name: str) -> Any:
        """Return what a name is rebuilt with."""
        return REBUILT.get((module, name)) or type(name, (Inert,), {})


def load(file: Path) -> Any:
    """Read a file of `torch.save`; raise BadData if it is missing or not one."""
    module: Any = types.ModuleType("inert_pickle")
    module.Unpickler, module.load = Unpickler, lambda stream, **_: Unpickler(stream).load()
    content = io.BytesIO(files.read_bytes(file, LIMIT_BYTES))
    with (
        files.checked(f"{file} is not a file of torch.save", "give the authors' own file"),
        warnings.catch_warnings(),
    ):
        warnings.simplefilter("ignore")  # that it cannot compare the source of classes
        return torch.load(content, map_location="cpu", pickle_module=module, weights_only=False)


def state_dict(module: Any) -> dict[str, Tensor]:
    """Return the tensors of a pickled module, or of a state dict, under their names."""
    if isinstance(module, dict):
        return {str(name): value for name, value in module.items() if isinstance(value, Tensor)}
    held = options(module)
    tensors = {**held.get("_parameters", {}), **held.get("_buffers", {})}
    named = {name: value for name, value in tensors.items() if isinstance(value, Tensor)}
    for name, child in held.get("_modules", {}).items():
        if isinstance(child, Inert):
            named |= {f"{name}.{key}": value for key, value in state_dict(child).items()}
    return named


def options(content: Any) -> dict[str, Any]:
    """Return the entries of a pickled namespace or dictionary."""
    return content if isinstance(content, dict) else dict(getattr(content, "__dict__", {}))
