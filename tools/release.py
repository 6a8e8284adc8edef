"""Make a release: all but the upload.

python tools/release.py 0.2.0                  # checks, changelog, sdist, wheel, commit, tag
python tools/release.py 0.2.0 --skip-checks    # where `make check docs` has just passed

Everything is made and tried in a copy of the last commit. The checkout is changed only when all of
it has worked: one commit, and the tag. Nothing is sent anywhere.
"""

from __future__ import annotations

import argparse
import datetime
import re
import subprocess
import sys
import tarfile
import tempfile
import zipfile
from pathlib import Path

ROOT = Path(__file__).resolve().parent.parent
CHANGED = ("pyproject.toml", "CITATION.cff", "CHANGELOG.md")
_VERSION = re.compile(r"\d+\.\d+\.\d+")
# Setuptools puts arguments of its own into sys.argv.
_BUILD = """
import sys, setuptools.build_meta
output = sys.argv[1]
setuptools.build_meta.build_sdist(output)
setuptools.build_meta.build_wheel(output)
"""
_TRY = """
import importlib.metadata, deformer
assert deformer.__file__.startswith({site!r}), deformer.__file__
assert importlib.metadata.version("deformer") == {version!r}
for name in deformer.shipped_models():
    deformer.load_model(name)
print(*deformer.shipped_models())
"""


class ReleaseError(Exception):
    """Why there is no release, in one line."""


def released(text: str, name: str, version: str, date: str) -> str:
    """A file of `CHANGED` as it is in the release.

    Args:
        text: what the file has now.
        name: which of them it is.
        version: "major.minor.patch".
        date: "year-month-day".

    Raises:
        ReleaseError: the file has no place for the version, or nothing to release.
    """
    if name == "pyproject.toml":
        return _replaced(text, name, r'^version = ".*"$', f'version = "{version}"')
    if name == "CITATION.cff":
        text = re.sub(r"^date-released: .*\n", "", text, flags=re.MULTILINE)
        return _replaced(text, name, r"^version: .*$", f"version: {version}\ndate-released: {date}")
    heading = re.search(r"^## \[Unreleased\].*$", text, re.MULTILINE)
    if heading is None:
        raise ReleaseError(f"{name}: no section Unreleased; add one with what has changed")
    following = re.search(r"^## ", text[heading.end() :], re.MULTILINE)
    end = heading.end() + following.start() if following else len(text)
    if not text[heading.end() : end].strip():
        raise ReleaseError(f"{name}: the section Unreleased is empty; say what has changed")
    new = f"## [Unreleased]\n\n## [{version}] – {date}"
    return text[: heading.start()] + new + text[heading.end() :]


def _replaced(text: str, name: str, pattern: str, new: str) -> str:
    found, count = re.subn(pattern, lambda _: new, text, flags=re.MULTILINE)
    if count != 1:
        raise ReleaseError(f"{name}: {count} lines with a version, expected one; correct the file")
    return found


def check(version: str, root: Path) -> None:
    """Raise ReleaseError unless this version can be made from this checkout."""
    if not _VERSION.fullmatch(version):
        raise ReleaseError(f"version {version!r}: expected three numbers, as 0.2.0")
    if _git(root, "status", "--porcelain"):
        raise ReleaseError("the checkout has changes; commit them, or put them aside")
    tags = _git(root, "tag", "--list").split()
    if f"v{version}" in tags:
        raise ReleaseError(f"version {version}: there is a tag v{version}; take the next number")
    newest = max((_numbers(tag[1:]) for tag in tags if _VERSION.fullmatch(tag[1:])), default=())
    if _numbers(version) < newest:
        raise ReleaseError(f"version {version}: {'.'.join(map(str, newest))} is released already")


def _numbers(version: str) -> tuple[int, ...]:
    return tuple(int(part) for part in version.split("."))


def build(root: Path, version: str, date: str, output: Path) -> dict[str, str]:
    """Build sdist and wheel of the last commit with its new version, and try them.

    Args:
        root: the checkout.
        version: "major.minor.patch".
        date: "year-month-day".
        output: folder for the two files; made if absent.

    Returns:
        The new texts of `CHANGED` by name.

    Raises:
        ReleaseError: as `released`, or the built files lack something.
        subprocess.CalledProcessError: building or importing failed.
    """
    texts = {n: released((root / n).read_text("utf-8"), n, version, date) for n in CHANGED}
    output.mkdir(parents=True, exist_ok=True)
    with tempfile.TemporaryDirectory() as folder:
        tree, site = Path(folder) / "tree", Path(folder) / "site"
        archive = Path(folder) / "tree.tar"
        _git(root, "archive", "--output", str(archive), "HEAD")
        with tarfile.open(archive) as tar:
            tar.extractall(tree, filter="data")
        for name, text in texts.items():
            (tree / name).write_text(text, encoding="utf-8")
        _run([sys.executable, "-c", _BUILD, str(output.resolve())], tree)
        sdist, wheel = _built(output, version)
        pip = [sys.executable, "-m", "pip", "install", "--quiet", "--no-deps", "--no-index"]
        pip += ["--no-compile", "--disable-pip-version-check"]
        _run([*pip, "--target", str(site), str(wheel)], tree)
        program = f"import sys; sys.path.insert(0, {str(site)!r})\n"
        program += _TRY.format(site=str(site), version=version)
        _run([sys.executable, "-I", "-c", program], site)
    print(f"built and tried {sdist.name} and {wheel.name}")
    return texts


def _built(output: Path, version: str) -> tuple[Path, Path]:
    """The sdist and the wheel, which hold what they must."""
    sdist = output / f"deformer-{version}.tar.gz"
    (wheel,) = output.glob(f"deformer-{version}-*.whl")
    with tarfile.open(sdist) as tar:
        inside = [name.partition("/")[2] for name in tar.getnames()]
    with zipfile.ZipFile(wheel) as archive:
        packed = archive.namelist()
    for name in ("README.md", "LICENSE", "pyproject.toml", "deformer/__init__.pyi"):
        if name not in inside:
            raise ReleaseError(f"{sdist.name}: lacks {name}; see package-data of pyproject.toml")
    for ending in ("humanoid/weights.safetensors", "licenses/LICENSE", "report/report.html"):
        if not any(name.endswith(ending) for name in packed):
            raise ReleaseError(f"{wheel.name}: lacks {ending}; see package-data of pyproject.toml")
    return sdist, wheel


def _git(root: Path, *arguments: str) -> str:
    done = subprocess.run(["git", *arguments], cwd=root, capture_output=True, text=True)
    if done.returncode:
        raise ReleaseError(f"git {arguments[0]}: {done.stderr.strip()}")
    return done.stdout


def _run(command: list[str], folder: Path) -> None:
    done = subprocess.run(command, cwd=folder, capture_output=True, text=True)
    if done.returncode:
        print(done.stdout, done.stderr, file=sys.stderr)
        done.check_returncode()


def main(arguments: list[str] | None = None, root: Path = ROOT) -> int:
    """Make the release that the arguments ask for; returns the exit status."""
    parser = argparse.ArgumentParser(description=(__doc__ or "").splitlines()[0])
    parser.add_argument("version", help="three numbers, as 0.2.0")
    parser.add_argument("--skip-checks", action="store_true", help="leave out `make check docs`")
    parser.add_argument("--output", type=Path, default=root / "dist", help="folder for the files")
    given = parser.parse_args(arguments)
    version, date = given.version, datetime.date.today().isoformat()
    try:
        check(version, root)
        if not given.skip_checks:
            subprocess.run(["make", "check", "docs"], cwd=root, check=True)
        texts = build(root, version, date, given.output)
        for name, text in texts.items():
            (root / name).write_text(text, encoding="utf-8")
        _git(root, "commit", "--quiet", "--message", f"Release {version}", *CHANGED)
        _git(root, "tag", "--annotate", f"v{version}", "--message", f"Deformer {version}")
    except (ReleaseError, subprocess.CalledProcessError) as error:
        print(f"no release: {error}", file=sys.stderr)
        return 1
    print(f"Left to do: git push --follow-tags; twine upload {given.output}/deformer-{version}*")
    return 0


if __name__ == "__main__":
    sys.exit(main())
