"""Seeded damage to files: bytes, numbers of texts, values of JSON documents."""

from __future__ import annotations

import copy
import json
import re
import struct

import numpy as np

NUMBER = re.compile(rb"(?<![A-Za-z_#0-9.])[-+]?[0-9]+\.?[0-9]*(?:[eE][-+]?[0-9]+)?")
WORDS = (
    b"",
    b"x",
    b"-1",
    b"0",
    b"1_0",
    b"1e999",
    b"-1e308",
    b"nan",
    b"inf",
    b"1.5",
    b"99999999999999999999",
    b"1.2.3",
)
VALUES = (
    None,
    True,
    -1,
    0,
    1,
    10**6,
    10**30,
    1.5,
    1e300,
    -1e300,
    float("nan"),
    float("inf"),
    "x",
    "",
    [],
    [0],
    {},
    [[]],
)


def damaged_bytes(data: bytes, rng: np.random.Generator) -> bytes:
    """One to three cuts, losses, repetitions or changed bytes."""
    for _ in range(rng.integers(1, 4)):
        at, other = rng.integers(len(data), size=2)
        kind = rng.integers(5)
        if kind == 0:
            data = data[:at]
        elif kind == 1:
            data = data[:at] + data[at + rng.integers(1, 40) :]
        elif kind == 2:
            data = data[:at] + data[other : other + 30] + data[at:]
        else:
            new = rng.integers(256) if kind == 3 else rng.choice(list(b"0123456789.-e \n"))
            data = data[:at] + bytes([new]) + data[at + 1 :]
        data = data or b"x"
    return data


def damaged_numbers(data: bytes, rng: np.random.Generator) -> bytes:
    """One number replaced, or one of its characters."""
    found = list(NUMBER.finditer(data))
    start, end = found[rng.integers(len(found))].span()
    kind = rng.integers(4)
    if kind == 0:
        return data[:start] + WORDS[rng.integers(len(WORDS))] + data[end:]
    at = int(rng.integers(start, end))
    if kind == 1:
        return data[:at] + data[at + 1 :]
    pool = b"0123456789" if kind == 2 else b"0123456789.-+eE_,( )abOlI'"
    return data[:at] + bytes([pool[rng.integers(len(pool))]]) + data[at + 1 :]


def damaged_json(document, rng: np.random.Generator):
    """One value of a document removed or replaced."""
    document = copy.deepcopy(document)
    places = list(_places(document))
    holder, key = places[rng.integers(len(places))]
    if rng.integers(4) == 0:
        del holder[key]
    else:
        holder[key] = VALUES[rng.integers(len(VALUES))]
    return document


def _places(value):
    keys = (
        list(value)
        if isinstance(value, dict)
        else range(len(value))
        if isinstance(value, list)
        else ()
    )
    for key in keys:
        yield value, key
        yield from _places(value[key])


def damaged_glb(data: bytes, rng: np.random.Generator) -> bytes:
    """One to two values of the JSON of a GLB file removed or replaced."""
    size = struct.unpack_from("<I", data, 12)[0]
    document = json.loads(data[20 : 20 + size])
    for _ in range(rng.integers(1, 3)):
        document = damaged_json(document, rng)
    return with_json(document, data[20 + size :])


def with_json(document, rest: bytes) -> bytes:
    """GLB file of a JSON document and the chunks after it."""
    head = json.dumps(document).encode()
    head += b" " * (-len(head) % 4)
    return (
        struct.pack("<4sIII4s", b"glTF", 2, 20 + len(head) + len(rest), len(head), b"JSON")
        + head
        + rest
    )


ENCODINGS = (
    "utf-16", "utf-32", "utf-7", "latin-1", "utf-8-sig", "cp500", "shift_jis", "idna", "rot13", "hex", "punycode",
    "nonsense", "", "UTF-9", "unicode_escape", "undefined", "gb18030",
)  # fmt: skip
XML_WORDS = (
    b"", b"x", b"-1", b"nan", b"inf", b"1e999", b"9" * 30, b"9" * 5000, b"true", b"int", b"double", b"[1]", b"{}",
    b"[{}]", b"[" * 3000, b"<a/>", b"&x;", b"1_0",
)  # fmt: skip
XML_PIECE = re.compile(rb"[\w.:]+=\"[^\"]*\"|<[^<>]*>|>[^<>]+<")


def damaged_encoding(data: bytes, rng: np.random.Generator) -> bytes:
    """Another encoding, another one declared."""
    actual, declared = (ENCODINGS[i] for i in rng.integers(len(ENCODINGS), size=2))
    text = re.sub("encoding=['\"][^'\"]*['\"]", f"encoding='{declared}'", data.decode())
    try:
        return text.encode(actual)
    except (LookupError, UnicodeError):
        return text.encode("latin-1", "replace")


def damaged_xml(data: bytes, rng: np.random.Generator) -> bytes:
    """One to two tags, attributes or texts lost, doubled or replaced."""
    for _ in range(rng.integers(1, 3)):
        pieces = list(XML_PIECE.finditer(data))
        piece = pieces[rng.integers(len(pieces))]
        old = piece[0]
        word = XML_WORDS[rng.integers(len(XML_WORDS))]
        kind = rng.integers(4)
        if kind == 0:
            new = b""
        elif kind == 1:
            new = old + b" " + old
        elif old.startswith(b">"):
            new = b">" + word + b"<"
        elif old.startswith(b"<"):
            new = old
        else:
            new = old.split(b"=")[0] + b'="' + word.replace(b"<", b"") + b'"'
        data = data[: piece.start()] + new + data[piece.end() :]
    return data
