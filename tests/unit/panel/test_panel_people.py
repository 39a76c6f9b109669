from collections.abc import Callable, Iterator
from concurrent.futures import ThreadPoolExecutor
from pathlib import Path

import pytest
from argon2.exceptions import VerifyMismatchError

from torquebench.errors import InputError, RecordError
from torquebench.panel.service import (
    Actor,
    LockedOutError,
    NotFoundError,
    NotSignedInError,
    PermissionDeniedError,
    SignInError,
)
from torquebench.panel.service.access import passwords
from torquebench.panel.service.access.clients import Clients
from torquebench.panel.service.access.login_throttle import (
    FIRST_PAUSE_S,
    PER_ADDRESS,
    PER_PERSON_AND_ADDRESS,
    WINDOW_S,
)
from torquebench.panel.service.access.people import People
from torquebench.panel.service.access.sessions import IDLE_S, LONGEST_S
from torquebench.panel.service.store import PANEL_FILE, PanelStore

PASSWORD = "correct horse battery"


class Clock:
    def __init__(self) -> None:
        self.now = 1_000_000.0

    def __call__(self) -> float:
        return self.now


@pytest.fixture
def store(tmp_path: Path) -> Iterator[PanelStore]:
    opened = PanelStore(tmp_path)
    yield opened
    opened.close()


@pytest.fixture
def clock() -> Clock:
    return Clock()


@pytest.fixture
def people(store: PanelStore, clock: Clock) -> People:
    return People(store, clock)


@pytest.fixture
def administrator(people: People) -> Actor:
    code = people.setup_code
    assert code is not None
    return people.actor(people.set_up(code, "Ana", PASSWORD, "here"))


def test_the_first_administrator_needs_the_code_of_the_console(people: People) -> None:
    code = people.setup_code
    assert code is not None
    with pytest.raises(SignInError):
        people.set_up("AAAA-AAAA-AAAA", "Eve", PASSWORD, "there")
    with pytest.raises(InputError):
        people.set_up(code, "Ana", "short", "here")
    actor = people.actor(people.set_up(code.lower(), "Ana", PASSWORD, "here"))
    assert (actor.name, actor.role) == ("Ana", "administrator")
    assert people.setup_code is None
    with pytest.raises(SignInError):
        people.set_up(code, "Eve", PASSWORD, "there")


def test_guessing_the_code_locks_out(people: People) -> None:
    code = people.setup_code
    assert code is not None
    for _ in range(PER_PERSON_AND_ADDRESS):
        with pytest.raises(SignInError):
            people.set_up("WRONG", "Eve", PASSWORD, "there")
    with pytest.raises(LockedOutError):
        people.set_up(code, "Eve", PASSWORD, "there")
    people.set_up(code, "Ana", PASSWORD, "here")


def test_no_password_is_kept(people: People, administrator: Actor, tmp_path: Path) -> None:
    del administrator
    token = people.sign_in("ana", PASSWORD, "here")
    content = b"".join(path.read_bytes() for path in tmp_path.iterdir())
    assert b"$argon2id$" in content
    assert PASSWORD.encode() not in content
    assert token.encode() not in content
    assert (tmp_path / PANEL_FILE).stat().st_mode & 0o077 == 0


def test_wrong_passwords_lock_a_person_out_from_one_address_for_a_while(
    people: People, administrator: Actor, clock: Clock
) -> None:
    del administrator
    for _ in range(PER_PERSON_AND_ADDRESS):
        with pytest.raises(SignInError):
            people.sign_in("Ana", "wrong password", "there")
    with pytest.raises(LockedOutError) as refused:
        people.sign_in("Ana", PASSWORD, "there")
    assert 0 < refused.value.wait_s <= WINDOW_S
    people.sign_in("Ana", PASSWORD, "here")
    clock.now += WINDOW_S + 1
    people.sign_in("Ana", PASSWORD, "there")


def test_each_further_wrong_password_costs_twice_the_pause(
    people: People, administrator: Actor, clock: Clock
) -> None:
    del administrator
    for _ in range(PER_PERSON_AND_ADDRESS):
        with pytest.raises(SignInError):
            people.sign_in("Ana", "wrong password", "there")
    pauses = []
    for _ in range(4):
        with pytest.raises(LockedOutError) as refused:
            people.sign_in("Ana", PASSWORD, "there")  # too early: it costs nothing
        pauses.append(refused.value.wait_s)
        clock.now += refused.value.wait_s
        with pytest.raises(SignInError) as wrong:
            people.sign_in("Ana", "wrong password", "there")
        assert not isinstance(wrong.value, LockedOutError)
    assert pauses == [FIRST_PAUSE_S * 2**step for step in range(4)]


def test_nobody_elsewhere_shuts_a_person_out(people: People, administrator: Actor) -> None:
    del administrator
    for number in range(40):
        with pytest.raises(SignInError):
            people.sign_in("Ana", "wrong password", f"far away {number}")
    people.sign_in("Ana", PASSWORD, "here")


def test_an_administrator_lifts_a_lock(people: People, administrator: Actor) -> None:
    for name in ("Ben", "Eve"):
        people.add_user(administrator, name, "operator", PASSWORD)
    for number in range(PER_ADDRESS + 5):
        with pytest.raises(SignInError):
            people.sign_in("Ben" if number < 5 else f"guess {number}", "wrong password", "there")
    token = people.sign_in("Eve", PASSWORD, "here")
    with pytest.raises(LockedOutError):
        people.sign_in("Ben", PASSWORD, "there")
    people.change_user(administrator, "Ben", unlock=True)
    people.sign_in("Ben", PASSWORD, "there")
    assert people.actor(token).name == "Eve"


@pytest.mark.parametrize(
    "name",
    ["ANA", "ana", "Ana ", "\uff21na", "A\uff4e\uff41", "Station", "set-up", "\uff33tation"],
)
def test_a_name_of_the_same_compatibility_form_is_refused(
    people: People, administrator: Actor, name: str
) -> None:
    with pytest.raises(InputError):
        people.add_user(administrator, name, "operator", PASSWORD)
    assert [user.name for user in people.users(administrator)] == ["Ana"]


@pytest.mark.parametrize(
    "names", [("Clara", "Ciara"), ("M. Barn", "M. Bam"), ("Mia", "\u041c\u0456\u0430")]
)
def test_names_of_other_letters_are_other_people(
    people: People, administrator: Actor, names: tuple[str, str]
) -> None:
    """No list of letters that look alike says that one of two people can't have an account."""
    for name in names:
        people.add_user(administrator, name, "operator", PASSWORD)
    assert set(names) <= {user.name for user in people.users(administrator)}


def test_repeated_blanks_make_no_other_person(people: People, administrator: Actor) -> None:
    people.add_user(administrator, "Li Wei", "operator", PASSWORD)
    with pytest.raises(InputError, match="exists"):
        people.add_user(administrator, "Li  Wei", "operator", PASSWORD)
    people.add_user(administrator, "王伟", "operator", PASSWORD)


def test_an_unknown_name_is_refused_in_the_same_words(people: People, administrator: Actor) -> None:
    del administrator
    said = set()
    for name in ("Ana", "Nobody"):
        with pytest.raises(SignInError) as refused:
            people.sign_in(name, "wrong password", "there")
        said.add(str(refused.value))
    assert len(said) == 1


def test_sessions_expire_when_nobody_does_anything_and_after_a_shift(
    people: People, administrator: Actor, clock: Clock
) -> None:
    del administrator
    token = people.sign_in("Ana", PASSWORD, "here")
    clock.now += IDLE_S - 1
    people.actor(token, touch=False)
    clock.now += 2
    with pytest.raises(NotSignedInError):
        people.actor(token)
    token = people.sign_in("Ana", PASSWORD, "here")
    for _ in range(int(LONGEST_S / (IDLE_S / 2))):
        clock.now += IDLE_S / 2
        people.actor(token)
    clock.now += 1
    with pytest.raises(NotSignedInError):
        people.actor(token)


def test_a_session_survives_a_restart_and_ends_when_signed_out(
    people: People, administrator: Actor, store: PanelStore, clock: Clock
) -> None:
    del administrator
    token = people.sign_in("Ana", PASSWORD, "here")
    again = People(store, clock)
    assert again.setup_code is None
    assert again.actor(token).name == "Ana"
    again.sign_out(token)
    with pytest.raises(NotSignedInError):
        again.actor(token)
    with pytest.raises(NotSignedInError):
        People(store, clock).actor(token)


def test_a_changed_account_signs_in_anew(people: People, administrator: Actor) -> None:
    people.add_user(administrator, "Ben", "operator", PASSWORD)
    token = people.sign_in("ben ", PASSWORD, "here")
    people.change_user(administrator, "Ben", role="metrologist")
    with pytest.raises(NotSignedInError):
        people.actor(token)
    assert people.actor(people.sign_in("Ben", PASSWORD, "here")).role == "metrologist"
    people.change_user(administrator, "Ben", active=False)
    with pytest.raises(SignInError):
        people.sign_in("Ben", PASSWORD, "here")


def test_the_last_administrator_stays(people: People, administrator: Actor) -> None:
    for change in ({"role": "operator"}, {"active": False}):
        with pytest.raises(InputError, match="only administrator"):
            people.change_user(administrator, "Ana", **change)


def test_the_own_password_is_changed_with_the_old_one(people: People, administrator: Actor) -> None:
    with pytest.raises(SignInError):
        people.change_password(administrator, "wrong password", "another long one")
    people.change_password(administrator, PASSWORD, "another long one")
    people.sign_in("Ana", "another long one", "here")
    with pytest.raises(SignInError):
        people.sign_in("Ana", PASSWORD, "here")


@pytest.mark.parametrize(
    ("name", "role", "password"),
    [
        ("", "operator", PASSWORD),
        ("x" * 65, "operator", PASSWORD),
        ("<b>", "operator", PASSWORD),
        ("Ben", "king", PASSWORD),
        ("Ben", "operator", "short"),
        ("Ben", "operator", "x" * 129),
        ("Ben", "operator", "aaaaaaaaaaaa"),
        ("Benjamin", "operator", "my-benjamin-1"),
        ("ANA", "operator", PASSWORD),
    ],
)
def test_names_roles_and_passwords_have_rules(
    people: People, administrator: Actor, name: str, role: str, password: str
) -> None:
    with pytest.raises(InputError):
        people.add_user(administrator, name, role, password)  # type: ignore[arg-type]


def test_only_administrators_manage_people_and_clients(
    people: People, administrator: Actor, store: PanelStore
) -> None:
    people.add_user(administrator, "Ben", "metrologist", PASSWORD)
    ben = people.actor(people.sign_in("Ben", PASSWORD, "here"))
    clients = Clients(store)
    for refused in (
        lambda: people.users(ben),
        lambda: people.add_user(ben, "Cy", "operator", PASSWORD),
        lambda: people.change_user(ben, "Ana", active=False),
        lambda: clients.add(ben, "plant", "operator"),
        lambda: clients.list(ben),
        lambda: clients.revoke(ben, 1),
    ):
        with pytest.raises(PermissionDeniedError):
            refused()
    assert [user.name for user in people.users(administrator)] == ["Ana", "Ben"]


def test_a_clients_token_counts_until_it_is_revoked(
    administrator: Actor, people: People, store: PanelStore
) -> None:
    clients = Clients(store)
    client, token = clients.add(administrator, "plant", "operator")
    actor = clients.actor(token)
    assert (actor.name, actor.role, actor.kind) == ("plant", "operator", "client")
    with pytest.raises(PermissionDeniedError):
        people.confirm_password(actor, PASSWORD)
    with pytest.raises(InputError, match="exists"):
        clients.add(administrator, "plant", "operator")
    clients.revoke(administrator, client.client_id)
    with pytest.raises(NotSignedInError):
        clients.actor(token)
    with pytest.raises(NotFoundError):
        clients.revoke(administrator, client.client_id)
    clients.add(administrator, "plant", "metrologist")
    assert [each.revoked is None for each in clients.list(administrator)] == [False, True]


def test_a_store_of_a_newer_version_is_refused(tmp_path: Path) -> None:
    store = PanelStore(tmp_path)
    with store.transaction() as connection:
        connection.exec_driver_sql("PRAGMA user_version=99")
    store.close()
    with pytest.raises(RecordError, match="version 99"):
        PanelStore(tmp_path)


def test_what_is_done_is_logged(people: People, administrator: Actor, store: PanelStore) -> None:
    people.add_user(administrator, "Ben", "operator", PASSWORD)
    people.change_user(administrator, "Ben", password="another long one")
    newest = store.events(limit=1)[0]
    assert (newest.who, newest.what) == ("Ana", "changed an account")
    assert newest.details == {"name": "Ben", "password": "changed"}
    assert store.events(limit=1, before=newest.number)[0].what == "added an account"


def test_a_crowd_of_guesses_at_one_time_is_counted_like_a_queue(
    people: People, administrator: Actor, monkeypatch: pytest.MonkeyPatch
) -> None:
    del administrator
    compared: list[str] = []

    def slow(_stored: str | None, password: str) -> bool:
        compared.append(password)
        return False

    monkeypatch.setattr("torquebench.panel.service.access.people.matches", slow)

    def guess(number: int) -> str:
        try:
            people.sign_in("Ana", f"guess number {number}", "there")
        except SignInError as refused:
            return type(refused).__name__
        return "in"

    with ThreadPoolExecutor(20) as crowd:
        said = list(crowd.map(guess, range(20)))
    assert len(compared) == PER_PERSON_AND_ADDRESS
    assert said.count("LockedOutError") == 20 - PER_PERSON_AND_ADDRESS


def test_a_right_password_leaves_no_failure_behind(people: People, administrator: Actor) -> None:
    del administrator
    for _ in range(3 * PER_PERSON_AND_ADDRESS):
        people.sign_in("Ana", PASSWORD, "here")


def test_a_stranger_is_compared_as_long_as_anybody(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.undo()  # hashes of full strength
    with pytest.raises(VerifyMismatchError):  # computed to its end, not refused as malformed
        passwords._hasher.verify(passwords._nobody, PASSWORD)
    assert not passwords.matches(None, PASSWORD)
    assert not passwords.matches(passwords._nobody, PASSWORD)
    assert not passwords._hasher.check_needs_rehash(passwords._nobody)


def test_looking_a_token_up_waits_for_no_writer(store: PanelStore, clock: Clock) -> None:
    waiting: list[Callable[[], None]] = []
    people = People(store, clock, waiting.append)
    code = people.setup_code
    assert code is not None
    token = people.set_up(code, "Ana", PASSWORD, "here")
    clients = Clients(store)
    _, program = clients.add(people.actor(token), "plant", "operator")
    clock.now += 600.0
    with store.transaction():  # somebody writes, and would be waited for
        assert people.actor(token).name == "Ana"
        assert clients.actor(program).name == "plant"
    assert len(waiting) == 1
    waiting.pop()()
    assert People(store, clock).actor(token).name == "Ana"
    clock.now += IDLE_S - 1.0
    assert People(store, clock).actor(token).name == "Ana"


def test_a_program_is_known_again_after_a_restart_and_revoked_for_good(
    store: PanelStore, administrator: Actor
) -> None:
    clients = Clients(store)
    client, token = clients.add(administrator, "plant", "operator")
    again = Clients(store)
    actor = again.actor(token)
    assert again.lives(actor.session_id)
    again.revoke(administrator, client.client_id)
    assert not again.lives(actor.session_id)
    with pytest.raises(NotSignedInError):
        again.actor(token)
    with pytest.raises(NotSignedInError):
        Clients(store).actor(token)
