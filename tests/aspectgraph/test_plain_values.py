"""Values of files that people write: neither deeper nor longer than code that prints them can bear."""

import pytest

from aspectgraph import EntityError, read_entities, read_solid
from aspectgraph.files import DEEPEST, check_plain
from planner import Camera, CameraError
from planner.app.job import read_lighting
from planner.app.options import Light
from planner.exceptions import RequestError
from planner.request.dimension_files import read_wanted

# twice what Python recurses; TOML readers take the square of that in time
KEY = ".".join(["a"] * 2000)
DEEP = f"{KEY} = 1\n"
TABLE = f"[{KEY}]\nx = 1\n"
# hexadecimal digits have no limit in Python
LONG = f"a = 0x{'f' * 100_000}\n"


@pytest.fixture(scope="module")
def block():
    return read_solid("examples/two_pocket_block.off")


@pytest.mark.parametrize("text", [DEEP, TABLE, LONG])
def test_entities_dimensions_cameras_and_lamps_refuse_them(tmp_path, block, text):
    path = tmp_path / "values.toml"
    path.write_text(text)
    with pytest.raises(EntityError, match=r"nested too deep|too many digits"):
        read_entities(path, block)
    with pytest.raises(RequestError, match=r"nested too deep|too many digits"):
        read_wanted(path, ("length",))
    with pytest.raises(CameraError, match=r"nested too deep|too many digits"):
        Camera.from_toml(path)


@pytest.mark.parametrize("text", [DEEP, "lamps = " + "[" * 20_000 + "]" * 20_000, LONG])
def test_a_file_of_lamps_refuses_them(tmp_path, text):
    path = tmp_path / "lamps.toml"
    path.write_text(text)
    options = Light(light=str(path), grey_step=0.02)
    with pytest.raises(RequestError, match=r"nested too deep|too many digits"):
        read_lighting(options)


@pytest.mark.parametrize("text", ["9" * 5000, "3-" + "9" * 5000, "r" + "9" * 5000])
def test_ids_of_too_many_digits_are_refused(block, text):
    with pytest.raises(EntityError, match="entities must be 'all', ids"):
        read_entities(text, block)


def test_a_csv_row_with_such_an_id_is_refused(tmp_path, block):
    path = tmp_path / "ids.csv"
    path.write_text(f"a,{'9' * 5000}\n")
    with pytest.raises(EntityError, match="a CSV row must be a name and an id"):
        read_entities(path, block)


def test_the_limit_is_exact():
    value: object = 1
    for _ in range(DEEPEST - 1):
        value = [value]
    check_plain(value)
    with pytest.raises(ValueError, match="nested too deep"):
        check_plain([value])
