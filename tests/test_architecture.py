"""Layers of the packages: imports point downwards, and foreign packages stay in their place."""

import ast
import graphlib
from pathlib import Path

import pytest

ROOT = Path(__file__).resolve().parents[1]
FOLDER_OF = {
    "geovp_classic": ROOT,
    "geovp": ROOT,
    "geovp_learned": ROOT / "learned",
    "geovp_benchmarks": ROOT / "benchmarks",
}
# Subpackages of one layer do not import each other; `geovp_classic/__init__.py` imports lazily.
CLASSIC_LAYERS = [
    {"errors", "version", "numba_cache"},
    {"types", "colmap_library"},
    {"geometry", "parallel", "files", "atomic"},
    {"interfaces", "observation", "data"},
    {"odometry", "forecasting", "pose_refinement", "depth", "layers", "rendering"}
    | {"metrics", "registry"},
    {"pose_sources", "inpainters"},
    {"renderers"},  # depth fusion has a default inpainter
    {"predictors"},
    {"streaming"},
    {"api"},
]
APPLICATION_LAYERS = [{"progress", "drawing", "provenance"}, {"prediction"}, {"display"}]
DATA_LAYERS = [
    {"findings"},
    {"frames"},
    {"formats"},
    {"recordings"},
    {"layouts"},
    {"doctor", "synthetic"},
]
BENCHMARK_LAYERS = [
    {"failure", "validation"},
    {"results"},
    {"matrix", "statistics"},
    {"tables"},
    {"plots", "running"},
    {"report", "checks", "error_budget", "trajectories"},
    {"cli"},
]
NEVER_IMPORTED = {
    "geovp_classic": {"torch", "lightning", "safetensors", "matplotlib"}
    | {"geovp", "geovp_learned", "geovp_benchmarks"},
    "geovp": {"torch", "lightning", "safetensors", "geovp_learned", "geovp_benchmarks"},
    "geovp_benchmarks": {"torch", "lightning", "safetensors", "geovp_learned"},
    "geovp_learned": {"geovp", "geovp_benchmarks", "matplotlib", "torchvision"},
}
FORBIDDEN_NAMES = {"utils", "util", "common", "helpers", "misc"}


def module_of(path: Path, folder: Path) -> str:
    """Return the dotted name by which Python imports a source file."""
    name = ".".join(path.relative_to(folder).with_suffix("").parts)
    return name.removesuffix(".__init__")


MODULES = {
    module_of(path, folder): ast.parse(path.read_text())
    for package, folder in FOLDER_OF.items()
    for path in sorted((folder / package).rglob("*.py"))
}


def imports_of(module: str) -> set[str]:
    """Return the imported modules; `from package import module` names the module."""
    names = set()
    for node in ast.walk(MODULES[module]):
        if isinstance(node, ast.Import):
            names |= {alias.name for alias in node.names}
        elif isinstance(node, ast.ImportFrom):
            assert node.level == 0, f"{module} has a relative import"
            for alias in node.names:
                submodule = f"{node.module}.{alias.name}"
                names.add(submodule if submodule in MODULES else str(node.module))
    return names


IMPORTS = {module: imports_of(module) - {module} for module in MODULES}


def test_import_names_are_file_paths() -> None:
    assert len(MODULES) > 100
    assert [path for path in ROOT.iterdir() if path.is_symlink()] == []
    assert not (ROOT / "src").exists()
    assert not FORBIDDEN_NAMES & {part for module in MODULES for part in module.split(".")}


@pytest.mark.parametrize(
    ("package", "layers"),
    [
        ("geovp_classic", CLASSIC_LAYERS),
        ("geovp", APPLICATION_LAYERS),
        ("geovp_classic.data", DATA_LAYERS),
        ("geovp_benchmarks", BENCHMARK_LAYERS),
    ],
)
def test_imports_of_a_package_point_downwards(package: str, layers: list[set[str]]) -> None:
    layer_of = {name: layer for layer, names in enumerate(layers) for name in names}
    inside = [module for module in MODULES if module.startswith(f"{package}.")]

    def name_of(module: str) -> str:
        return module.removeprefix(f"{package}.").partition(".")[0]

    assert {name_of(module) for module in inside} == layer_of.keys()
    for module in inside:
        importer = name_of(module)
        for imported in IMPORTS[module]:
            if imported.startswith(f"{package}.") and name_of(imported) != importer:
                target = name_of(imported)
                assert layer_of[target] < layer_of[importer], f"{module} imports {imported}"


@pytest.mark.parametrize("package", NEVER_IMPORTED)
def test_packages_do_not_import_foreign_packages(package: str) -> None:
    never = NEVER_IMPORTED[package] | {"pickle", "dill", "joblib"}
    for module, imports in IMPORTS.items():
        if module.partition(".")[0] == package:
            # whose unpickler rebuilds tensors and plain containers alone
            spared = {"pickle"} if module == "geovp_learned.inert_pickle" else set()
            assert not (never - spared) & {name.partition(".")[0] for name in imports}, module


def test_the_page_draws_these_layers() -> None:
    page = (ROOT / "docs/architecture.md").read_text()
    blocks = [block.removeprefix("text\n") for block in page.split("```") if "\n< " in block]
    drawn = [[set(line.split(", ")) for line in block.strip().split("\n< ")] for block in blocks]
    assert drawn == [CLASSIC_LAYERS, BENCHMARK_LAYERS, APPLICATION_LAYERS]


def test_imports_have_no_cycles() -> None:
    edges = {module: imports & MODULES.keys() for module, imports in IMPORTS.items()}
    order = list(graphlib.TopologicalSorter(edges).static_order())  # CycleError names a cycle
    assert sorted(order) == sorted(MODULES)


def test_geometry_depends_on_arrays_only() -> None:
    for module, tree in MODULES.items():
        names = {node.id for node in ast.walk(tree) if isinstance(node, ast.Name)}
        if module.startswith("geovp_classic.geometry"):
            assert not names & {"Context", "Clip", "Target"}, module


def test_only_the_command_line_prints() -> None:
    for module, tree in MODULES.items():
        if not module.startswith(("geovp_benchmarks.cli", "geovp_learned.__main__")):
            for node in ast.walk(tree):
                is_print = isinstance(node, ast.Call) and ast.unparse(node.func) == "print"
                assert not is_print, f"{module}:{node.lineno}"


def test_dataclasses_are_frozen() -> None:
    """Mutable state grows while images are tracked or files are read; others are values."""
    mutable = {"Keyframe", "UnitScale", "RelativePose"}
    mutable |= {"Progress", "Results", "VideoFrames"}
    for tree in MODULES.values():
        for node in ast.walk(tree):
            for decorator in node.decorator_list if isinstance(node, ast.ClassDef) else ():
                text = ast.unparse(decorator)
                is_frozen = "dataclass" not in text or "frozen=True" in text
                assert is_frozen or node.name in mutable, node.name
