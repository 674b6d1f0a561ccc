"""Files appear whole or not at all."""

import os

import pytest

from jaxcontact._whole_files import write_all


def test_all_are_written(tmp_path):
    contents = {tmp_path / "a" / "x": b"1", tmp_path / "y": b"2"}
    write_all(contents)
    assert {path: path.read_bytes() for path in contents} == contents
    assert {p.name for p in tmp_path.iterdir()} == {"a", "y"}


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
