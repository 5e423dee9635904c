"""What the name of a link says: parsed once into a type, by lists of what there is."""

import string

import pytest
from hypothesis import given
from hypothesis import strategies as st

from hil.wire.errors import LinkError
from hil.wire.link_name import (
    CanAdapter,
    CanInterface,
    Emulated,
    LinkName,
    SerialPort,
    UdpGroup,
    parse_link,
)

PLACES = st.text(string.ascii_letters + string.digits + "/._-äß ", min_size=1, max_size=20)
VALUES = st.text(string.ascii_letters + string.digits + "/._-%&=+?:#äß ", min_size=1, max_size=20)
NAMES = st.from_regex(r"[A-Za-z][A-Za-z0-9_]{0,10}", fullmatch=True).filter(lambda name: name != "node")
NODES = st.integers(0, 7)
GROUPS = st.builds("239.{}.{}.7:{}".format, st.integers(0, 255), st.integers(0, 255), st.integers(1, 65534))
LOCALS = st.builds("{}.0.2.{}".format, st.sampled_from([10, 127, 192]), st.integers(0, 255))
LINKS = st.one_of(
    st.builds(SerialPort, PLACES, st.integers(1, 10**12)),
    st.builds(CanInterface, PLACES.filter(lambda name: "/" not in name), NODES),
    st.builds(
        CanAdapter, st.from_regex(r"[a-z][a-z0-9_]{0,8}", fullmatch=True), PLACES, NODES,
        st.dictionaries(NAMES, VALUES, max_size=3).map(lambda options: tuple(sorted(options.items()))),
    ),
    st.builds(UdpGroup, GROUPS, st.none() | LOCALS, st.none() | VALUES),
    st.builds(Emulated, st.sampled_from(["pty", "inproc"]), PLACES),
)  # fmt: skip


@given(LINKS)
def test_a_link_by_its_name_is_that_link(link: LinkName) -> None:
    assert parse_link(link.url) == link


def parsed(text: str) -> tuple[str, LinkName | None]:
    try:
        return "", parse_link(text)
    except LinkError as error:
        return str(error), None


@given(st.one_of(st.text(max_size=60), st.builds("{}:{}".format, st.sampled_from(["serial", "can", "udp"]), st.text())))
def test_any_text_is_a_link_or_one_line(text: str) -> None:
    said, link = parsed(text)
    assert said.isprintable()
    assert link is None or parse_link(link.url) == link


@pytest.mark.parametrize(
    ("text", "words"),
    [
        ("udp:239.0.0.1:4242?interface=127.0.0.1&k%65y=/etc/passwd", "bad option"),
        ("udp:239.0.0.1:4242?key=a&key=b", "key is given twice"),
        ("udp:239.0.0.1:4242?key=a&KEY=b", "bad option"),
        ("udp:239.0.0.1:4242?key=a&", "bad option"),
        ("udp:239.0.0.1:4242?key", "bad option"),
        ("udp:239.0.0.1:4242?key=a%00b", "control character"),
        ("udp:239.0.0.1:4242?key=%ff", "not UTF-8"),
        ("udp:239.0.0.1:4242?interface=127.0.0.1&interface=10.0.0.1", "interface is given twice"),
        ("serial:/dev/tty\0", "control character"),
        ("serial:/dev/ttyACM0\n", "control character"),
        ("serial:/dev/tty\u202eACM0", "control character"),
        ("serial:/dev/ttyACM0?baud=" + "9" * 5000, "no link has more than"),
        ("serial:/dev/ttyACM0?baud=" + "9" * 400, "bad option"),
        ("serial:/dev/ttyACM0?baud=٣", "bad option"),
        ("serial:?baud=9600", "bad option"),
        ("can:../../x", "bad option"),
        ("can::can0", "expected can:INTERFACE:CHANNEL"),
        ("can:slcan:?bitrate=1", "expected can:INTERFACE:CHANNEL"),
        ("can:../x:y", "expected can:INTERFACE:CHANNEL"),
        ("can:can0?node=٣", "node ٣"),
        ("can:virtual:a?node=1&node=2", "node is given twice"),
        ("can:virtual:a?%66d=1", "bad option"),
        ("tcp:localhost:1", "unknown kind of link"),
        ("", "unknown kind of link"),
        ("SERIAL:/dev/ttyACM0", "unknown kind of link"),
    ],
)
def test_what_is_refused(text: str, words: str) -> None:
    with pytest.raises(LinkError) as refused:
        parse_link(text)
    assert words in str(refused.value)
    assert str(refused.value).isprintable()
