"""The check on held-out trials: its interval beside true differences, and a wrong law."""

import dataclasses

import jax
import numpy as np
import pytest

import jaxcontact as jc
from jaxcontact.lab.choice.held_out import held_out
from jaxcontact.lab.choice.kinds import kinds_of
from jaxcontact.lab.choice.table import ChoiceTable, errors_of
from jaxcontact.lab.pairs.outliers import find_outliers
from jaxcontact.lab.pairs.pairs import pairs_of

TRIALS, EACH, TABLES = 16, 6, 200
OWN, COMMON = 0.01, 0.01
"""Standard deviations of ln e, from bounce to bounce and from trial to trial."""


def table_of(seed, slope=0.0):
    """A table of trials, with e = 0.8 + slope (v - 1); the last trials are the fastest."""
    rng = np.random.default_rng(seed)
    v = np.linspace(0.5, 1.5, TRIALS)[:, None] + 0.1 * rng.random((TRIALS, EACH))
    noise = COMMON * rng.standard_normal((TRIALS, 1)) + OWN * rng.standard_normal((TRIALS, EACH))
    e = np.exp(np.log(0.8 + slope * (v - 1)) + noise)
    trial = np.repeat(np.arange(TRIALS), EACH)
    pairs = dataclasses.replace(pairs_of(v.ravel(), e.ravel(), None), cluster=trial)
    outliers, keep = find_outliers(pairs), np.ones(TRIALS * EACH, bool)
    return ChoiceTable(pairs, keep, errors_of(pairs, outliers, keep), jc.Contact(1.0, 1.0))


def checked(table, kind="exact"):
    names = tuple(f"trial {k}" for k in range(TRIALS))
    with jax.enable_x64(True):
        kinds = {one.law: one for one in kinds_of("all", 1.5)}
        return held_out(table, kinds[kind], names)


@pytest.fixture(scope="module")
def checks():
    return [checked(table_of(seed)) for seed in range(TABLES)]


def test_the_interval_holds_in_95_of_100_tables(checks):
    """Of 200 tables 95 ± 1.5 % hold."""
    part = np.mean([one.agrees for one in checks])
    assert 0.95 - 3 * 0.0154 < part < 0.95 + 3 * 0.0154
    # Errors that took pairs as independent would be smaller by a factor of 1.9.
    off = [one.measured - one.predicted for one in checks]
    typical = 0.8 * COMMON * np.sqrt((1 + OWN**2 / COMMON**2 / EACH) * (1 / 4 + 1 / 12))
    np.testing.assert_allclose(np.std(off), typical, rtol=3 / np.sqrt(2 * TABLES))


def test_what_was_held_out_is_named(checks):
    assert checks[0].held == ("trial 3", "trial 7", "trial 11", "trial 15")
    assert checks[0].trials == TRIALS and checks[0].pairs == 4 * EACH


def test_trials_of_another_ball_are_not_within_the_error():
    table = table_of(0)
    other = np.isin(table.pairs.cluster, [3, 7, 11, 15])
    e = np.where(other, 1.1, 1.0) * table.pairs.restitution
    wrong = dataclasses.replace(table, pairs=dataclasses.replace(table.pairs, restitution=e))
    found = checked(wrong)
    assert not found.agrees
    np.testing.assert_allclose(found.measured / found.predicted, 1.1, atol=0.03)


def test_few_trials_and_known_correlations_have_no_check():
    table = table_of(1)
    assert checked(dataclasses.replace(table, use=table.pairs.cluster < 9)) is None
    assert checked(dataclasses.replace(table, use=table.pairs.cluster < 10)) is not None
    whole = table.errors._replace(correlation=np.eye(TRIALS * EACH))
    assert checked(dataclasses.replace(table, errors=whole)) is None
