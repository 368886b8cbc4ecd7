"""Covariance matrix adaptation: a search whose result is the mean of many candidates, which averages out chance.

N. Hansen, The CMA Evolution Strategy: A Tutorial, 2016 (arXiv:1604.00772), with its default constants. Only the order
of the costs counts. Candidates of one generation have the same noise, those of the next another one.
"""

from __future__ import annotations

import math
from collections.abc import Callable

import numpy as np

from optid.core.model import Array

Cost = Callable[[Array, int], Array]


def evolution_strategy(
    cost: Cost, start: Array, spread: float, generations: int, rng: np.random.Generator, count: int = 12
) -> Array:
    """The mean of the last generation's better half, a point (n,) of the unit cube.

    Args:
        cost: of points (count, n) in a generation, by its number: shape (count,); infinite ends the search.
        start: point (n,).
        spread: sd of the first generation.
        generations: number of generations.
        rng: source of everything random.
        count: of candidates in a generation.
    """
    n, half = start.size, count // 2
    weights = math.log(half + 0.5) - np.log(np.arange(1.0, half + 1))
    weights /= weights.sum()
    mass = 1.0 / float(np.sum(weights**2))
    c_sigma, c_path = (mass + 2) / (n + mass + 5), (4 + mass / n) / (n + 4 + 2 * mass / n)
    c_one = 2 / ((n + 1.3) ** 2 + mass)
    c_mean = min(1 - c_one, 2 * (mass - 2 + 1 / mass) / ((n + 2) ** 2 + mass))
    damping = 1 + 2 * max(0.0, math.sqrt((mass - 1) / (n + 1)) - 1) + c_sigma
    usual = math.sqrt(n) * (1 - 1 / (4 * n) + 1 / (21 * n**2))  # length of a standard normal vector
    mean, sigma, covariance = start.copy(), spread, np.eye(n)
    path_sigma, path = np.zeros(n), np.zeros(n)
    for generation in range(generations):
        values, axes = np.linalg.eigh(covariance)
        root = axes * np.sqrt(np.maximum(values, 1e-20))
        points = np.clip(mean + sigma * rng.standard_normal((count, n)) @ root.T, 0.0, 1.0)
        costs = cost(points, generation)
        if not np.any(np.isfinite(costs)):
            break
        steps = (points[np.argsort(costs, kind="stable")[:half]] - mean) / sigma
        moved = weights @ steps
        mean = mean + sigma * moved
        white = axes @ ((axes.T @ moved) / np.sqrt(np.maximum(values, 1e-20)))
        path_sigma = (1 - c_sigma) * path_sigma + math.sqrt(c_sigma * (2 - c_sigma) * mass) * white
        length = float(np.linalg.norm(path_sigma))
        on = length / math.sqrt(1 - (1 - c_sigma) ** (2 * generation + 2)) < (1.4 + 2 / (n + 1)) * usual
        path = (1 - c_path) * path + on * math.sqrt(c_path * (2 - c_path) * mass) * moved
        lost = c_one * (1 - on) * c_path * (2 - c_path)
        covariance = (
            (1 - c_one - c_mean + lost) * covariance
            + c_one * np.outer(path, path)
            + c_mean * (steps.T * weights) @ steps
        )
        sigma = min(sigma * math.exp(c_sigma / damping * (length / usual - 1)), 2.0 * spread)
    return mean
