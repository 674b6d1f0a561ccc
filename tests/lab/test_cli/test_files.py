"""Files are written completely or not at all."""

import os

import pytest

from jaxcontact import load_calibration, read_recording, read_scene
from jaxcontact._text import files as _whole_files
from jaxcontact._text.files import write_all
from jaxcontact.lab.cli.options import InputError, output_path


def test_all_are_written_as_the_umask_lets_others_read(tmp_path):
    contents = {tmp_path / "a" / "x": b"1", tmp_path / "y": b"2"}
    old = os.umask(0o027)
    try:
        write_all(contents | {tmp_path / "z": lambda file: file.write(b"12")})
    finally:
        os.umask(old)
    assert {path: path.read_bytes() for path in contents} == contents
    assert (tmp_path / "z").read_bytes() == b"12"
    assert {p.name for p in tmp_path.iterdir()} == {"a", "y", "z"}
    assert (tmp_path / "y").stat().st_mode & 0o777 == 0o640


FULL, STOPPED, REFUSED = OSError(28, "No space left on device"), KeyboardInterrupt(), OSError("no")


@pytest.mark.parametrize("failure", [TypeError(), FULL, STOPPED, REFUSED], ids=repr)
def test_a_failure_leaves_the_old_and_no_scraps(tmp_path, monkeypatch, failure):
    """Of the content, the disk and the user while writing; or while renaming."""
    old = tmp_path / "x"
    old.write_bytes(b"old")

    def fail(*unused):
        raise failure

    contents: dict = {tmp_path / "y": b"new", old: fail}
    if failure is REFUSED:
        monkeypatch.setattr(os, "replace", fail)
        contents[old] = b"new"
    if isinstance(failure, TypeError):
        contents[old] = "no bytes"
    with pytest.raises(type(failure)):
        write_all(contents)
    assert old.read_bytes() == b"old" and [p.name for p in tmp_path.iterdir()] == ["x"]


def test_a_folder_a_pipe_and_a_device_are_not_replaced(tmp_path):
    os.mkfifo(tmp_path / "pipe.csv")
    (tmp_path / "folder.csv").mkdir()
    (tmp_path / "device.csv").symlink_to("/dev/null")
    for name, words in (("pipe", "pipe"), ("folder", "folder"), ("device", "a device")):
        path = tmp_path / f"{name}.csv"
        with pytest.raises(InputError, match=rf"--out .*{name}.csv: is a .*{words}"):
            output_path("--out", str(path), (".nc", ".csv"))
        with pytest.raises(FileExistsError, match="is a folder, a pipe or a device"):
            write_all({path: b"1"})


@pytest.mark.parametrize("read", [read_recording, load_calibration, read_scene])
def test_what_is_too_large_is_not_read(read, tmp_path, monkeypatch):
    monkeypatch.setattr(_whole_files, "MOST_BYTES", 2**20)
    large = tmp_path / "large"
    large.write_bytes(bytes(2**20 + 1))
    for path in (large, "/dev/zero"):
        with pytest.raises(ValueError, match="must hold at most 1 MiB, but holds more"):
            read(path)
