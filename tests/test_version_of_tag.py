"""The version of a build is that of its tag (version_of_tag.py)."""

import subprocess
from pathlib import Path

import pytest

import version_of_tag

TREE = Path(__file__).parents[1]


@pytest.mark.parametrize(
    ("described", "version"),
    [
        ("v1.2.3-0-g0a1b2c3", "1.2.3"),
        ("v1.2.3-4-g0a1b2c3", "1.2.4.dev4+g0a1b2c3"),
        ("v0.1.9-12-gabcdef0", "0.1.10.dev12+gabcdef0"),
        ("", version_of_tag.UNTAGGED),
        ("v1.2.3rc1-0-g0a1b2c3", version_of_tag.UNTAGGED),
    ],
)
def test_a_tag_and_the_commits_behind_it_make_the_version(described: str, version: str) -> None:
    assert version_of_tag.of_description(described) == version


def test_a_tagged_commit_has_its_version_and_the_next_one_is_ahead_of_it(tmp_path: Path) -> None:
    def git(*arguments: str) -> None:
        who = ["-c", "user.name=A", "-c", "user.email=a@example.org", "-c", "commit.gpgsign=false"]
        subprocess.run(["git", "-C", tmp_path, *who, *arguments], check=True, capture_output=True)

    git("init", "--quiet")
    git("commit", "--quiet", "--allow-empty", "--message", "One")
    assert version_of_tag.version(tmp_path) == version_of_tag.UNTAGGED
    git("tag", "v2.0.0")
    git("tag", "measured-in-may")
    assert version_of_tag.version(tmp_path) == "2.0.0"
    git("commit", "--quiet", "--allow-empty", "--message", "Two")
    assert version_of_tag.version(tmp_path).startswith("2.0.1.dev1+g")


def test_what_a_source_distribution_was_packed_as_it_stays(tmp_path: Path) -> None:
    (tmp_path / "PKG-INFO").write_text("Metadata-Version: 2.4\nName: gyrohil\nVersion: 3.1.4\n")
    assert version_of_tag.version(tmp_path) == "3.1.4"


def test_a_copy_without_history_has_the_version_of_none(tmp_path: Path) -> None:
    assert version_of_tag.version(tmp_path) == version_of_tag.UNTAGGED
    cited = (TREE / "CITATION.cff").read_text(encoding="utf-8")
    assert f"\nversion: {version_of_tag.UNTAGGED}\n" in cited
