"""The task of moving a small axis by 6 cm."""

import pytest

from optid.pid.controller import Settings
from optid.tuning.plant import plant_of
from optid.tuning.scenarios import step
from optid.tuning.task import Task
from tests.tuning.small_axis import T, axis


@pytest.fixture(scope="session")
def model():
    return axis()


@pytest.fixture(scope="session")
def task(model):
    return Task((plant_of(model),), (step(0.06, 500, T),), Settings(T, -1, 1))
