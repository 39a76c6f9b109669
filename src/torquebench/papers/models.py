"""Fit the models that the page compares, and verify them at fresh points."""

from __future__ import annotations

import time
from collections.abc import Mapping
from dataclasses import dataclass, field
from types import MappingProxyType
from typing import Any

import numpy as np
from numpy.typing import NDArray

from torquebench.calibration import CalibrationData, VerificationResult, verify
from torquebench.campaign.fitting import feature_columns
from torquebench.chain import Readings, Torque
from torquebench.compensation import (
    CompensationModel,
    NetworkModel,
    features,
    make_model,
)
from torquebench.papers.tables import ModuleTables

BP_RESIDUAL, BP_DIRECT, POLYNOMIAL = "bp-residual", "bp-direct", "polynomial"
RECOMMENDED_NAME, BAYESIAN = "recommended", "bp-bayesian"


@dataclass(frozen=True)
class Choice:
    """A model that the page compares.

    Attributes
    ----------
    name, title, kind : str
    parameters : mapping
    rising_only : bool
        Whether it is fitted to the rising points only, as in the papers.
    """

    name: str
    title: str
    kind: str
    parameters: Mapping[str, Any] = field(default_factory=dict)
    rising_only: bool = True


_SMALL = {"start": "small-uniform", "epochs": 50_000}
CHOICES: Mapping[str, Choice] = MappingProxyType(
    {
        choice.name: choice
        for choice in (
            Choice(
                BP_RESIDUAL,
                "BP, additional torque [J]",
                "published-network",
                {"mapping": "residual", **_SMALL},
            ),
            Choice(
                BP_DIRECT,
                "BP, standard torque [M]",
                "published-network",
                {"mapping": "direct", **_SMALL},
            ),
            Choice(POLYNOMIAL, "polynomial, degree 2", "polynomial", {"degree": 2}),
            Choice(BAYESIAN, "same network, Bayesian training", "bayesian-network"),
            Choice(RECOMMENDED_NAME, "physics + Gaussian process", "hybrid", rising_only=False),
        )
    }
)
"""The papers' network in both mappings, their polynomial, and two of today's models."""


@dataclass(frozen=True, eq=False)
class PapersModel:
    """A fitted model that `verify` can use like a chain, without uncertainty.

    Attributes
    ----------
    choice : Choice
    model : CompensationModel
    seconds : float
        Duration of the fit.
    """

    choice: Choice
    model: CompensationModel
    seconds: float

    def torque_nm(
        self, reading_nm: NDArray[np.float64], branch: NDArray[np.float64]
    ) -> NDArray[np.float64]:
        """Return compensated torques, N·m."""
        X = features(reading_nm, branch, np.zeros(np.size(reading_nm)))
        return self.model.predict(X[:, : feature_columns(self.model)])

    def torque(self, readings: Readings) -> Torque:
        """Return compensated torques for `calibration.verify`."""
        branch = readings.branch
        known = np.zeros(readings.reading_nm.size) if branch is None else branch
        return Torque(self.torque_nm(readings.reading_nm, known), ())


@dataclass(frozen=True)
class NodeTrial:
    """Result of the network with a number of hidden nodes.

    Attributes
    ----------
    hidden : int
    rms_nm : float
        Root mean square of its residuals, N·m.
    fresh_nm : float or None
        Its largest error on fresh readings, N·m.
    """

    hidden: int
    rms_nm: float
    fresh_nm: float | None


NODES = (5, 10, 20, 50, 80)
NODE_EPOCHS = 10_000


def node_trials(tables: ModuleTables) -> tuple[NodeTrial, ...]:
    """Train the network of [J] on the rising points with several numbers of hidden nodes."""
    data, fresh = tables.rising, tables.verification
    found = []
    for hidden in NODES:
        parameters = {**CHOICES[BP_RESIDUAL].parameters, "epochs": NODE_EPOCHS, "hidden": hidden}
        model = NetworkModel(range_nm=data.range_nm, training="gradient-descent", **parameters)
        model.fit_curve(data.features(1), data.standard_nm)
        worst = None
        if fresh is not None:
            error = model.predict(fresh.features(1)) - fresh.standard_nm
            worst = float(np.max(np.abs(error)))
        found.append(NodeTrial(hidden, model.training_rms_nm_, worst))
    return tuple(found)


@dataclass(frozen=True, eq=False)
class FittedModule:
    """A module with its models and their errors on fresh points.

    Attributes
    ----------
    tables : ModuleTables
    models : mapping of str to PapersModel
        Models by the keys of `CHOICES`.
    same, others : VerificationResult or None
        Verification in groups at the same torques, and in groups at different torques.
    nodes : tuple of NodeTrial
        Results of the network with several numbers of hidden nodes.
    """

    tables: ModuleTables
    models: Mapping[str, PapersModel]
    same: VerificationResult | None
    others: VerificationResult | None
    nodes: tuple[NodeTrial, ...] = ()

    @property
    def verified(self) -> VerificationResult | None:
        """The verification at the same torques, or else the one at different torques."""
        return self.same or self.others

    def errors_nm(self, data: CalibrationData, name: str = "") -> NDArray[np.float64]:
        """Return errors of a model against the standard, or of the reading if no name is given."""
        if not name:
            return data.reading_nm - data.standard_nm
        torque = self.models[name].torque_nm(data.reading_nm, data.branch.astype(np.float64))
        return torque - data.standard_nm


def fit_module(
    tables: ModuleTables, names: tuple[str, ...] = tuple(CHOICES), *, trials: bool = False
) -> FittedModule:
    """Fit models to a module's calibration and verify them.

    Parameters
    ----------
    tables : ModuleTables
    names : tuple of str
        Keys of `CHOICES`.
    trials : bool
        Whether to try several numbers of hidden nodes, too.
    """
    models = {}
    for name in names:
        choice = CHOICES[name]
        data = tables.rising if choice.rising_only else tables.calibration
        model = make_model(choice.kind, range_nm=data.range_nm, **choice.parameters)
        started = time.perf_counter()
        model.fit_curve(data.features(feature_columns(model)), data.standard_nm)
        models[name] = PapersModel(choice, model, time.perf_counter() - started)

    def verified(data: CalibrationData | None) -> VerificationResult | None:
        return None if data is None else verify(data, models)

    return FittedModule(
        tables,
        models,
        verified(tables.same_points),
        verified(tables.other_points),
        node_trials(tables) if trials else (),
    )
