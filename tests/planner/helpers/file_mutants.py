"""Damaged files, made from a good one by a seed: fields removed, retyped, negated, huge, nested; bytes cut off."""

import copy
import json
import math

# the text of a value, as no Python value can say it
RAW = {
    "<nan>": "NaN",
    "<inf>": "-Infinity",
    "<too large>": "1e999",
    "<many digits>": "9" * 5000,
    "<deep>": "[" * 100_000 + "]" * 100_000,
    "<half a character>": '"\\ud800"',
    "<twice>": '{"a": 1, "a": 2}',
}
ODD = [
    None, True, False, 0, 1, -1, 2, 0.5, 99, 1e-320, 1e300, -1e300, 10**400, 2**63, "", "x", "1", "\n\x1b", [], {},
    [[]], [1, 2, 3], {"a": {"b": []}}, {"not finite": "inf"}, {"not finite": "nan"}, {"not finite": []}, *RAW,
]  # fmt: skip


def damaged_json(data, rng):
    """Return the bytes of a JSON file with one field changed, or with some bytes changed."""
    if rng.random() < 0.15:
        return damaged_bytes(json.dumps(data).encode(), rng)
    data = copy.deepcopy(data)
    holder, key = _place(data, rng)
    _change(holder, key, rng)
    text = json.dumps(data)
    for mark, raw in RAW.items():
        text = text.replace(json.dumps(mark), raw)
    return text.encode()


def damaged_bytes(content, rng):
    """Return content cut off, or with bytes overwritten, inserted or in another encoding."""
    at = rng.randrange(len(content) + 1)
    kind = rng.randrange(5)
    if kind == 0:
        return content[:at]
    if kind == 1:
        return content[:at] + rng.randbytes(3) + content[at + 3 :]
    if kind == 2:
        return (
            content[:at]
            + rng.choice([b"\x00", b"\xff", b"{", b"]", b'"', b"-", b"9", b"\\ud800"])
            + content[at:]
        )
    if kind == 3:
        return content.decode().encode(rng.choice(["utf-16", "utf-32", "utf-8-sig"]))
    return content[at:]


def _place(data, rng):
    """Choose a field anywhere: every level is as likely to be the last."""
    while True:
        key = rng.choice(list(data)) if isinstance(data, dict) else rng.randrange(len(data))
        below = data[key]
        if not isinstance(below, dict | list) or not below or rng.random() < 0.2:
            return data, key
        data = below


def _change(holder, key, rng):
    value = holder[key]
    kind = rng.randrange(6)
    if kind == 0:
        del holder[key]
    elif kind == 1 and isinstance(value, int | float) and math.isfinite(value):
        holder[key] = rng.choice([-value, value * 1e6, value + 1, value / 2, value * (1 + 1e-3)])
    elif kind == 2 and isinstance(holder, dict):
        holder[f"{key} "] = value
    elif kind == 3 and isinstance(value, list) and value:
        rng.choice([lambda: value.append(value[0]), value.pop, value.reverse])()
    else:
        holder[key] = rng.choice(ODD)


def damaged_toml(text, rng):
    """Return the bytes of a TOML file of plain fields with one of them changed, or with some bytes changed."""
    if rng.random() < 0.3:
        return damaged_bytes(text.encode(), rng)
    odd = [
        "nan", "-inf", "1e400", "0", "-1", "true", '"x"', "[]", "[1, 2]", "[1, nan]", "[1, 2, 3]", "{}", "{a = 1}",
        "1979-05-27", "9" * 400, "9" * 5000, "[" * 5000 + "]" * 5000, "1e-320", "1e300", "[1e300, 1e-300]", "", "0x",
    ]  # fmt: skip
    lines = text.splitlines()
    at = rng.randrange(len(lines))
    name = lines[at].split(" = ")[0]
    kind = rng.randrange(5)
    if kind == 0:
        del lines[at]
    elif kind == 1:
        lines.insert(
            at,
            rng.choice(
                [lines[at], "[table]", "[[x]]", f"{name}.x = 1", "'' = 1", '"\\n" = 1', "a" * 500]
            ),
        )
    else:
        lines[at] = f"{name} = {rng.choice(odd)}"
    return "\n".join(lines).encode()
