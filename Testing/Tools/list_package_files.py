"""Bring the file lists of the CMake files up to date with the folders.

python Testing/Tools/list_package_files.py

CMake packages what is listed and nothing else. `test_packaging.py` says when a list is out of date.
"""

from __future__ import annotations

import re
from pathlib import Path

ROOT = Path(__file__).resolve().parents[2]


def packaged(folder: Path, *patterns: str) -> list[str]:
    """Files below a folder that belong into the extension, as CMake writes them."""
    found = {path for pattern in patterns for path in folder.glob(pattern) if "__pycache__" not in path.parts}
    return sorted(path.relative_to(folder).as_posix() for path in found)


EXPECTED = {
    ("LAFlatteningLib/CMakeLists.txt", "MODULE_PYTHON_SCRIPTS"): packaged(ROOT / "LAFlatteningLib", "**/*.py"),
    ("LAFlatteningLib/CMakeLists.txt", "MODULE_PYTHON_RESOURCES"): packaged(
        ROOT / "LAFlatteningLib", "**/*.json", "**/*.npz", "**/*.csv"
    ),
    ("LAFlattening/CMakeLists.txt", "MODULE_PYTHON_SCRIPTS"): packaged(
        ROOT / "LAFlattening", "*.py", "LAFlattening*/**/*.py"
    ),
    ("LAFlattening/CMakeLists.txt", "MODULE_PYTHON_RESOURCES"): packaged(
        ROOT / "LAFlattening", "Resources/**/*.png", "Resources/**/*.svg", "Resources/**/*.ui", "Resources/**/*.json"
    ),
    ("LAFlattening/Testing/CMakeLists.txt", "TEST_SCRIPTS"): packaged(ROOT / "Testing" / "Module", "test_*.py"),
}
"""CMake file and variable -> what it should list."""


def listed(cmake: Path, variable: str) -> list[str]:
    """What a CMake file lists in a variable."""
    text = cmake.read_text(encoding="utf-8")
    found = re.search(rf"set\({variable}\s*(.*?)\)", text, re.DOTALL)
    if found is None:
        raise ValueError(f"{cmake}: expected set({variable} ...), found none.")
    name = re.search(r"set\(MODULE_NAME (\w+)\)", text)
    return found[1].replace("${MODULE_NAME}", name[1] if name else "").split()


def main() -> None:
    """Rewrite the lists."""
    for (file, variable), files in EXPECTED.items():
        cmake = ROOT / file
        lines = "".join(f"  {name}\n" for name in files)
        text = re.sub(
            rf"set\({variable}\s*.*?\)",
            lambda _, variable=variable, lines=lines: f"set({variable}\n{lines}  )",
            cmake.read_text(encoding="utf-8"),
            count=1,
            flags=re.DOTALL,
        )
        cmake.write_text(text, encoding="utf-8")


if __name__ == "__main__":
    main()
