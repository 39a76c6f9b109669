"""Kernels compiled by a second process while the first one measures."""

from functools import partial

import numpy as np
import psutil
from numba import njit
from numba.core import event
from tests.streamed import streamed

from torquebench.bench.active_chain import ActiveChain
from torquebench.calibration import CalibrationData
from torquebench.campaign.demo import DemoSettings
from torquebench.campaign.fitting import ModelChoice, fit_models
from torquebench.cli.models.compiling import compile_fits, second_process


class Compiled(event.Listener):
    def __init__(self) -> None:
        self.names: list[str] = []

    def on_start(self, event: event.Event) -> None:
        self.names.append(event.data["dispatcher"].py_func.__qualname__)

    def on_end(self, event: event.Event) -> None:
        pass


def test_what_is_compiled_ahead_is_all_that_fits_and_their_chains_need() -> None:
    compile_fits()
    rising = np.linspace(50.0, 2000.0, 40)
    torque_nm = np.concatenate((rising, rising[::-1], -rising, -rising[::-1]))
    branch = np.tile(np.repeat([1, -1], 40), 2)
    share = torque_nm / 2000.0
    noise = np.random.default_rng(3).normal(0.0, 0.05, 160)
    reading_nm = 1.002 * torque_nm + branch * share * (1.0 - np.abs(share)) + noise
    data = CalibrationData(reading_nm, torque_nm, np.repeat([1, 2], 80), branch, 2000.0)
    compiled = Compiled()
    with event.install_listener("numba:compile", compiled):
        for fitted in fit_models(data, DemoSettings().choices()):
            chain = ActiveChain(fitted.chain, "model-1", fitted.model.kind)
            time_s = np.linspace(0.0, 1.0, 20)
            torque = streamed(chain, time_s, np.linspace(0.0, 900.0, 20), np.ones(20))
            assert np.all(np.isfinite(torque.value_nm)), fitted.name
    assert compiled.names == []


def second_processes(before: set[psutil.Process]) -> list[psutil.Process]:
    """Return new children, without the one that tidies up after multiprocessing."""
    new = set(psutil.Process().children()) - before
    return [each for each in new if "resource_tracker" not in " ".join(each.cmdline())]


def test_a_second_process_is_started_by_a_compilation_and_ends_with_the_block() -> None:
    before = set(psutil.Process().children())
    with second_process():
        assert second_processes(before) == []
        njit(lambda x: 3 * x)(1.0)
        njit(lambda x: 4 * x)(1.0)
        (second,) = second_processes(before)
    assert not second.is_running()


def test_what_fits_in_the_second_process_is_what_fits_here() -> None:
    rising = np.linspace(100.0, 2000.0, 20)
    torque_nm = np.concatenate((rising, rising[::-1], -rising, -rising[::-1]))
    branch = np.tile(np.repeat([1, -1], 20), 2)
    reading_nm = 1.002 * torque_nm + 0.8 * branch * np.sin(torque_nm / 700.0)
    data = CalibrationData(reading_nm, torque_nm, np.repeat([1, 2], 40), branch, 2000.0)
    choices = [ModelChoice("hybrid"), ModelChoice("polynomial-2")]
    with second_process(at_once=True) as other:
        there = other.begin(partial(fit_models, data, choices))()
    for one, other in zip(there, fit_models(data, choices), strict=True):
        X = data.features(one.model.n_features_in_)
        np.testing.assert_allclose(one.model.predict(X), other.model.predict(X), atol=1e-9)
        assert (one.name, one.remarks, one.choice) == (other.name, other.remarks, other.choice)


def test_what_a_second_process_that_dies_has_begun_is_computed_here() -> None:
    before = set(psutil.Process().children())
    with second_process(at_once=True) as other:
        wait = other.begin(partial(sum, (1, 2)))
        for each in second_processes(before):
            each.kill()
        assert wait() == 3
        assert other.begin(partial(sum, (2, 2)))() == 4
        assert njit(lambda x: 5 * x)(1.0) == 5.0
