"""Files are written completely or not at all."""

import os

import pytest

from jaxcontact import load_calibration, read_recording, read_scene
from jaxcontact._text import files as _whole_files
from jaxcontact._text.files import write_all
from jaxcontact.lab.cli.options import InputError, output_path


def test_all_are_written(tmp_path):
    contents = {tmp_path / "a" / "x": b"1", tmp_path / "y": b"2"}
    write_all(contents | {tmp_path / "z": lambda file: file.write(b"12")})
    assert {path: path.read_bytes() for path in contents} == contents
    assert (tmp_path / "z").read_bytes() == b"12"
    assert {p.name for p in tmp_path.iterdir()} == {"a", "y", "z"}


def test_others_may_read_what_the_umask_lets_them(tmp_path):
    old = os.umask(0o027)
    try:
        write_all({tmp_path / "x": b"1"})
    finally:
        os.umask(old)
    assert (tmp_path / "x").stat().st_mode & 0o777 == 0o640


def test_a_failure_leaves_the_old_and_no_scraps(tmp_path):
    old = tmp_path / "x"
    old.write_bytes(b"old")
    with pytest.raises(TypeError):
        write_all({old: b"new", tmp_path / "y": "no bytes"})
    assert old.read_bytes() == b"old"
    assert [p.name for p in tmp_path.iterdir()] == ["x"]


def test_a_failure_while_renaming_leaves_no_scraps(tmp_path, monkeypatch):
    def refuse(source, target):
        raise PermissionError("no")

    monkeypatch.setattr(os, "replace", refuse)
    with pytest.raises(PermissionError):
        write_all({tmp_path / "x": b"1", tmp_path / "y": b"2"})
    assert list(tmp_path.iterdir()) == []


@pytest.mark.parametrize("failure", [OSError(28, "No space left on device"), KeyboardInterrupt()])
def test_a_full_disk_or_an_interrupt_leaves_the_old(tmp_path, failure):
    (tmp_path / "x").write_bytes(b"old")

    def fail(file):
        file.write(b"half")
        raise failure

    with pytest.raises(type(failure)):
        write_all({tmp_path / "y": b"new", tmp_path / "x": fail})
    assert [p.name for p in tmp_path.iterdir()] == ["x"]
    assert (tmp_path / "x").read_bytes() == b"old"


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
