"""Compiled programs are kept between commands, which also work without; files are written whole."""

import os
import subprocess
import sys

import jax
import pytest

import jaxcontact as jc
from jaxcontact import load_calibration, read_recording, read_scene
from jaxcontact._cache import VARIABLE
from jaxcontact._text import files as _whole_files
from jaxcontact._text.files import write_all
from jaxcontact.lab.cli import keep_programs, main
from jaxcontact.lab.cli.options import InputError, output_path

EXAMPLE = "impact --law hu_guo --e 0.7 --mass 1 --stiffness 1.4e8 --velocity 4.2 --quiet".split()
OWN = "jax_compilation_cache_dir"


@pytest.fixture
def no_store():
    """JAX without a store, until the end of a test."""
    before = getattr(jax.config, OWN), jax.config.jax_persistent_cache_min_compile_time_secs
    jax.config.update(OWN, None)
    yield
    jax.config.update(OWN, before[0])
    jax.config.update("jax_persistent_cache_min_compile_time_secs", before[1])


@pytest.mark.parametrize("folder", ["", "file"])
def test_nothing_is_kept_where_the_variable_is_empty_or_no_folder(
    no_store, monkeypatch, tmp_path, folder
):
    (tmp_path / "file").touch()
    monkeypatch.setenv(VARIABLE, folder and str(tmp_path / folder))
    keep_programs()
    assert folder or jc.cache() is None
    assert getattr(jax.config, OWN) is None


def test_without_a_variable_the_users_folder_is_taken(no_store, monkeypatch, tmp_path):
    monkeypatch.delenv(VARIABLE, raising=False)
    monkeypatch.setenv("XDG_CACHE_HOME", str(tmp_path))
    monkeypatch.setenv("HOME", str(tmp_path))
    keep_programs()
    assert getattr(jax.config, OWN).startswith(str(tmp_path))


def test_no_cache_keeps_nothing(no_store, monkeypatch, tmp_path):
    monkeypatch.setenv(VARIABLE, str(tmp_path / "none"))
    assert main([*EXAMPLE, "--no-cache"]) == 0
    assert getattr(jax.config, OWN) is None and not (tmp_path / "none").exists()


STORE = "/jax/compilation_cache/cache_"
LIBRARY = f"""
import sys
import jax
jax.config.update("jax_enable_x64", True)
events = []
jax.monitoring.register_event_listener(lambda event, **_: events.append(event))
import jaxcontact as jc
folder = jc.cache(sys.argv[1])
jax.config.update("jax_persistent_cache_min_compile_time_secs", 0)
jc.impact(jc.HuGuo(e=0.7), jc.Contact(1.0, 1.4e8), 4.2)
print(events.count({STORE!r} + "hits"), events.count({STORE!r} + "misses"), folder)
"""


def test_programs_are_kept_and_loaded_by_the_next_process(tmp_path):
    environment = {k: v for k, v in os.environ.items() if not k.startswith("JAX")}
    words, told = [sys.executable, "-c", LIBRARY, str(tmp_path)], []
    for _ in range(2):
        done = subprocess.run(words, env=environment, capture_output=True, text=True, timeout=300)
        assert (done.returncode, done.stderr) == (0, "")
        told.append(done.stdout.split())
    (loaded, compiled, folder), (again, missing, _) = told
    assert loaded == missing == "0" and int(compiled) > 0 and int(again) > 0
    assert folder.startswith(str(tmp_path))


def test_a_damaged_program_is_no_error(no_store, monkeypatch, tmp_path, capsys):
    monkeypatch.setenv(VARIABLE, str(tmp_path))
    told = []
    for damage in (True, False):
        jax.clear_caches()
        assert main(EXAMPLE) == 0
        told.append(capsys.readouterr())
        kept = {path: path.stat().st_mtime_ns for path in tmp_path.rglob("*-cache")}
        if damage:
            # The largest, which needs the others, is damaged; they stay as they are.
            damaged = max(kept, key=lambda path: path.stat().st_size)
            damaged.write_bytes(b"damaged")
            others = kept.items() - {(damaged, kept[damaged])}
    assert told[0] == told[1] and told[0].err == ""
    assert others <= kept.items()


def test_a_given_folder_wins_and_the_users_setting_stays(no_store, monkeypatch, tmp_path):
    monkeypatch.setenv(VARIABLE, str(tmp_path / "ours"))
    jax.config.update(OWN, str(tmp_path / "own"))
    keep_programs()
    assert not (tmp_path / "ours").exists()
    assert jc.cache() == tmp_path / "own"
    assert jc.cache(tmp_path / "given").parent == tmp_path / "given"
    assert jc.cache().parent == tmp_path / "given"


@pytest.mark.parametrize("folder", ["file", 3])
def test_a_folder_that_cannot_be_written_to_is_refused(no_store, tmp_path, folder):
    (tmp_path / "file").touch()
    with pytest.raises(ValueError, match="Argument `folder` must be a folder that can be written"):
        jc.cache(tmp_path / folder if folder == "file" else folder)
    assert getattr(jax.config, OWN) is None


# Files are written completely or not at all.


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
