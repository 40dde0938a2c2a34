"""Validation of the content of files: one sentence states the place and what is wrong there."""

import functools
from typing import Any

from pydantic import TypeAdapter, ValidationError

from geovp_classic.errors import BadData, UnknownComponent, nearest

WORDS = {  # for kinds of problems that pydantic describes by types of Python
    "dict_type": "expected a table",
    "model_type": "expected a table",
    "path_type": "expected a path",
    "string_type": "expected a text",
}


@functools.cache
def adapter(kind: Any) -> TypeAdapter[Any]:
    """Return the validator of a type, which takes milliseconds to build."""
    return TypeAdapter(kind)


def validated(kind: Any, value: object, where: str = "") -> Any:
    """Return a value as a type; raise BadData, or UnknownComponent for an unknown key."""
    try:
        return adapter(kind).validate_python(value)
    except ValidationError as error:
        problems = error.errors()
    unknown = [problem for problem in problems if problem["type"] == "extra_forbidden"]
    problem = (unknown or problems)[0]
    path = [str(key) for key in problem["loc"] if key != "[key]"]
    place = ".".join([where, *path]).strip(".")
    if unknown:
        for key in path[:-1]:
            kind = kind.model_fields[key].annotation
        table = ".".join(path[:-1]) or "the matrix file"
        hint = nearest(path[-1], kind.model_fields)
        raise UnknownComponent(f"{table} has an unknown key {path[-1]!r}{hint}")
    if problem["type"] == "missing":
        raise BadData(f"{place} is missing: add it")
    reason = problem["msg"].removeprefix("Value error, ").replace("Input should be", "expected")
    reason = WORDS.get(problem["type"], reason)
    raise BadData(f"{place} is {problem['input']!r:.60}, {reason}")
