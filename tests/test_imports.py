"""Who may import whom: the layers of both packages, read from the files; and what loads what, in
fresh interpreters.
"""

import ast
import json
import subprocess
import sys
from graphlib import TopologicalSorter
from pathlib import Path

import pytest

import calib
import capture

LAYERS = {
    "calib": (
        ("errors", "extras", "version"),
        ("progress", "rounding", "table", "threads"),
        ("io",),
        ("session",),
        ("corners", "fringes"),
        ("optics",),
        ("effects",),
        ("estimation",),
        ("undistortion",),
        ("fit_record",),
        ("calibration_content",),
        ("calibration_file",),
        ("calibration",),
        ("inference",),
        ("intrinsics",),
        ("fitting",),
        ("apply",),
        ("planning",),
        ("diagnosis", "verdict"),
        ("checking", "export", "importing", "report", "sheet"),
        ("fleet", "plots", "rig"),
        ("commands",),
        ("cli",),
        ("__main__",),
    ),
    "capture": (
        ("typed_path",),
        (
            "errors",
            "frames",
            "exposure",
            "sharpness",
            "settings_drift",
            "sensors",
            "interrupt",
            "orphan",
            "process",
        ),
        ("disk", "reader", "result_folder", "sources"),
        ("live_detection", "coded_light", "session_file"),
        ("finder", "coded_finder", "source_folder"),
        ("finders", "gate", "recorder"),
        ("coverage", "recording_loop"),
        (
            "guidance",
            "narrator",
            "other_board_search",
            "qr_code",
            "served_app",
            "doorkeeper",
            "guard",
            "listening",
            "picture_pair",
        ),
        ("offered_files",),
        ("guarded_server",),
        ("serve", "streaming", "screen", "rig"),
        ("tui",),
        ("commands",),
        ("cli",),
        ("__main__",),
    ),
}
"""Rooms from the bottom up. A room imports itself and what stands below it, no room beside it or
above; `capture` imports all of `calib`, which imports nothing of `capture`.
"""

HEAVY = {
    "torch",
    "cv2",
    "numpy",
    "scipy",
    "rich",
    "textual",
    "matplotlib",
    "libcamera",
    "dask",
    "distributed",
    "fsspec",
}

LOADS = {
    "calib": set(),
    "calib.cli": set(),
    "calib.commands.command_line": set(),
    "calib.version": set(),
    "calib.session.session": {"cv2", "numpy"},
    "calib.session.board": {"numpy"},
    "calib.corners.corners_file": {"numpy"},
    "calib.corners.detect_all": {"cv2", "numpy"},
    "calib.fringes.pattern": {"numpy"},
    "calib.fringes.decode": {"cv2", "numpy"},
    "calib.intrinsics.calibrate": {"cv2", "numpy"},
    "calib.optics.build": {"torch", "numpy"},
    "calib.effects.registry": {"torch", "numpy", "scipy"},
    "calib.estimation.levenberg_marquardt": {"torch", "numpy"},
    "calib.estimation.objective": {"torch", "numpy", "scipy"},
    "calib.undistortion.depth_map": {"numpy", "scipy"},
    "calib.calibration": {"torch", "cv2", "numpy", "scipy"},
    "calib.fitting.fit": {"torch", "cv2", "numpy", "scipy"},
    "calib.planning.design": {"numpy"},
    "calib.planning.hints": {"cv2", "numpy"},
    "calib.planning.pose_bank": {"cv2", "numpy"},
    "calib.planning.information": {"torch", "cv2", "numpy", "scipy"},
    "calib.diagnosis.diagnose": {"torch", "cv2", "numpy", "scipy"},
    "calib.checking.check": {"torch", "cv2", "numpy", "scipy"},
    "calib.verdict.judge": {"torch", "cv2", "numpy", "scipy"},
    "calib.report.write": {"torch", "cv2", "numpy", "scipy"},
    "calib.fleet.control": {"numpy", "scipy"},
    "calib.fleet.cluster": set(),
    "calib.importing.from_mrcal": {"cv2", "numpy"},
    "calib.importing.from_ros": {"cv2", "numpy"},
    "calib.importing.from_kalibr": {"cv2", "numpy"},
    "calib.importing.from_pictures": {"cv2", "numpy"},
    "calib.rig.rig_file": {"cv2", "numpy"},
    "calib.rig.rig": {"torch", "cv2", "numpy", "scipy"},
    "calib.rig.fit_rig": {"torch", "cv2", "numpy", "scipy"},
    "calib.sheet.layout": set(),
    "calib.sheet.pdf": set(),
    "calib.sheet.charuco": {"cv2", "numpy"},
    "capture.cli": set(),
    "capture.frames": {"numpy"},
    "capture.finder": {"cv2", "numpy", "scipy"},
    "capture.recording_loop": {"cv2", "numpy", "scipy"},
    "capture.coverage": {"cv2", "numpy", "scipy"},
    "capture.guidance": {"cv2", "numpy", "scipy"},
    "capture.rig.record_rig": {"cv2", "numpy", "scipy"},
    "capture.process": set(),
    "capture.tui.fitting": set(),
    "capture.tui.app": {"cv2", "numpy", "scipy", "rich", "textual"},
    "capture.sources.registry": {"numpy"},
    "capture.sources.libcamera": {"numpy"},
    "capture.commands.stream": set(),
    "capture.streaming.stream": {"numpy"},
    "capture.streaming.loopback": {"cv2", "numpy"},
    "capture.streaming.pipe": {"cv2", "numpy"},
}
"""The module, and which of the slow libraries importing it may load: a Pi captures without torch,
and help comes at once.
"""

Graph = dict[str, set[str]]


def imported(tree: ast.AST) -> set[str]:
    """Modules that it imports anywhere, within functions too, but not for annotations alone."""
    modules: set[str] = set()
    for node in ast.iter_child_nodes(tree):
        if (
            isinstance(node, ast.If)
            and isinstance(node.test, ast.Name)
            and node.test.id == "TYPE_CHECKING"
        ):
            continue
        if isinstance(node, ast.Import):
            modules |= {alias.name for alias in node.names}
        elif isinstance(node, ast.ImportFrom) and node.module:
            modules |= {node.module, *(f"{node.module}.{alias.name}" for alias in node.names)}
        modules |= imported(node)
    return modules


@pytest.fixture(scope="module")
def graph() -> Graph:
    """Return the imports of each file of both packages, without the packages' public interfaces."""
    files: dict[str, Path] = {}
    for package in (calib, capture):
        folder = Path(str(package.__file__)).parent
        files_inside = (path for path in folder.rglob("*.py") if path.name != "__init__.py")
        files |= {
            ".".join(path.relative_to(folder.parent).with_suffix("").parts): path
            for path in files_inside
        }
    imports = {
        name: imported(ast.parse(path.read_text())) & files.keys() for name, path in files.items()
    }
    assert (
        "calib.calibration" in imports["calib.fitting.fit"]
    )  # so that nothing found is not taken for nothing wrong
    assert "capture.tui.results" in imports["capture.tui.fit"]
    return imports


def place(module: str) -> tuple[str, int, str]:
    """Package, layer and room."""
    package, room = module.split(".")[:2]
    layers = [level for level, rooms in enumerate(LAYERS[package]) if room in rooms]
    (layer,) = layers
    return package, layer, room


def test_every_import_runs_downwards(graph: Graph) -> None:
    for module, imports in graph.items():
        package, layer, room = place(module)
        for imported_module in imports:
            below, under, imported_room = place(imported_module)
            allowed = (
                (below, imported_room) == (package, room)
                or (below == package and under < layer)
                or (package, below) == ("capture", "calib")
            )
            assert allowed, f"{module} imports {imported_module}"


def test_no_files_import_each_other_in_a_circle(graph: Graph) -> None:
    TopologicalSorter(graph).prepare()  # CycleError names those in a circle


def test_every_room_is_in_use(graph: Graph) -> None:
    rooms = {(package, room) for package, _, room in map(place, graph)}
    assert rooms == {
        (package, room) for package, layers in LAYERS.items() for layer in layers for room in layer
    }


IMPORTER = """
import importlib, json, sys
for library in sys.argv[1].split():
    importlib.import_module(library)
for module in sys.argv[2].split():
    importlib.import_module(module)
    print(json.dumps([module, [*sys.modules]]), flush=True)
"""
"""Imports what may be loaded, and then one module after another, saying what is loaded. The first
that loads more than it may is in front of those that fail with it.
"""


@pytest.fixture(scope="module")
def loaded() -> dict[str, set[str]]:
    """Return what is loaded after each module, in an interpreter for those of the same slow
    libraries.
    """
    loads: dict[str, set[str]] = {}
    for allowed in {frozenset(allowed) for allowed in LOADS.values()}:
        modules = " ".join(
            module for module, allowed_names in LOADS.items() if allowed_names == allowed
        )
        command = [sys.executable, "-c", IMPORTER, " ".join(sorted(allowed)), modules]
        answer = subprocess.run(command, stdout=subprocess.PIPE, text=True, check=True).stdout
        loads |= {module: set(names) for module, names in map(json.loads, answer.splitlines())}
    return loads


@pytest.mark.parametrize("module", LOADS)
def test_importing(module: str, loaded: dict[str, set[str]]) -> None:
    assert module in loaded[module]
    assert loaded[module] & HEAVY <= LOADS[module]


def test_reading_a_session_by_the_librarys_face_loads_no_torch() -> None:
    code = "import sys, calib; calib.read_session; print('\\n'.join(sys.modules))"
    loaded = set(
        subprocess.run(
            [sys.executable, "-c", code], capture_output=True, text=True, check=True
        ).stdout.split()
    )
    assert not loaded & {"torch", "rich", "capture"}


def test_what_tests_and_benchmarks_share_is_a_fixture() -> None:
    root = Path(__file__).parents[1]
    for folder, second_folder in (
        ("tests", "benchmarks"),
        ("benchmarks", "tests"),
        ("fixtures", "tests"),
        ("fixtures", "benchmarks"),
    ):
        files = list((root / folder).rglob("*.py"))
        assert files
        for path in files:
            assert not {
                name
                for name in imported(ast.parse(path.read_text()))
                if name.split(".")[0] == second_folder
            }, path
