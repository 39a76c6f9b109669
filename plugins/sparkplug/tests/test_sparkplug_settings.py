"""The settings file of Sparkplug is checked before the bench is opened."""

from pathlib import Path

import pytest

from torquebench.errors import InputError
from torquebench_sparkplug.settings import load_settings

GOOD = 'group_id = "Hall 3"\nbrokers = ["mqtt://127.0.0.1"]\n'


def _written(folder: Path, text: str) -> Path:
    path = folder / "sparkplug.toml"
    path.write_text(text, encoding="utf-8")
    return path


def test_a_short_file_is_enough(tmp_path: Path) -> None:
    found = load_settings(_written(tmp_path, GOOD))
    assert found.named("Bench/7 #1").edge_node_id == "Bench-7 -1"
    assert found.named("Bench").named("other").edge_node_id == "Bench"
    assert found.interval_s == 1.0


def test_files_are_relative_to_the_settings(tmp_path: Path) -> None:
    (tmp_path / "password").write_text(" geheim\n")
    (tmp_path / "password").chmod(0o600)
    (tmp_path / "ca.pem").write_text("")
    more = 'user = "bench"\npassword_file = "password"\n[tls]\nca_file = "ca.pem"\n'
    found = load_settings(_written(tmp_path, GOOD + more))
    assert found.password() == "geheim"
    assert found.tls.ca_file == tmp_path / "ca.pem"


@pytest.mark.parametrize(
    ("text", "said"),
    [
        ("group_id = 3", "brokers"),
        (GOOD + 'grupp = "x"', "grupp is not a key"),
        (GOOD.replace("Hall 3", "Hall/3"), "printable characters without +, # and /"),
        (GOOD.replace("Hall 3", "STATE"), "this one is for hosts"),
        (GOOD.replace("mqtt://127.0.0.1", "tcp://127.0.0.1"), "mqtt://host:port"),
        (GOOD.replace("127.0.0.1", "me:pw@127.0.0.1"), "password_file"),
        (GOOD.replace("127.0.0.1", "127.0.0.1:99999"), "mqtt://host:port"),
        (GOOD.replace("127.0.0.1", "broker.example"), "insecure_network = true"),
        (GOOD + "interval_s = 0.01", "0.1 to 3,600 s"),
        (GOOD + 'password_file = "password"', "a name where there is a password_file"),
        (GOOD + "reconnect_first_s = 100.0", "at least reconnect_first_s, 100 s"),
        (GOOD + '[tls]\ncert_file = "a.pem"', "both cert_file and key_file"),
        (GOOD + '[tls]\nca_file = "a.pem"', "tls.ca_file"),
        (GOOD + 'user = "a"\npassword_file = "none"', "No such file"),
        (GOOD + "[deadband]\nspeed_rpm = -1.0", "deadband.speed_rpm"),
        ("brokers = [", "TOML"),
    ],
)
def test_a_wrong_file_is_explained(tmp_path: Path, text: str, said: str) -> None:
    with pytest.raises(InputError) as caught:
        load_settings(_written(tmp_path, text))
    assert said in str(caught.value)


def test_a_password_that_others_can_read_is_refused(tmp_path: Path) -> None:
    (tmp_path / "password").write_text("geheim")
    (tmp_path / "password").chmod(0o644)
    with pytest.raises(InputError, match="open to others"):
        load_settings(_written(tmp_path, GOOD + 'user = "a"\npassword_file = "password"'))


def test_a_network_without_encryption_needs_a_word(tmp_path: Path) -> None:
    text = GOOD.replace("127.0.0.1", "broker.example") + "insecure_network = true"
    assert load_settings(_written(tmp_path, text)).insecure_network
