"""Put machine code into a copy of a wheel, so that a first plan compiles nothing: ``ship_loops.py WHEEL FOLDER``.

The copy is for this version of Python and this system. Pip prefers it to the wheel for all.
"""

from __future__ import annotations

import base64
import hashlib
import sys
import sysconfig
import zipfile
from pathlib import Path

PLACE = "ground/shipped"


def main(wheel: Path, folder: Path) -> None:
    """Write the new wheel beside the old one, and print its path.

    Parameters
    ----------
    wheel : Path
        Of pure Python.
    folder : Path
        Its ``.nbc`` files are put in, however deep they are.
    """
    system = sysconfig.get_platform().replace("-", "_").replace(".", "_")
    tag = f"cp{sys.version_info[0]}{sys.version_info[1]}-none-{system}"
    with zipfile.ZipFile(wheel) as old:
        files = {name: old.read(name) for name in old.namelist()}
    for path in sorted(folder.rglob("*.nbc")):
        files[f"{PLACE}/{path.name}"] = path.read_bytes()
    (about,) = (name for name in files if name.endswith(".dist-info/WHEEL"))
    text = files[about].decode()
    text = text.replace("Tag: py3-none-any", f"Tag: {tag}")
    files[about] = text.replace("Root-Is-Purelib: true", "Root-Is-Purelib: false").encode()
    record = about.replace("WHEEL", "RECORD")
    del files[record]
    lines = [f"{name},sha256={_digest(data)},{len(data)}" for name, data in files.items()]
    files[record] = "\n".join([*lines, f"{record},,", ""]).encode()
    name, version, *_ = wheel.name.split("-")
    path = wheel.with_name(f"{name}-{version}-{tag}.whl")
    with zipfile.ZipFile(path, "w", zipfile.ZIP_DEFLATED) as new:
        for place, data in files.items():
            new.writestr(place, data)
    print(path)


def _digest(data: bytes) -> str:
    return base64.urlsafe_b64encode(hashlib.sha256(data).digest()).rstrip(b"=").decode()


if __name__ == "__main__":
    main(Path(sys.argv[1]), Path(sys.argv[2]))
