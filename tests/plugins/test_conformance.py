"""The class of tests that authors of plug-ins inherit: over the templates, in Python and C, and the bench's own."""

from typing import ClassVar

import pytest

import hil
from hil.plugins.finding import Kind, write_template
from hil.testing.conformance import PluginConformance
from tests.plugins.compiled import library
from tests.plugins.running import HERE

pytestmark = [pytest.mark.slow, pytest.mark.usefixtures("no_sizes")]


class _Made(PluginConformance):
    """One of which the file is written first."""

    ending: ClassVar[str]
    kinds: ClassVar[tuple[Kind, ...]]

    @pytest.fixture(autouse=True, scope="class")
    @classmethod
    def _written(cls, tmp_path_factory: pytest.TempPathFactory) -> None:
        place = tmp_path_factory.mktemp("plug-in")
        for kind in cls.kinds:
            (path, *_), name = write_template(kind, place / f"{kind}{cls.ending}")
            setattr(cls, kind, library(path) if path.suffix == ".c" else f"{path.parent / name}")


class TestObserverInPython(_Made):
    ending, kinds = ".py", ("observer",)


class TestControllerInPython(_Made):
    ending, kinds = ".py", ("controller",)


class TestObserverInC(_Made):
    ending, kinds = ".c", ("observer",)


class TestBothInC(_Made):
    ending, kinds = ".c", ("observer", "controller")


class TestOwnGenerated(PluginConformance):
    @pytest.fixture(autouse=True, scope="class")
    @classmethod
    def _written(cls, tmp_path_factory: pytest.TempPathFactory) -> None:
        place = tmp_path_factory.mktemp("generated")
        hil.generate("s-slow", out=place)
        cls.observer = cls.controller = library(place / "gyro_plugin.c")

    def test_it_asks_for_nothing_beyond_the_limit(self) -> None:
        """Its limit is in the code."""
        with pytest.raises(hil.InputError, match="another limit of the drive"):
            super().test_it_asks_for_nothing_beyond_the_limit()


class TestOneThatForgetsItsLimit(PluginConformance):
    """The class finds it."""

    controller = f"{HERE / 'own.py'}:Law"

    def test_it_keeps_the_device_in_motion(self) -> None:
        """It has no hold of the energy, and needs none in a second."""

    def test_it_gets_over_samples_that_are_lost(self) -> None:
        """Likewise."""

    def test_it_asks_for_nothing_beyond_the_limit(self) -> None:
        with pytest.raises(hil.PluginError, match="the limit is"):
            super().test_it_asks_for_nothing_beyond_the_limit()


@pytest.mark.parametrize("name", ["Backwards", "Adding", "Slowing"])
def test_an_observer_whose_angle_or_rate_is_wrong_is_found(name: str) -> None:
    class Made(PluginConformance):
        observer = f"{HERE / 'own.py'}:{name}"

    with pytest.raises(AssertionError):
        Made().test_angle_and_rate_are_the_turn_of_the_board()
