"""The task of moving a small axis by 6 cm."""

import pytest

from optid.pid.controller import Settings
from optid.tune.demand import step
from optid.tune.plant import plant_of
from optid.tune.task import Task
from tests.tune.small_axis import T, axis


@pytest.fixture(scope="session")
def model():
    return axis()


@pytest.fixture(scope="session")
def task(model):
    return Task((plant_of(model),), (step(0.06, 500, T),), Settings(T, -1, 1))
