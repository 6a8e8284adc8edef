"""What the wheel must hold."""

import fnmatch
import tomllib
from pathlib import Path

ROOT = Path(__file__).parent.parent
MODELS = ROOT / "models" / "deformer_models"
PROJECT = tomllib.loads((ROOT / "pyproject.toml").read_text(encoding="utf-8"))


def test_every_file_of_a_shipped_model_is_package_data():
    patterns = PROJECT["tool"]["setuptools"]["package-data"]["deformer_models"]
    files = [path for path in MODELS.glob("*/*") if path.parent.name != "__pycache__"]
    assert files, "no model is shipped"
    for path in files:
        name = path.relative_to(MODELS).as_posix()
        assert any(fnmatch.fnmatch(name, pattern) for pattern in patterns), name


def test_shipped_models_are_small():
    for folder in {path.parent for path in MODELS.glob("*/model.json")}:
        assert sum(path.stat().st_size for path in folder.iterdir()) < 6_000_000
        assert (folder / "README.md").is_file(), f"{folder.name} has no model card"


def test_no_text_has_the_marks_of_a_merge():
    for pattern in ("*.md", "*.toml", "benchmarks/*.md", "docs/**/*.md", "models/*/*/*.md"):
        for path in ROOT.glob(pattern):
            lines = path.read_text(encoding="utf-8").splitlines()
            marks = [
                n for n, line in enumerate(lines, 1) if line.startswith(("<<<<<<<", ">>>>>>>"))
            ]
            assert not marks, f"{path.name}, lines {marks}"
