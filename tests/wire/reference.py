"""COBS and CRC-32C once more, from their definitions, so that the wire is not tested against itself."""


def crc32c(data: bytes) -> int:
    """Bit by bit: reflected polynomial 0x82F63B78, initial value and final XOR all ones."""
    register = 0xFFFFFFFF
    for byte in data:
        register ^= byte
        for _ in range(8):
            register = register >> 1 ^ (0x82F63B78 if register & 1 else 0)
    return register ^ 0xFFFFFFFF


def cobs_decode(data: bytes) -> bytes:
    """Cheshire and Baker 1999: code n means: n − 1 bytes follow, then a zero unless n = 255 or the end."""
    out = bytearray()
    place = 0
    while place < len(data):
        code = data[place]
        chunk = data[place + 1 : place + code]
        assert code
        assert len(chunk) == code - 1
        assert 0 not in chunk
        out += chunk
        place += code
        if code < 255 and place < len(data):
            out.append(0)
    return bytes(out)


def open_frame(frame: bytes) -> bytes:
    """Header and payload of one intact frame with its delimiters."""
    assert frame[0] == frame[-1] == 0
    body = cobs_decode(frame[1:-1])
    assert crc32c(body[:-4]) == int.from_bytes(body[-4:], "little")
    return body[:-4]
