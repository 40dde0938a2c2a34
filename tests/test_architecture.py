"""The floors of the house: imports only go down, heavy or foreign things stay in their rooms."""

import ast
from collections.abc import Iterator
from pathlib import Path

import pytest

ROOT = Path(__file__).resolve().parents[1]
FLOORS = [
    {"errors"},
    {"types"},
    {"geometry", "interfaces", "parallel", "files", "colmap_library"},
    {"odometry", "forecasting", "pose_refinement", "depth", "dynamic_objects", "render", "data", "metrics", "registry"},
    {"pose_sources", "refined", "renderers", "volume_fusion", "exports"},
    {"predictors", "contracts"},
    {"api"},  # `geovp_classic/__init__.py` names what it exports, and imports nothing until it is used
]
FLOOR_OF = {room: floor for floor, rooms in enumerate(FLOORS) for room in rooms}
SOURCES = sorted(
    path for package in ("geovp_classic", "learned", "benchmarks") for path in (ROOT / package).rglob("*.py")
)
FORBIDDEN_NAMES = {"utils", "util", "common", "helpers", "misc"}


def imported_modules(path: Path) -> Iterator[tuple[int, str]]:
    """(line, dotted module) of every import, `from package import module` spelled out to the module."""
    for node in ast.walk(ast.parse(path.read_text())):
        if isinstance(node, ast.Import):
            yield from ((node.lineno, alias.name) for alias in node.names)
        elif isinstance(node, ast.ImportFrom):
            assert node.level == 0, f"{path}:{node.lineno} has a relative import"
            base = node.module or ""
            for alias in node.names:
                spelled = ROOT.joinpath("src", *base.split("."), alias.name)
                is_module = spelled.with_suffix(".py").exists() or spelled.is_dir()
                yield node.lineno, f"{base}.{alias.name}" if is_module else base


def room_of(module: str) -> str:
    return module.split(".")[1] if "." in module else ""


def where(path: Path, line: int) -> str:
    return f"{path.relative_to(ROOT)}:{line}"


def test_there_is_something_to_check() -> None:
    assert len(SOURCES) > 20


def test_imports_in_the_classical_package_only_go_down() -> None:
    wrong = []
    for path in SOURCES:
        parts = path.relative_to(ROOT).with_suffix("").parts
        if parts[0] != "geovp_classic" or parts[1] == "__init__":
            continue
        for line, module in imported_modules(path):
            if not module.startswith("geovp_classic.") or room_of(module) == parts[1]:
                continue
            if FLOOR_OF[room_of(module)] >= FLOOR_OF[parts[1]]:
                wrong.append(f"{where(path, line)}: {parts[1]} imports {module}")
    assert not wrong, "\n".join(wrong)


@pytest.mark.parametrize(
    ("package", "never"),
    [
        ("geovp_classic", {"torch", "lightning", "safetensors", "matplotlib", "geovp_learned", "geovp_benchmarks"}),
        ("benchmarks", {"torch", "lightning", "safetensors", "geovp_learned"}),
        ("learned", {"geovp_benchmarks", "matplotlib", "torchvision"}),
    ],
)
def test_packages_keep_to_their_rooms(package: str, never: set[str]) -> None:
    wrong = []
    for path in SOURCES:
        parts = path.relative_to(ROOT).parts
        if parts[0] != package or "performance" in parts:
            continue
        wrong += [
            f"{where(path, line)}: imports {module}"
            for line, module in imported_modules(path)
            if module.split(".")[0] in never
        ]
    assert not wrong, "\n".join(wrong)


def test_only_the_command_line_prints() -> None:
    wrong = [
        where(path, node.lineno)
        for path in SOURCES
        if path.relative_to(ROOT).parts[:2] not in (("benchmarks", "cli"), ("learned", "__main__.py"))
        and "performance" not in path.parts
        for node in ast.walk(ast.parse(path.read_text()))
        if isinstance(node, ast.Call) and isinstance(node.func, ast.Name) and node.func.id == "print"
    ]
    assert not wrong, "\n".join(wrong)


def test_nothing_is_pickled_and_no_room_is_nameless() -> None:
    pickled = [
        where(path, line)
        for path in SOURCES
        for line, module in imported_modules(path)
        if module.split(".")[0] in ("pickle", "dill", "joblib")
    ]
    nameless = [str(path) for path in SOURCES if path.stem in FORBIDDEN_NAMES or path.parent.name in FORBIDDEN_NAMES]
    assert pickled + nameless == []


def test_no_import_cycles() -> None:
    modules = {
        ".".join(path.relative_to(ROOT).with_suffix("").parts).removesuffix(".__init__"): path for path in SOURCES
    }
    edges = {
        name: {module for _, module in imported_modules(path) if module in modules and module != name}
        for name, path in modules.items()
    }
    done: set[str] = set()

    def visit(name: str, trail: tuple[str, ...]) -> None:
        assert name not in trail, " -> ".join((*trail, name))
        if name not in done:
            for other in edges[name]:
                visit(other, (*trail, name))
            done.add(name)

    for name in modules:
        visit(name, ())
    assert done == set(modules)


def test_dataclasses_are_frozen() -> None:
    # State that grows while images are read, tracked or learned from; everything else is a value or a component.
    growing = {"GroundPlaneEstimator", "Progress", "RelativePose", "Results", "UnitScale", "VideoFrames"}
    thawed = set()
    for path in SOURCES:
        for node in ast.walk(ast.parse(path.read_text())):
            for decorator in node.decorator_list if isinstance(node, ast.ClassDef) else ():
                words = ast.unparse(decorator)
                if "dataclass" in words and "frozen=True" not in words:
                    thawed.add(node.name)
    assert thawed == growing
