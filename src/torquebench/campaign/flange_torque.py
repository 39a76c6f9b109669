"""Torque at the reducer's flange: the transducer's, less what the flange itself takes to move."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
from scipy.signal import savgol_filter

from torquebench.bench.description import ModuleDescription
from torquebench.bench.devices import SynchronousRecording
from torquebench.signals import motion_of_angle, without_inertia

__all__ = ["flange_inertia_remark", "output_at_flange"]

WINDOW = 11
DEGREE = 5
"""Samples and degree of the polynomials through torque and angle: of a ripple of 12 samples a
period 99 % of the torque and 94 % of the acceleration stay, of one of 20 samples 99 % of both, and
of white noise 58 %."""


def output_at_flange(
    recording: SynchronousRecording, module: ModuleDescription
) -> SynchronousRecording:
    """Return a recording whose output torque is the one that acts at the flange.

    A drive's ripple swings the flange, and the transducer before it reads what that takes, too:
    where the ripple turns a loading back, that is missing at the reducer or added to it. Torque
    and angle go through the same window, which takes noise off the torque as well.

    Parameters
    ----------
    recording : SynchronousRecording
        With gaps or without; the first and last samples of a stretch, which have no window of
        their own, keep their torque.
    module : ModuleDescription
        Of the output; without an inertia in it the recording stays as it is.
    """
    inertia = module.flange_inertia_kgm2
    if inertia is None:
        return recording
    unsure = inertia * module.flange_inertia_uncertainty_percent / 200.0
    resolution_rad = 2.0 * np.pi / module.encoder.counts_per_revolution
    torque = recording.output_torque_nm.copy()
    uncertainty = recording.output_uncertainty_nm.copy()
    interval_s = float(np.median(np.diff(recording.time_s)))
    gaps = np.flatnonzero(np.diff(recording.time_s) > 1.5 * interval_s) + 1
    for rows in np.split(np.arange(torque.size), gaps):
        if rows.size < WINDOW:
            continue
        motion = motion_of_angle(
            recording.output_angle_rad[rows],
            interval_s,
            window=WINDOW,
            degree=DEGREE,
            angle_uncertainty_rad=resolution_rad / 12.0**0.5,
        )
        inner = slice(WINDOW // 2, rows.size - WINDOW // 2)
        smooth = savgol_filter(torque[rows], WINDOW, DEGREE)
        flange, unsure_nm = without_inertia(smooth, uncertainty[rows], motion, inertia, unsure)
        torque[rows[inner]], uncertainty[rows[inner]] = flange[inner], unsure_nm[inner]
    return replace(recording, output_torque_nm=torque, output_uncertainty_nm=uncertainty)


def flange_inertia_remark(module: ModuleDescription) -> str:
    """Say what is done about the flange's inertia where the torque ripples."""
    inertia = module.flange_inertia_kgm2
    if inertia is None:
        return (
            "the inertia of the output's flange isn't described: where the torque's ripple turns "
            "round, what the flange takes to move counts as the reducer's"
        )
    return (
        f"what the output's flange takes to move, {inertia:g} kg·m² "
        f"± {module.flange_inertia_uncertainty_percent:g} %, is taken off"
    )
