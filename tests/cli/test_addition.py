"""A bench file with an effect added: the rest of it stays, comments and all."""

from pathlib import Path

import pytest

from hil.addition import Addition, add_effects
from hil.bench import load_bench
from hil.emulation import located
from hil.errors import InputError
from hil.examples import find

CUBIC = Addition("cubic_stiffness", "found in ride", {"k3x": (9.97e12, "± 2e10 1/(m²·s²)"), "k3y": (3e12, "")})
LINE = Addition("interference:2", "", {"ax:2": (1e-9, "m"), "ω": (311.0, "rad/s")})
GAIN = Addition("sense_gain", "found in ride", {"gy": (-0.01, "")})


def test_the_rest_of_the_file_stays_as_it_is(tmp_path: Path) -> None:
    source = find("bench", "s-undeclared")
    add_effects(source, tmp_path / "new.bench.toml", [CUBIC, GAIN])
    new = (tmp_path / "new.bench.toml").read_text(encoding="utf-8")
    old = source.read_text(encoding="utf-8")
    for line in old.splitlines():
        assert line in new or line.startswith("url")
    bench = load_bench(tmp_path / "new.bench.toml")
    assert bench.effects == {"cubic_stiffness": {"k3x": 9.97e12, "k3y": 3e12}, "sense_gain": {"gy": -0.01}}
    assert bench.model_copy(update={"effects": {}, "link": None}) == load_bench(source).model_copy(
        update={"link": None}
    )
    assert "# ± 2e10 1/(m²·s²)" in new


def test_the_board_beside_the_old_file_is_found_from_the_new_one(tmp_path: Path) -> None:
    for name in ("old", "new"):
        (tmp_path / name).mkdir()
    board = tmp_path / "old" / "mine.scenario.toml"
    board.write_text(find("scenario", "s-slow").read_text(encoding="utf-8"), encoding="utf-8")
    text = find("bench", "s-slow").read_text(encoding="utf-8").replace("s-slow.scenario.toml", board.name)
    source, target = tmp_path / "old" / "mine.bench.toml", tmp_path / "new" / "mine.bench.toml"
    source.write_text(text, encoding="utf-8")
    add_effects(source, target, [GAIN])
    url = load_bench(target).link.url
    assert url is not None
    assert located(url, beside=target) == f"pty:{board.resolve()}"
    add_effects(source, tmp_path / "old" / "again.bench.toml", [GAIN])
    assert load_bench(tmp_path / "old" / "again.bench.toml").link.url == f"pty:{board.name}"


def test_more_can_be_added_to_what_is_there(tmp_path: Path) -> None:
    first, second = tmp_path / "first.bench.toml", tmp_path / "second.bench.toml"
    add_effects(find("bench", "s-slow"), first, [GAIN])
    add_effects(first, second, [CUBIC, LINE])
    effects = load_bench(second).effects
    assert set(effects) == {"sense_gain", "cubic_stiffness", "interference:2"}
    assert effects["interference:2"] == {"ax:2": 1e-9, "ω": 311.0}
    with pytest.raises(InputError, match=r"\[effects.sense_gain\] is declared already"):
        add_effects(second, tmp_path / "third.bench.toml", [GAIN])
    assert not (tmp_path / "third.bench.toml").exists()


def test_a_form_that_cannot_be_added_to_is_refused(tmp_path: Path) -> None:
    text = find("bench", "s-slow").read_text(encoding="utf-8")
    source = tmp_path / "inline.bench.toml"
    source.write_text("effects = {sense_gain = {gy = 0.0}}\n" + text, encoding="utf-8")
    with pytest.raises(InputError, match="one table per effect"):
        add_effects(source, tmp_path / "new.bench.toml", [CUBIC])
