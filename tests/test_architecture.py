"""Layers of the three packages: imports point downwards, and foreign packages stay in their place."""

import ast
from collections.abc import Iterator
from pathlib import Path

import pytest

ROOT = Path(__file__).resolve().parents[1]
FOLDER_OF = {
    "geovp_classic": ROOT / "geovp_classic",
    "geovp_learned": ROOT / "learned" / "geovp_learned",
    "geovp_benchmarks": ROOT / "benchmarks" / "geovp_benchmarks",
}
# Subpackages of one layer do not import each other; `geovp_classic/__init__.py` imports lazily.
CLASSIC_LAYERS = [
    {"errors"},
    {"types"},
    {"geometry", "parallel", "files", "colmap_library"},
    {"interfaces", "observation"},
    {"odometry", "forecasting", "pose_refinement", "depth", "dynamic_objects", "rendering"}
    | {"metrics", "data", "registry"},
    {"pose_sources", "inpainters"},
    {"renderers"},  # a renderer has an inpainter by default
    {"predictors"},
    {"api"},
]
SOURCES = sorted(path for folder in FOLDER_OF.values() for path in folder.rglob("*.py"))
FORBIDDEN_NAMES = {"utils", "util", "common", "helpers", "misc"}


def module_of(path: Path) -> str:
    """Return the dotted name by which Python imports a source file."""
    package = next(name for name, folder in FOLDER_OF.items() if folder in path.parents)
    parts = path.relative_to(FOLDER_OF[package].parent).with_suffix("").parts
    return ".".join(parts).removesuffix(".__init__")


MODULES = {module_of(path): path for path in SOURCES}


def imported_modules(path: Path) -> Iterator[tuple[int, str]]:
    """Yield (line, dotted module) of each import; `from package import module` names the module."""
    for node in ast.walk(ast.parse(path.read_text())):
        if isinstance(node, ast.Import):
            yield from ((node.lineno, alias.name) for alias in node.names)
        elif isinstance(node, ast.ImportFrom):
            assert node.level == 0, f"{path}:{node.lineno} has a relative import"
            for alias in node.names:
                submodule = f"{node.module}.{alias.name}"
                yield node.lineno, submodule if submodule in MODULES else str(node.module)


def subpackage_of(module: str) -> str:
    return module.split(".")[1] if "." in module else ""


def where(path: Path, line: int) -> str:
    return f"{path.relative_to(ROOT)}:{line}"


def test_import_names_are_file_paths() -> None:
    assert len(SOURCES) > 20
    links = [path for path in ROOT.iterdir() if path.is_symlink()]
    assert links == []
    assert not (ROOT / "src").exists()


def test_imports_of_the_classical_package_point_downwards() -> None:
    layer_of = {name: layer for layer, names in enumerate(CLASSIC_LAYERS) for name in names}
    wrong = []
    for module, path in MODULES.items():
        importer = subpackage_of(module)
        if not module.startswith("geovp_classic.") or not importer:
            continue
        for line, imported in imported_modules(path):
            target = subpackage_of(imported)
            if not imported.startswith("geovp_classic.") or target == importer:
                continue
            if layer_of[target] >= layer_of[importer]:
                wrong.append(f"{where(path, line)}: {importer} imports {imported}")
    assert not wrong, "\n".join(wrong)


@pytest.mark.parametrize(
    ("package", "never"),
    [
        (
            "geovp_classic",
            {
                "torch",
                "lightning",
                "safetensors",
                "matplotlib",
                "geovp_learned",
                "geovp_benchmarks",
            },
        ),
        ("geovp_benchmarks", {"torch", "lightning", "safetensors", "geovp_learned"}),
        ("geovp_learned", {"geovp_benchmarks", "matplotlib", "torchvision"}),
    ],
)
def test_packages_do_not_import_what_belongs_elsewhere(package: str, never: set[str]) -> None:
    wrong = [
        f"{where(path, line)}: imports {imported}"
        for module, path in MODULES.items()
        if module.split(".")[0] == package
        for line, imported in imported_modules(path)
        if imported.split(".")[0] in never
    ]
    assert not wrong, "\n".join(wrong)


def test_geometry_knows_no_clips() -> None:
    """Pure functions of arrays: nothing in `geometry` names a Context, a Clip or a Target."""
    wrong = [
        where(path, node.lineno)
        for module, path in MODULES.items()
        if module.startswith("geovp_classic.geometry")
        for node in ast.walk(ast.parse(path.read_text()))
        if isinstance(node, ast.Name) and node.id in {"Context", "Clip", "Target"}
    ]
    assert not wrong, "\n".join(wrong)


def test_only_the_command_line_prints() -> None:
    wrong = [
        where(path, node.lineno)
        for module, path in MODULES.items()
        if not module.startswith(("geovp_benchmarks.cli", "geovp_learned.__main__"))
        for node in ast.walk(ast.parse(path.read_text()))
        if isinstance(node, ast.Call)
        and isinstance(node.func, ast.Name)
        and node.func.id == "print"
    ]
    assert not wrong, "\n".join(wrong)


def test_nothing_is_pickled_and_no_package_is_nameless() -> None:
    pickled = [
        where(path, line)
        for path in SOURCES
        for line, module in imported_modules(path)
        if module.split(".")[0] in ("pickle", "dill", "joblib")
    ]
    nameless = [
        str(path)
        for path in SOURCES
        if path.stem in FORBIDDEN_NAMES or path.parent.name in FORBIDDEN_NAMES
    ]
    assert pickled + nameless == []


def test_no_import_cycles() -> None:
    edges = {
        name: {module for _, module in imported_modules(path) if module in MODULES} - {name}
        for name, path in MODULES.items()
    }
    done: set[str] = set()

    def visit(name: str, trail: tuple[str, ...]) -> None:
        assert name not in trail, " -> ".join((*trail, name))
        if name not in done:
            for other in edges[name]:
                visit(other, (*trail, name))
            done.add(name)

    for name in MODULES:
        visit(name, ())
    assert done == set(MODULES)


def test_dataclasses_are_frozen() -> None:
    # Mutable state grows while images are tracked or files are read; all other dataclasses are values.
    mutable = {
        "GroundPlaneEstimator",
        "Progress",
        "RelativePose",
        "Results",
        "UnitScale",
        "VideoFrames",
    }
    found = set()
    for path in SOURCES:
        for node in ast.walk(ast.parse(path.read_text())):
            for decorator in node.decorator_list if isinstance(node, ast.ClassDef) else ():
                words = ast.unparse(decorator)
                if "dataclass" in words and "frozen=True" not in words:
                    found.add(node.name)
    assert found == mutable
