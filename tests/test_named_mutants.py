"""The changes that were once not noticed (`python -m benchmarks.mutants --named`) can still be made."""

import pytest

from benchmarks.mutants.named import NAMED, Named


@pytest.mark.parametrize("named", NAMED, ids=lambda named: named.says)
def test_what_a_named_change_replaces_stands_in_the_source_once(named: Named) -> None:
    assert named.mutant().line > 0
