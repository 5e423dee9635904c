"""The DBC: current, loadable, and an independent reading of the golden CAN frames by cantools."""

import json
from pathlib import Path
from typing import Any

import cantools.database
import pytest
from cantools.database import Database

from hil.wire.spec import SPEC

FILE = Path(__file__).parents[2] / "firmware" / "gyrohil.dbc"
VECTORS = json.loads((Path(__file__).parents[1] / "wire" / "golden.json").read_text(encoding="utf-8"))
COLUMNS = [field.name for field in SPEC.messages["SENSE"].rows]


@pytest.fixture(scope="module")
def database() -> Database:
    loaded = cantools.database.load_file(FILE)
    assert isinstance(loaded, Database)
    return loaded


@pytest.mark.moderate
def test_every_message_is_there_with_its_frame_format(database: Database) -> None:
    names = {message.name for message in database.messages}
    assert names == {*SPEC.messages, *SPEC.can.classic, "TIME_SYNC_ANSWER"}
    assert {message.name for message in database.messages if not message.is_fd} == SPEC.can.classic.keys()
    assert database.get_message_by_name("SENSE").senders == ["BOARD"]
    assert database.get_message_by_name("ARM").senders == ["HOST"]


def test_values_have_their_names(database: Database) -> None:
    states = database.get_message_by_name("STATUS").get_signal_by_name("state").choices
    assert states is not None
    assert {int(value): str(name) for value, name in states.items()}[4] == "SAFE"
    registers = database.get_message_by_name("REGISTER_WRITE").get_signal_by_name("register").choices
    assert registers is not None
    assert str(registers[SPEC.registers["BLOCK"].id]) == "BLOCK"


def decoded(database: Database, frame: dict[str, Any]) -> tuple[str, dict[str, Any]]:
    """Message and signals of a golden CAN frame of whatever node, as numbers."""
    identifier = int(frame["id"], 16) & ~((SPEC.can.nodes - 1) << SPEC.can.node_shift)
    message = database.get_message_by_frame_id(identifier)
    signals = message.decode(bytes.fromhex(frame["data"]), decode_choices=False, allow_truncated=True)
    assert isinstance(signals, dict)
    return message.name, signals


@pytest.mark.parametrize("vector", VECTORS["frames"], ids=lambda vector: vector["name"])
def test_golden_frames(database: Database, vector: dict[str, Any]) -> None:
    expected = dict(vector["fields"])
    first = vector["can"][0]
    name, found = decoded(database, first)
    assert name.removesuffix("_ANSWER") == vector["message"]
    assert (found["seq"], found["tick"]) == (vector["seq"], vector["tick"])
    if "codes" in expected:
        rows = expected.pop("codes")
        wide = "_wide" * (expected.pop("width") == 3)
        at = 0
        for frame in vector["can"]:
            _, found = decoded(database, frame)
            for row in range(found["n"]):
                assert [found[f"{column}{wide}_{row}"] for column in COLUMNS] == rows[at]
                at += 1
        assert at == len(rows)
    for field in SPEC.messages[vector["message"]].fields:
        if field.type == "text":  # which DBC does not know
            expected.pop(field.name)
    several = vector["message"] in ("ESTIMATE", "TRIM_OUTPUT")  # later parts have fields of their own
    for frame in vector["can"][1:] if several else ():
        found |= {name: value for name, value in decoded(database, frame)[1].items() if name not in found}
    for field, value in expected.items():
        if isinstance(value, list):
            assert [found[f"{field}_{k}"] for k in range(len(value))] == value
        else:
            assert found.get(f"{vector['message'].lower()}_{field}", found.get(field)) == value


def test_brief_status_beside_a_status(database: Database) -> None:
    (vector,) = [v for v in VECTORS["frames"] if v["message"] == "STATUS" and v["fields"]["late"] == 0]
    name, found = decoded(database, vector["can"][-1])
    assert name == "STATUS_BRIEF"
    assert found == {field: vector["fields"][field] for field in found}
