"""The Python of the README, word for word."""

import re
from pathlib import Path
from typing import Any

import pytest

from hil import examples
from tests.cli.conftest import in_lockstep

README = (Path(__file__).parents[2] / "README.md").read_text(encoding="utf-8")
FIND = examples.find


@pytest.mark.long
@pytest.mark.timeout(900)  # a whole trace
def test_the_block_of_the_readme_does_what_it_says(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    (block,) = re.findall(r"^```python\n(.*?)^```$", README, re.MULTILINE | re.DOTALL)
    short = tmp_path / "s-undeclared.bench.toml"  # five seconds show the effect as well as the example's length
    short.write_text(in_lockstep("s-undeclared", duration_s=5.0, settle_s=2.0), encoding="utf-8")
    monkeypatch.setattr(
        examples, "find", lambda kind, name, **places: short if kind == "bench" else FIND(kind, name, **places)
    )
    monkeypatch.chdir(tmp_path)
    shown: dict[str, Any] = {}
    exec(compile(block, "README.md", "exec"), shown)
    run, trace, better = shown["run"], shown["trace"], shown["better"]
    assert run.bench.loop.duration_s == 5.0
    assert [effect.name for effect in trace.effects] == ["cubic_stiffness"]
    assert better.bench.effects.named.keys() == {"cubic_stiffness"}
    assert better.innovation.since(2.0).values.std() < 0.7 * run.innovation.since(2.0).values.std()
    assert capsys.readouterr().out.startswith("explained [")
