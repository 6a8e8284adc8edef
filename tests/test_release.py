"""A release is made whole or not at all."""

import shutil
import subprocess
import tomllib

import pytest

from paths import ROOT
from scripts import module_of


@pytest.fixture(scope="module")
def release():
    return module_of(ROOT / "tools" / "release.py")


def git(folder, *arguments):
    identity = ["-c", "user.name=a", "-c", "user.email=a@b"]
    command = ["git", *identity, *arguments]
    return subprocess.run(command, cwd=folder, check=True, capture_output=True, text=True).stdout


@pytest.fixture
def checkout(tmp_path):
    """What a release needs of this checkout, as a repository of its own, with one model."""
    tree = tmp_path / "tree"
    skipped = shutil.ignore_patterns("__pycache__", "*.egg-info", "build", "face", "hand", "flag")
    for name in ("deformer", "app", "models"):
        shutil.copytree(ROOT / name, tree / name, ignore=skipped)
    for name in ("pyproject.toml", "CITATION.cff", "CHANGELOG.md", "README.md", "LICENSE"):
        shutil.copy(ROOT / name, tree)
    git(tree, "init", "--quiet")
    git(tree, "config", "user.name", "a")
    git(tree, "config", "user.email", "a@b")
    git(tree, "add", ".")
    git(tree, "commit", "--quiet", "--message", "All")
    return tree


CHANGELOG = (
    "# Changelog\n\n## [Unreleased] – soon\n\n- A thing\n\n## [0.1.0] – 2026-01-02\n\n- First\n"
)


def test_the_changelog_gets_a_section_of_the_version(release):
    found = release.released(CHANGELOG, "CHANGELOG.md", "0.2.0", "2026-11-29")
    assert found == (
        "# Changelog\n\n## [Unreleased]\n\n## [0.2.0] – 2026-11-29\n\n- A thing\n\n"
        "## [0.1.0] – 2026-01-02\n\n- First\n"
    )
    with pytest.raises(release.ReleaseError, match="empty"):
        release.released(found, "CHANGELOG.md", "0.3.0", "2026-12-01")


def test_version_and_date_are_replaced_and_nothing_else(release):
    for name in ("pyproject.toml", "CITATION.cff"):
        before = (ROOT / name).read_text(encoding="utf-8")
        once = release.released(before, name, "9.8.7", "2026-11-29")
        assert "9.8.7" in once
        again = release.released(once, name, "9.8.8", "2026-12-01")
        assert again.replace("9.8.8", "9.8.7").replace("2026-12-01", "2026-11-29") == once
        assert len(set(once.splitlines()) ^ set(before.splitlines())) in (2, 3)
    with pytest.raises(release.ReleaseError, match="expected one"):
        release.released("", "pyproject.toml", "9.8.7", "")


@pytest.mark.skipif(shutil.which("git") is None, reason="needs git")
@pytest.mark.slow
def test_a_release_is_built_committed_and_tagged(release, checkout, tmp_path, capsys):
    pytest.importorskip("setuptools", "77", reason="needs setuptools to build a wheel")
    arguments = ["9.8.7", "--skip-checks", "--output", str(tmp_path / "dist")]
    assert release.main(arguments, checkout) == 0
    assert len(list((tmp_path / "dist").iterdir())) == 2
    assert git(checkout, "tag").split() == ["v9.8.7"]
    project = tomllib.loads(git(checkout, "show", "v9.8.7:pyproject.toml"))
    assert project["project"]["version"] == "9.8.7"
    assert git(checkout, "status", "--porcelain") == ""
    # Neither the same version again, nor one before it.
    capsys.readouterr()
    for version, told in (("9.8.7", "next number"), ("9.8.6", "released already"), ("9", "three")):
        assert release.main([version, "--skip-checks"], checkout) == 1
        assert told in capsys.readouterr().err
    (checkout / "CHANGELOG.md").write_text("changed")
    assert release.main(["9.9.0", "--skip-checks"], checkout) == 1
    assert "has changes" in capsys.readouterr().err


@pytest.mark.slow
@pytest.mark.skipif(shutil.which("git") is None, reason="needs git")
def test_a_release_that_fails_changes_nothing(release, checkout, tmp_path, capsys):
    (checkout / "CHANGELOG.md").write_text("## [Unreleased]\n")
    git(checkout, "commit", "--quiet", "--all", "--message", "Nothing new")
    before = git(checkout, "log", "--oneline")
    arguments = ["9.8.7", "--skip-checks", "--output", str(tmp_path / "dist")]
    assert release.main(arguments, checkout) == 1
    assert "no release: CHANGELOG.md: the section Unreleased is empty" in capsys.readouterr().err
    assert git(checkout, "log", "--oneline") == before
    assert git(checkout, "status", "--porcelain") == git(checkout, "tag") == ""
