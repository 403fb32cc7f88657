"""The library as a whole: examples that run, imports that Slicer can satisfy, no circles, every file packaged."""

import ast
import doctest
import importlib
import pkgutil
import re
import subprocess
import sys
from pathlib import Path

import pytest

import LAFlatteningLib

FOLDER = Path(LAFlatteningLib.__file__).parent
MODULES = sorted(
    module.name
    for module in pkgutil.walk_packages([str(FOLDER)], "LAFlatteningLib.")
    if not module.name.endswith("__main__")
)


def imports(path: Path) -> set[str]:
    """Full names of what a file imports at its top level (not inside functions)."""
    names = set()
    package = ("LAFlatteningLib", *path.relative_to(FOLDER).parts[:-1])
    for node in ast.parse(path.read_text(encoding="utf-8")).body:
        if isinstance(node, ast.Import):
            names.update(alias.name for alias in node.names)
        elif isinstance(node, ast.ImportFrom):
            base = ".".join(package[: len(package) - node.level + 1]) if node.level else ""
            module = ".".join(part for part in (base, node.module or "") if part)
            names.update(f"{module}.{alias.name}" for alias in node.names)
    return names


@pytest.mark.parametrize("name", MODULES)
def test_examples_in_docstrings(name):
    assert doctest.testmod(importlib.import_module(name)).failed == 0


def test_the_readmes_and_modules_have_examples():
    tried = sum(doctest.testmod(importlib.import_module(name)).attempted for name in MODULES)
    assert tried > 20


def test_only_packages_that_slicer_ships_are_imported():
    allowed = {"vtk", "vtkmodules", "numpy", "scipy", "SimpleITK", "LAFlatteningLib", *sys.stdlib_module_names}
    for path in FOLDER.rglob("*.py"):
        for name in imports(path):
            assert name.split(".")[0] in allowed, f"{path.name} imports {name}"


def test_importing_needs_neither_matplotlib_nor_a_screen():
    code = "import sys; sys.modules['matplotlib'] = None; import LAFlatteningLib; from LAFlatteningLib import cli"
    subprocess.run([sys.executable, "-c", code], check=True, env={"PATH": "", "PYTHONPATH": str(FOLDER.parent)})


def test_no_module_imports_in_a_circle():
    files = {".".join(path.relative_to(FOLDER.parent).with_suffix("").parts): path for path in FOLDER.rglob("*.py")}
    graph = {
        name: {target for target in files for used in imports(path) if used == target or used.startswith(f"{target}.")}
        - {name}
        for name, path in files.items()
        if not name.endswith("__init__")
    }
    done: set[str] = set()

    def visit(name: str, trail: tuple[str, ...]) -> None:
        assert name not in trail, " -> ".join((*trail, name))
        if name in done or name not in graph:
            return
        for target in graph[name]:
            visit(target, (*trail, name))
        done.add(name)

    for name in graph:
        visit(name, ())


def test_every_package_and_data_file_is_packaged():
    text = (FOLDER.parent / "pyproject.toml").read_text(encoding="utf-8")
    listed = set(re.findall(r'"(LAFlatteningLib[\w.]*)"', re.search(r"packages = \[(.*?)\]", text, re.S)[1]))
    found = {".".join(path.parent.relative_to(FOLDER.parent).parts) for path in FOLDER.rglob("__init__.py")}
    assert listed == found
    data = {f"{path.parent.relative_to(FOLDER).as_posix()}/*.json" for path in FOLDER.rglob("*.json")}
    assert data == set(re.findall(r'"([^"]*)"', re.search(r"package-data\]\s*\w+ = \[(.*?)\]", text, re.S)[1]))


ROOT = FOLDER.parent


@pytest.mark.skipif(not (ROOT / "README.md").is_file(), reason="the library is installed without its repository")
@pytest.mark.parametrize("document", ["README.md", "Docs/tutorial.md"])
def test_python_of_the_documents_runs(document, tmp_path, monkeypatch):
    from LAFlatteningLib.cli import main

    monkeypatch.chdir(tmp_path)
    assert main(["demo", "--output", "demo", "--points", "1000", "--quiet"]) == 0
    blocks = re.findall(r"```python\n(.*?)```", (ROOT / document).read_text(encoding="utf-8"), re.S)
    assert blocks
    for block in blocks:
        exec(compile(block, document, "exec"), {})


@pytest.mark.skipif(not (ROOT / "README.md").is_file(), reason="the library is installed without its repository")
def test_commands_of_the_documents_run(tmp_path, monkeypatch):
    """Every la-flatten line of README and tutorial that goes by the demo's files, as it stands there."""
    import shlex

    from LAFlatteningLib.cli import main

    monkeypatch.chdir(tmp_path)
    assert main(["demo", "--output", "demo", "--points", "1000", "--quiet"]) == 0
    count = 0
    for document in ("README.md", "Docs/tutorial.md"):
        text = (ROOT / document).read_text(encoding="utf-8").replace("\\\n", " ")
        for line in re.findall(r"^    (?:\.venv/bin/)?la-flatten (.*\bdemo/.*)$", text, re.M):
            assert main(shlex.split(line)) == 0, line
            count += 1
    assert count >= 3
