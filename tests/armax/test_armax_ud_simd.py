"""The vector instructions do what the plain functions say, to the last bit."""

from __future__ import annotations

from collections.abc import Callable

import numba
import numpy as np
import pytest

from optid.armax import ud_factor, ud_simd

SIZES = [4, 8, 12, 16, 28]


@numba.njit
def inner(x, y, size):
    return ud_simd.inner(x, y, size)


@numba.njit
def project(U, D, psi, F, V, size):
    return ud_simd.project(U, D, psi, F, V, size)


@numba.njit
def weigh(D, F, V, size, w, fade):
    return ud_simd.weigh(D, F, V, size, w, fade)


@numba.njit
def sweep(U, V, F, G, size):
    return ud_simd.sweep(U, V, F, G, size)


@numba.njit
def shift(past, length):
    return ud_simd.shift(past, length)


@numba.njit
def enter(past, length, x):
    return ud_simd.enter(past, length, x)


@numba.njit
def copy(there, here, length):
    return ud_simd.copy(there, here, length)


@numba.njit
def move(x, y, step, size):
    return ud_simd.move(x, y, step, size)


@numba.njit
def part(s, at):
    return ud_simd.part(s, at)


def same(plain: Callable[..., float], fast: Callable[..., float], *arguments) -> None:
    """Both return the same and leave the same in every array."""
    there = [x.copy() if isinstance(x, np.ndarray) else x for x in arguments]
    assert fast(*arguments) == plain(*there)
    for here, other in zip(arguments, there, strict=True):
        assert np.array_equal(here, other)


def numbers(*shape: int) -> np.ndarray:
    rng = np.random.default_rng(shape[0])
    return rng.standard_normal(shape) * 10.0 ** rng.uniform(-3, 3, shape)


@pytest.mark.parametrize("size", SIZES)
def test_every_function_is_its_plain_twin(size):
    U = np.triu(numbers(size, size), 1) + np.eye(size)
    columns, D, psi = U.T.ravel().copy(), np.abs(numbers(size)), numbers(size + 1)[:size].copy()
    F, V, G = np.zeros(size), np.zeros(size), np.zeros(size)
    for length in (size, size - 1, size - 2, size - 3, 0):
        same(ud_factor.inner, inner, psi, D, length)
    same(ud_factor.project, project, columns, D, psi, F, V, size)
    assert pytest.approx(U.T @ psi, rel=1e-9) == F
    for w in (1.01, 0.0, -0.5 / ud_factor.inner(F, V, size)):
        same(ud_factor.weigh, weigh, D.copy(), F.copy(), V, size, w, 1.01)
    same(ud_factor.sweep, sweep, columns, V, F, G, size)
    assert pytest.approx(U @ V, rel=1e-9) == G
    same(ud_factor.move, move, D, G, -0.3, size)


@pytest.mark.parametrize("size", SIZES)
@pytest.mark.parametrize("w", [1.0, 0.3, -0.01])
def test_the_update_is_the_matrix_s(size, w):
    """P - w P psi psi' P / (1 + w psi' P psi), written with whole matrices."""
    rng = np.random.default_rng(size)
    U = np.triu(rng.standard_normal((size, size)), 1) + np.eye(size)
    D, psi = rng.uniform(0.1, 1.0, size), rng.standard_normal(size)
    P = (U * D) @ U.T
    psi /= np.sqrt(psi @ P @ psi)
    columns, F, V, G = U.T.ravel().copy(), np.zeros(size), np.zeros(size), np.zeros(size)
    news = project(columns, D, psi, F, V, size)
    beta = weigh(D, F, V, size, w, 1.25)
    sweep(columns, V, F, G, size)
    U = columns.reshape(size, size).T
    assert news == pytest.approx(1.0)
    assert beta == pytest.approx(1.0 + w)
    assert pytest.approx(P @ psi, rel=1e-9) == G
    expected = (P - w * np.outer(P @ psi, P @ psi) / (1.0 + w)) * 1.25
    assert pytest.approx(expected, rel=1e-9, abs=1e-9 * np.max(np.abs(expected))) == (U * D) @ U.T
    assert np.array_equal(np.tril(U), np.eye(size))


@pytest.mark.parametrize("length", [0, 1, 2, 4, 5, 9, 16, 31])
def test_shift_moves_everything_one_back(length):
    past = np.arange(40.0)
    same(ud_factor.shift, shift, past, length)
    assert past[1:length].tolist() == list(range(length - 1))
    assert past[max(length, 1) :].tolist() == list(range(max(length, 1), 40))


@pytest.mark.parametrize("length", [0, 4, 8, 16])
def test_the_newest_enters_in_front(length):
    past = np.arange(20.0)
    same(ud_factor.enter, enter, past, length, -1.0)
    assert past[:length].tolist() == [-1.0, *range(length - 1)][:length]
    assert past[length:].tolist() == list(range(length, 20))


@pytest.mark.parametrize("length", [0, 1, 3, 4, 7, 8, 30])
def test_copy_copies(length):
    same(ud_factor.copy, copy, np.zeros(40), np.arange(40.0), length)


def test_part_is_a_view():
    s = np.arange(10.0)
    tail = part(s, 4)
    tail[0] = -1.0
    assert s[4] == -1.0
    assert tail.tolist() == [-1.0, *range(5, 10)]
