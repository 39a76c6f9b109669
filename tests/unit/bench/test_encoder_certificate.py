"""Certificates of encoders: read, corrected over turns, refused where they can't be used."""

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from torquebench.bench.certificates.encoder import (
    EncoderCertificate,
    encoder_certificates,
    read_encoder_certificate,
)
from torquebench.bench.description import default_bench
from torquebench.bench.drivers.simulated.driver import open_simulated
from torquebench.errors import InputError

ARCSEC = np.pi / 648000
ANGLE = np.radians(np.arange(0.0, 360.0, 5.0))


def error(angle):
    return ARCSEC * (np.sin(angle + 1.0) + 0.3 * np.sin(2 * angle))


CERTIFICATE = EncoderCertificate(ANGLE, error(ANGLE), np.full(ANGLE.size, 0.2 * ARCSEC))


@given(true=st.floats(-100.0, 100.0))
def test_correction_gives_the_angle_at_any_turn(true):
    found = float(CERTIFICATE.correct(true + error(true)))
    assert abs(found - true) < 0.01 * ARCSEC
    assert pytest.approx(0.1 * ARCSEC) == CERTIFICATE.standard_uncertainty_rad


def test_file_beside_the_description_is_read(tmp_path):
    rows = [f"{np.degrees(a)},{error(a) / ARCSEC},0.2" for a in ANGLE]
    file = tmp_path / "encoder.csv"
    file.write_text("\n".join(["angle_deg,error_arcsec,expanded_uncertainty_arcsec", *rows]))
    read = read_encoder_certificate(file)
    np.testing.assert_allclose(read.error_rad, CERTIFICATE.error_rad, atol=1e-15)
    bench = default_bench()
    encoder = bench.output.encoder.model_copy(update={"certificate": file.name})
    module = bench.output.model_copy(update={"encoder": encoder})
    bench = bench.model_copy(update={"output": module}).relative_to(tmp_path)
    found = encoder_certificates(bench, open_simulated(bench).encoder_certificates)
    np.testing.assert_array_equal(found["output"].error_rad, read.error_rad)
    assert found["input"].angle_rad.size == 72  # what the simulated encoder brings along


@pytest.mark.parametrize(
    ("text", "match"),
    [
        ("angle_deg,error_arcsec\n0,1\n", "no column expanded_uncertainty_deg"),
        (
            "angle_deg,error_arcsec,expanded_uncertainty_arcsec\n0,x,1\n",
            "line 2, column error_arcsec",
        ),
        (
            "angle_deg,error_arcsec,expanded_uncertainty_arcsec\n" + "0,1,1\n" * 9,
            "don't increase",
        ),
        ("angle_deg,error_arcsec,expanded_uncertainty_arcsec\n0,1,1\n", "1 points"),
    ],
)
def test_files_that_cant_be_used_are_named(tmp_path, text, match):
    file = tmp_path / "encoder.csv"
    file.write_text(text)
    with pytest.raises(InputError, match=match):
        read_encoder_certificate(file)
    with pytest.raises(InputError, match="No such file"):
        read_encoder_certificate(tmp_path / "none.csv")


@pytest.mark.parametrize("seed", [1, 2, 3])
def test_simulated_encoders_are_known_better_by_their_certificates(seed):
    bench = default_bench()
    bench = bench.model_copy(update={"driver": {**bench.driver, "seed": seed}})
    drivers = open_simulated(bench)
    twin = drivers.counter.twin
    for side, certificate in encoder_certificates(bench, drivers.encoder_certificates).items():
        index = ("input", "output").index(side)
        encoder = twin._sides[index].encoder
        angle = np.linspace(0.0, 2 * np.pi, 1000)
        shown = angle + sum(
            encoder.error_rad[k] * np.sin((k + 1) * angle + encoder.error_phase_rad[k])
            for k in range(2)
        )
        left = certificate.correct(shown) - angle
        before = shown - angle
        assert np.std(left) < 0.5 * np.std(before)
        share = np.mean(np.abs(left) <= 2.0 * certificate.standard_uncertainty_rad)
        assert share > 0.8
