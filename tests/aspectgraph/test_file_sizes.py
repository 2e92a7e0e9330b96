"""No more of a file than a limit is held."""

import pytest

from aspectgraph import files


@pytest.mark.parametrize(("large", "most"), [(False, 12), (True, 20)])
def test_a_file_is_read_up_to_its_limit(tmp_path, monkeypatch, large, most):
    monkeypatch.setattr(files, "SMALL_FILE_BYTES", 12)
    monkeypatch.setattr(files, "LARGE_FILE_BYTES", 20)
    path = tmp_path / "file"
    path.write_text("é\r\n" + "x" * (most - 4), encoding="utf-8")
    assert path.stat().st_size == most
    assert files.read_text(path, large=large) == "é\n" + "x" * (most - 4)
    path.write_bytes(path.read_bytes() + b"x")
    with pytest.raises(OSError, match=r"it has more than .* MB"):
        files.read_text(path, large=large)


def test_a_file_without_end_is_refused(monkeypatch):
    monkeypatch.setattr(files, "SMALL_FILE_BYTES", 1000)
    with pytest.raises(OSError, match=r"it has more than 0\.001 MB"):
        files.read_text("/dev/zero")
