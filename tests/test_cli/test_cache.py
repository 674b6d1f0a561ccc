"""Compiled programs are kept between commands, and nothing is lost where they cannot be."""

import os
import subprocess
import sys

import jax
import pytest

from jaxcontact._cli._cache import VARIABLE, keep_programs

EXAMPLE = "impact --law hu_guo --e 0.7 --mass 1 --stiffness 1.4e8 --velocity 4.2 --quiet".split()
OWN = "jax_compilation_cache_dir"


def command(folder, *more):
    """The example in a process of its own, without a store of JAX's; what it printed."""
    environment = {k: v for k, v in os.environ.items() if not k.startswith("JAX_")}
    environment |= {VARIABLE: str(folder)}
    done = subprocess.run(
        [sys.executable, "-m", "jaxcontact", *EXAMPLE, *more],
        env=environment,
        capture_output=True,
        text=True,
        timeout=300,
    )
    assert (done.returncode, done.stderr) == (0, "")
    return done.stdout


def programs(folder):
    return {path: path.stat().st_mtime_ns for path in folder.rglob("*-cache")}


def test_programs_are_kept_and_damaged_ones_made_again(tmp_path):
    first = command(tmp_path)
    kept = programs(tmp_path)
    assert kept
    assert command(tmp_path) == first
    assert programs(tmp_path) == kept
    for path in kept:
        path.write_bytes(b"damaged")
    assert command(tmp_path) == first


@pytest.fixture
def no_store():
    """JAX without a store, until the end of a test."""
    before = getattr(jax.config, OWN), jax.config.jax_persistent_cache_min_compile_time_secs
    jax.config.update(OWN, None)
    yield
    jax.config.update(OWN, before[0])
    jax.config.update("jax_persistent_cache_min_compile_time_secs", before[1])


def test_nothing_is_kept_where_the_variable_is_empty(no_store, monkeypatch):
    monkeypatch.setenv(VARIABLE, "")
    keep_programs()
    assert getattr(jax.config, OWN) is None


def test_what_cannot_be_written_is_no_error(no_store, monkeypatch, tmp_path):
    (tmp_path / "file").touch()
    monkeypatch.setenv(VARIABLE, str(tmp_path / "file"))
    keep_programs()
    assert getattr(jax.config, OWN) is None


def test_a_store_of_jax_stays(no_store, monkeypatch, tmp_path):
    jax.config.update(OWN, str(tmp_path))
    monkeypatch.setenv(VARIABLE, str(tmp_path / "other"))
    keep_programs()
    assert getattr(jax.config, OWN) == str(tmp_path)
    assert not (tmp_path / "other").exists()


def test_without_a_variable_the_users_folder_is_taken(no_store, monkeypatch, tmp_path):
    monkeypatch.delenv(VARIABLE, raising=False)
    monkeypatch.setenv("XDG_CACHE_HOME", str(tmp_path))
    monkeypatch.setenv("HOME", str(tmp_path))
    keep_programs()
    assert getattr(jax.config, OWN).startswith(str(tmp_path))


def test_no_cache_keeps_nothing(tmp_path):
    command(tmp_path / "none", "--no-cache")
    assert not (tmp_path / "none").exists()
